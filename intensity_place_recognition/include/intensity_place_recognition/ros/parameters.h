// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/parameters.h>

#include <string>

#include "intensity_place_recognition/place_recognizer.h"

namespace intensity_place_recognition {

struct PlaceRecognitionParameters {
  std::string intensity_field = "intensity";
  int queue_size = 2;
  double min_interval = 1.0;
  std::string database_file, save_on_shutdown;
  bool debug_image = true;
  PlaceRecognizerOptions recognizer;

  PlaceRecognitionParameters() { recognizer.beta = 30; }

  void describe(mapping_common::OptionList& o) {
    o.section("the input");
    o("intensity_field", intensity_field, "",
      "of the clouds' points: intensity, or reflectivity where it is calibrated")
        .notEmpty();
    o("queue_size", queue_size, "", "clouds that wait; the oldest is dropped").within(1, 1000);
    o("min_interval", min_interval, "s", "since the last cloud that was used, by their stamps")
        .within(0.0, 1e6)
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
