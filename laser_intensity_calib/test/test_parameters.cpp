// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include "laser_intensity_calib/ros/parameters.h"

namespace laser_intensity_calib {
namespace {

TEST(Parameters, AreSoundAndDocumented) {
  mapping_common::expectSound<ReflectivityParameters>();
  mapping_common::expectDocumented<ReflectivityParameters>("laser_intensity_calib/ReflectivityNodelet",
                                                           PACKAGE_DIR "/config/reflectivity.yaml",
                                                           PACKAGE_DIR "/docs/parameters.md");
}

TEST(Parameters, AreRejectedByName) {
  const mapping_common::TempDir dir;
  const auto rejection = [&dir](const std::string& yaml) {
    return mapping_common::rejection<ReflectivityParameters>(dir.write("a.yaml", yaml));
  };
  EXPECT_EQ("~scan/max_incidence_deg is 95, allowed is 10 to 89.9 deg",
            rejection("scan: {max_incidence_deg: 95}"));
  EXPECT_EQ("~model is 'lambert', allowed is raw | range | lut", rejection("model: lambert"));
}

}  // namespace
}  // namespace laser_intensity_calib
