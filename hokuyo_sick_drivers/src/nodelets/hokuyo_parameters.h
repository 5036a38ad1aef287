// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "hokuyo_sick_drivers/connection.h"
#include "hokuyo_sick_drivers/hokuyo.h"

namespace hokuyo_sick_drivers {

/// What the driver of a Hokuyo is started with; names and meanings are those of urg_node.
struct HokuyoParameters {
  std::string ip_address;
  int ip_port = 10940;
  std::string serial_port = "/dev/ttyACM0";
  int serial_baud = 115200;
  bool detect_baud = true;
  bool reset_device = false;
  int error_limit = 4;
  std::string frame_id = "laser";
  HokuyoSettings settings;
  bool calibrate_time = true, synchronize_time = false;
  double time_offset = 0.0;
  double diagnostics_tolerance = 0.05, diagnostics_window_time = 5.0;

  void describe(mapping_common::OptionList& o) {
    o.section("the connection");
    o("ip_address", ip_address, "",
      "of a scanner with Ethernet, 192.168.0.10 as delivered; empty: serial_port");
    o("ip_port", ip_port, "", "TCP port of a scanner with Ethernet").within(1, 65535);
    o("serial_port", serial_port, "",
      "of a scanner with USB or RS-232. Its number may change when it is plugged in again; this line in "
      "/etc/udev/rules.d/99-hokuyo.rules makes /dev/hokuyo of the scanner: SUBSYSTEM==\"tty\", "
      "ATTRS{idVendor}==\"15d1\", ATTRS{idProduct}==\"0000\", SYMLINK+=\"hokuyo\", MODE=\"0666\", "
      "ENV{ID_MM_DEVICE_IGNORE}=\"1\". For several scanners, getID --help has one that tells them apart");
    o("serial_baud", serial_baud, "", "of RS-232; without effect on USB").within(9600, 4000000);
    o("detect_baud", detect_baud, "",
      "true: tries SCIP's other rates where the scanner doesn't answer at serial_baud");
    o("reset_device", reset_device, "",
      "true: resets the scanner (RS) after each connection; its clock starts at 0 then");
    o("error_limit", error_limit, "",
      "bad scans in a row after which measuring is started anew, and such restarts without a scan after "
      "which the port "
      "is opened anew")
        .within(1, 1000);
    o.section("the scans");
    o("frame_id", frame_id, "", "frame of the scans").dynamic();
    settings.describe(o);
    o.section("the stamps");
    o("calibrate_time", calibrate_time, "",
      "true: asks for the scanner's time before measuring, so that stamps are right within a millisecond. "
      "false: they "
      "come from the times of arrival, which are later by the transport's least delay");
    o("synchronize_time", synchronize_time, "", "the same, for configurations of urg_node");
    o("time_offset", time_offset, "s", "added to the stamps").within(-10.0, 10.0).dynamic();
    o.section("diagnostics");
    o("diagnostics_tolerance", diagnostics_tolerance, "",
      "share by which the rate of scans may be off before diagnostics warn")
        .within(0.0, 1.0);
    o("diagnostics_window_time", diagnostics_window_time, "s", "over which the rate is measured")
        .within(1.0, 3600.0);
  }

  Endpoint endpoint() const { return {ip_address, ip_port, serial_port, serial_baud}; }
  Hokuyo::Options options() const {
    Hokuyo::Options options;
    options.synchronize_clock = calibrate_time || synchronize_time;
    options.reset = reset_device;
    options.error_limit = error_limit;
    if (!ip_address.empty()) return options;
    options.baud_rates = {serial_baud};
    for (const int rate : {19200, 38400, 57600, 115200, 250000, 500000, 750000})
      if (detect_baud && rate != serial_baud) options.baud_rates.push_back(rate);
    return options;
  }
};

}  // namespace hokuyo_sick_drivers
