// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include "intensity_place_recognition/ros/parameters.h"

namespace intensity_place_recognition {
namespace {

std::string rejection(const std::string& yaml) {
  const mapping_common::TempDir dir;
  return mapping_common::rejection<PlaceRecognitionParameters>(dir.write("a.yaml", yaml));
}

TEST(Parameters, AreSoundAndDocumented) {
  mapping_common::expectSound<PlaceRecognitionParameters>();
  mapping_common::expectDocumented<PlaceRecognitionParameters>(
      "intensity_place_recognition/PlaceRecognitionNodelet", PACKAGE_DIR "/config/place_recognition.yaml",
      PACKAGE_DIR "/docs/parameters.md");
}

TEST(Parameters, AreRejectedByName) {
  EXPECT_EQ(
      "~description/type is 'sift', allowed is polar | hog | gist | words | binary | shot | shot_colour",
      rejection("description: {type: sift}"));
  EXPECT_EQ("~description/views is 'front', allowed is panorama with polar",
            rejection("description: {views: front}"));
  EXPECT_EQ("~panorama/width is 1, allowed is 16 to 65536 pixels", rejection("panorama: {width: 1}"));
  EXPECT_EQ("~registration/min_score is 2, allowed is 0 to 1", rejection("registration: {min_score: 2.0}"));
}

}  // namespace
}  // namespace intensity_place_recognition
