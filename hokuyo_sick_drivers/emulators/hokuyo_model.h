// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace device_emulators {

/// What tells one Hokuyo from another.
struct HokuyoModel {
  std::string name;  ///< of the preset
  std::string modl, prod, firm, prot = "SCIP 2.0", seri = "00902676";
  int dmin = 23, dmax = 60000;  ///< mm
  int ares = 1440;              ///< steps in a turn
  int amin = 0, amax = 1080, afrt = 540;
  int rpm = 2400;

  bool ethernet = false;
  bool scip22 = false;          ///< knows %ST, %SL and RB; error codes of SCIP 2.2
  bool intensity = true;        ///< ME, GE
  bool multi_echo = false;      ///< HD, HE, ND, NE
  bool motor_speed = false;     ///< CR
  bool sensitivity = false;     ///< HS
  bool baud_rates = false;      ///< SS changes the rate of an RS-232 line
  bool hex_time = true;         ///< TIME of II: six hex digits; else four characters
  bool time_needs_mode = true;  ///< TM1 outside of the adjust mode: 04

  std::string sbps = "USB Full Speed";
  std::string stat = "Sensor works well.";
  /// MESM of II: standing, measuring once, streaming
  std::string mesm_idle = "CLASSIC", mesm_single = "CLASSIC", mesm_multi = "CLASSIC";

  double intensity_scale = 1.0;  ///< from the source's intensities to those sent

  /// Codes sent for +inf, for NaN, and for a range below dmin.
  unsigned code_far = 1, code_invalid = 0, code_near = 4;
};

/// @throws std::runtime_error that lists the known names
HokuyoModel hokuyoModel(const std::string& name);
std::vector<std::string> hokuyoModels();

}  // namespace device_emulators
