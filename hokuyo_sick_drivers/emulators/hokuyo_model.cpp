// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_model.h"

#include <stdexcept>

namespace device_emulators {
namespace {

std::vector<HokuyoModel> models() {
  HokuyoModel utm;
  utm.name = "UTM-30LX";
  utm.modl = "UTM-30LX(Hokuyo Automatic Co.,Ltd.)";
  utm.prod = "SOKUIKI Sensor TOP-URG UTM-30LX";
  utm.firm = "P.1.05(17/Apr./2009)";

  HokuyoModel utm_ew = utm;
  utm_ew.name = utm_ew.modl = "UTM-30LX-EW";
  utm_ew.prod = "SOKUIKI Sensor UTM-30LX-EW";
  utm_ew.firm = "1.1.0 (2011-09-30)";
  utm_ew.prot = "SCIP 2.2";
  utm_ew.ethernet = utm_ew.scip22 = utm_ew.multi_echo = true;
  utm_ew.time_needs_mode = false;
  utm_ew.sbps = "Ethernet 100 [Mbps]";
  utm_ew.stat = "Stable 000 no error.";
  utm_ew.mesm_idle = "000 Idle";
  utm_ew.mesm_single = "003 Single_scan";
  utm_ew.mesm_multi = "004 Multi_scan";

  HokuyoModel ust = utm_ew;
  ust.name = ust.modl = "UST-10LX";
  ust.prod = "SOKUIKI Sensor UST-10LX";
  ust.dmin = 20;
  ust.dmax = 30000;
  ust.multi_echo = ust.hex_time = false;
  ust.stat = "sensor is working normally";
  ust.mesm_idle = "Idle";
  ust.mesm_single = ust.mesm_multi = "Measuring by Sensitive Mode";
  ust.code_far = 65533;
  ust.code_near = 0;

  HokuyoModel urg = utm;
  urg.name = "URG-04LX";
  urg.modl = "URG-04LX(Hokuyo Automatic Co.,Ltd.)";
  urg.prod = "SOKUIKI Sensor URG-04LX";
  urg.firm = "3.3.00(16/Apr./2008)";
  urg.dmin = 20;
  urg.dmax = 5600;
  urg.ares = 1024;
  urg.amin = 44;
  urg.amax = 725;
  urg.afrt = 384;
  urg.rpm = 600;
  urg.intensity = false;
  urg.motor_speed = urg.sensitivity = urg.baud_rates = true;
  urg.code_far = urg.code_invalid = urg.code_near = 0;

  HokuyoModel uxm = utm;
  uxm.name = "UXM-30LX-E";
  uxm.modl = "UXM-30LX-E(Hokuyo Automatic Co.,Ltd.)";
  uxm.prod = "SOKUIKI Sensor UXM-30LX-E";
  uxm.ethernet = true;
  uxm.sbps = "Ethernet 100 [Mbps]";
  uxm.dmin = 100;
  uxm.dmax = 100000;
  uxm.amax = 760;
  uxm.afrt = 380;
  uxm.rpm = 1200;

  return {utm, utm_ew, ust, urg, uxm};
}

}  // namespace

HokuyoModel hokuyoModel(const std::string& name) {
  std::string known;
  for (const HokuyoModel& model : models()) {
    if (model.name == name) return model;
    known += " " + model.name;
  }
  throw std::runtime_error("unknown model '" + name + "'; known are" + known);
}

std::vector<std::string> hokuyoModels() {
  std::vector<std::string> names;
  for (const HokuyoModel& model : models()) names.push_back(model.name);
  return names;
}

}  // namespace device_emulators
