// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include "nodelets/hokuyo_parameters.h"
#include "nodelets/sick_parameters.h"
#include "zf/ros/parameters.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::expectDocumented;
using mapping_common::expectSound;

TEST(HokuyoParameters, AreSoundAndDocumented) {
  expectSound<HokuyoParameters>();
  expectDocumented<HokuyoParameters>("hokuyo_sick_drivers/HokuyoNodelet", PACKAGE_DIR "/config/hokuyo.yaml",
                                     PACKAGE_DIR "/docs/hokuyo_parameters.md",
                                     "Names and meanings are those of urg_node.");
}

TEST(SickParameters, AreSoundAndDocumented) {
  expectSound<SickParameters>();
  expectDocumented<SickParameters>("hokuyo_sick_drivers/SickNodelet", PACKAGE_DIR "/config/sick.yaml",
                                   PACKAGE_DIR "/docs/sick_parameters.md",
                                   "Where '' is allowed, the device stays as it is. Those marked (EEPROM) "
                                   "are stored in the device, where writing is "
                                   "limited: they are written only if they differ from what the device has.");
}

TEST(ZfReaderParameters, AreSoundAndDocumented) {
  expectSound<ZfReaderParameters>();
  expectDocumented<ZfReaderParameters>("hokuyo_sick_drivers/ZfReaderNodelet",
                                       PACKAGE_DIR "/config/zf_reader.yaml",
                                       PACKAGE_DIR "/docs/zf_reader_parameters.md", "file has to be set.");
}

TEST(SickParameters, MakeTheDriversOptions) {
  const mapping_common::TempDir dir;
  SickParameters p;
  EXPECT_FALSE(p.options().variant || p.options().unit || p.options().measuring_mode ||
               p.options().sensitivity);
  EXPECT_EQ(true, p.options().real_time_index);
  mapping_common::assign(p, mapping_common::loadYaml(dir.write("a.yaml", R"(
      {angle: 100, resolution: 0.5, units: mm, measuring_mode: 6, sensitivity: high, realtime_index: "",
       highest_availability: disabled, connect_delay: 2})")));
  const LmsOptions options = p.options();
  EXPECT_EQ((lms::Variant{100, 50}), options.variant);
  EXPECT_EQ(lms::Unit::kMillimetre, options.unit);
  EXPECT_EQ(6, options.measuring_mode);
  EXPECT_EQ(3, options.sensitivity);
  EXPECT_EQ(std::nullopt, options.real_time_index);
  EXPECT_EQ(false, options.highest_availability);
  EXPECT_EQ(2 * kSecond, options.connect_delay);
  mapping_common::assign(p, {{"angle", 120}});
  EXPECT_THROW(p.options(), std::invalid_argument);
}

TEST(Parameters, AreRejectedByName) {
  const mapping_common::TempDir dir;
  const auto write = [&dir](const std::string& yaml) { return dir.write("a.yaml", yaml); };
  EXPECT_EQ("~angle_min is 1, allowed is less than angle_max",
            mapping_common::rejection<HokuyoParameters>(write("{angle_min: 1, angle_max: 0.5}")));
  EXPECT_EQ("~units is 'dm', allowed is cm | mm | ''",
            mapping_common::rejection<SickParameters>(write("units: dm")));
  EXPECT_EQ("~offset is 'some', allowed is auto, none or \"X Y Z\"",
            mapping_common::rejection<ZfReaderParameters>(write("offset: some")));
  EXPECT_EQ("~parent_frame is 'scanner', allowed is a frame other than frame_id",
            mapping_common::rejection<ZfReaderParameters>(write("parent_frame: scanner")));
}

}  // namespace
}  // namespace hokuyo_sick_drivers
