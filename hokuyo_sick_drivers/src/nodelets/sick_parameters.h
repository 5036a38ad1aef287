// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <string>

#include "hokuyo_sick_drivers/connection.h"
#include "hokuyo_sick_drivers/lms2xx.h"

namespace hokuyo_sick_drivers {

enum class Sensitivity { kStandard, kMedium, kLow, kHigh };
constexpr auto choicesOf(Sensitivity) {
  return mapping_common::choices<Sensitivity>({{"standard", Sensitivity::kStandard},
                                               {"medium", Sensitivity::kMedium},
                                               {"low", Sensitivity::kLow},
                                               {"high", Sensitivity::kHigh}});
}
enum class Switch { kDisabled, kEnabled };
constexpr auto choicesOf(Switch) {
  return mapping_common::choices<Switch>({{"enabled", Switch::kEnabled}, {"disabled", Switch::kDisabled}});
}

/// What the driver of a SICK LMS 2xx is started with; names and meanings are those of sicktoolbox_wrapper.
struct SickParameters {
  std::string port = "/dev/lms200";
  double connect_delay = 0.0;
  std::string hardware_id = "SICK LMS";
  int angle = 0;
  double resolution = 0.0;
  int measuring_mode = -1;
  std::optional<Sensitivity> sensitivity;
  std::optional<Switch> highest_availability, ignore_dazzling, realtime_index = Switch::kEnabled;
  LmsOptions lms;  ///< those that are left are made of the others
  double intensity_scale = 1.0;
  std::string frame_id = "laser";
  bool inverted = false;
  double time_offset = 0.0;
  bool use_rep_117 = true;
  double desired_frequency = 0.0, min_frequency = 0.0, max_frequency = 0.0;
  double frequency_tolerance = 0.3;
  int window_size = 5;
  double min_acceptable_delay = 0.0, max_acceptable_delay = 1.0;

  void describe(mapping_common::OptionList& o) {
    o.section("the line");
    o("port", port, "", "serial port, RS-232 or RS-422").notEmpty();
    o("baud", lms.baud_rate, "",
      "9600 | 19200 | 38400 | 500000 (RS-422 only). The device may start with any of them");
    o("connect_delay", connect_delay, "s",
      "before anything is sent: a device takes 30 s and more to start up")
        .within(0.0, 600.0);
    o("hardware_id", hardware_id, "", "in the diagnostics");
    o.section("measurements");
    o("angle", angle, "deg", "180 | 100; 0 with a resolution of 0: as it is, with intensities 180")
        .within(0, 180);
    o("resolution", resolution, "deg",
      "1.0 | 0.5 | 0.25; 0: as it is, with intensities 1.0. Fast types (-S14) have 90 degrees by 0.5 and "
      "nothing else")
        .within(0.0, 1.0);
    o("interlaced", lms.interlaced, "",
      "true: with an angle of 180, partial scans by 1 degree at 75 Hz, each shifted by what the resolution "
      "says; 180 "
      "degrees by 0.25 come this way only");
    o("units", lms.unit, "", "(EEPROM)");
    o("intensity", lms.intensity, "", "(EEPROM) fast types send a byte of reflectivity for either mode");
    o("intensity_scale", intensity_scale, "",
      "the intensities as the device sends them are multiplied by this")
        .dynamic();
    o("intensity_range", lms.intensity_range, "",
      "how ranges are coded that come with intensities, which no document tells");
    o("first_index", lms.first_index, "",
      "with intensities: the first value to be sent, 1 is the one at the right end")
        .within(1, 401);
    o("last_index", lms.last_index, "",
      "and the last one; 0: the last there is. 199 values fit in a telegram, 198 with a real-time index. At "
      "500000 baud, "
      "162 are sent in a turn of the mirror: more halve the rate")
        .within(0, 401);
    o("measuring_mode", measuring_mode, "",
      "(EEPROM) without intensities: 0 to 6 or 15, see the device's telegram listing; -1: as it is, or 0 if "
      "that has no "
      "ranges")
        .within(-1, 255);
    o("sensitivity", sensitivity, "", "(EEPROM)");
    o("highest_availability", highest_availability, "", "(EEPROM)");
    o("ignore_dazzling", ignore_dazzling, "", "(EEPROM) whether dazzling leaves the outputs alone");
    o("realtime_index", realtime_index, "",
      "(EEPROM) the device numbers its scans, for better stamps and the number of lost ones. Disable it if a "
      "scan of 100 "
      "degrees by 0.25 doesn't come");
    o("restore_on_exit", lms.restore_on_exit, "",
      "true: writes back configuration, variant and baud rate as they were found, which takes seconds and "
      "two writes to "
      "the EEPROM per run if the configuration differs");
    o.section("messages");
    o("frame_id", frame_id, "", "of the scans");
    o("inverted", inverted, "", "true: the scanner hangs upside down, angles fall").dynamic();
    o("time_offset", time_offset, "s", "added to the stamps").within(-1.0, 1.0).dynamic();
    o("use_rep_117", use_rep_117, "", "inf: no return, NaN: an error; false: both are range_max + 1 m");
    o.section("diagnostics");
    o("desired_frequency", desired_frequency, "Hz", "of the scans; 0: what variant and line give")
        .within(0.0, 100.0);
    o("min_frequency", min_frequency, "Hz", "warned of below; 0: as desired").within(0.0, 100.0).dynamic();
    o("max_frequency", max_frequency, "Hz", "warned of above; 0: as desired").within(0.0, 100.0).dynamic();
    o("frequency_tolerance", frequency_tolerance, "", "of min_frequency and max_frequency, as a ratio")
        .within(0.0, 1.0);
    o("window_size", window_size, "s", "over which the rate is averaged").within(1, 1000);
    o("min_acceptable_delay", min_acceptable_delay, "s", "from a scan's stamp to its publication")
        .within(-10.0, 10.0);
    o("max_acceptable_delay", max_acceptable_delay, "s", "the same").within(0.0, 10.0);
  }

  Endpoint endpoint() const { return {"", 0, port, lms.baud_rate}; }
  /// @throws std::invalid_argument if they ask for something that an LMS can't do
  LmsOptions options() const {
    LmsOptions options = lms;
    options.connect_delay = std::llround(connect_delay * kSecond);
    if (angle != 0 || resolution != 0.0)
      options.variant = lms::Variant{angle, static_cast<int>(std::lround(100.0 * resolution))};
    if (measuring_mode >= 0) options.measuring_mode = measuring_mode;
    if (sensitivity) options.sensitivity = static_cast<int>(*sensitivity);
    const auto isOn = [](const std::optional<Switch>& s) {
      return s ? std::optional<bool>(*s == Switch::kEnabled) : std::nullopt;
    };
    options.highest_availability = isOn(highest_availability);
    options.ignore_dazzling = isOn(ignore_dazzling);
    options.real_time_index = isOn(realtime_index);
    options.check();
    return options;
  }
};

}  // namespace hokuyo_sick_drivers
