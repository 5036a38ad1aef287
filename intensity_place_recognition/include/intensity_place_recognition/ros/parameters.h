// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/parameters.h>

#include <string>

#include "intensity_place_recognition/place_recognizer.h"

namespace intensity_place_recognition {

enum class Input { kCloud, kImages };
constexpr auto choicesOf(Input) {
  return mapping_common::choices<Input>(
      {{"cloud", Input::kCloud, "clouds"},
       {"images", Input::kImages, "panoramas of intensities and of ranges, image and range_image"}});
}

struct PlaceRecognitionParameters {
  Input input = Input::kCloud;
  double range_unit = 0.001;
  std::string intensity_field = "intensity";
  int queue_size = 2;
  double min_interval = 1.0, same_place = 1.0;
  std::string database_file, save_on_shutdown;
  bool debug_image = true;
  PlaceRecognizerOptions recognizer;

  PlaceRecognitionParameters() { recognizer.beta = 30; }

  void describe(mapping_common::OptionList& o) {
    o.section("the input");
    o("input", input, "", "what places are recognised in");
    o("range_unit", range_unit, "m",
      "of range images of integers: 0.001 as in REP 118, 0.004 of Ouster's driver. Floats are in m")
        .within(1e-6, 1.0);
    o("intensity_field", intensity_field, "",
      "of the clouds' points: intensity, or reflectivity where it is calibrated")
        .notEmpty();
    o("queue_size", queue_size, "", "clouds, or images of each topic, that wait; the oldest is dropped")
        .within(1, 1000);
    o("min_interval", min_interval, "s", "since the last scan that was used, by their stamps")
        .within(0.0, 1e6)
        .dynamic();
    o("same_place", same_place, "m",
      "a scan that is recognised within that of a place isn't kept as another one, so that a robot that "
      "stands, "
      "or drives known ways, takes no more memory. 0: all are kept")
        .within(0.0, 1e3)
        .dynamic();
    o("database_file", database_file, "",
      "path of a database of places to start with; how it describes scans replaces what is set below");
    o("save_on_shutdown", save_on_shutdown, "",
      "path that the database is written to at the end. Empty: don't");
    o("debug_image", debug_image, "",
      "true: keeps small copies of panoramas (some 50 kB each) and publishes matched pairs");
    o.section("the method");
    recognizer.describe(o);
  }
};

}  // namespace intensity_place_recognition
