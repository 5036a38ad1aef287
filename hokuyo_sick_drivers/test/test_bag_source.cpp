// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <std_msgs/String.h>

#include <cmath>
#include <limits>

#include "bag_source.h"
#include "emulator_host.h"
#include "hokuyo_device.h"
#include "mapping_common/testing/recordings.h"
#include "mapping_common/testing/temp_dir.h"

namespace device_emulators {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

constexpr int kScans = 100, kBeams = 1081;

sensor_msgs::LaserScan scanOf(int number) {
  sensor_msgs::LaserScan scan;
  scan.header.stamp = ros::Time(1000.0 + 0.025 * number);
  scan.angle_min = -135.0f * static_cast<float>(M_PI) / 180.0f;
  scan.angle_increment = 0.25f * static_cast<float>(M_PI) / 180.0f;
  for (int beam = 0; beam < kBeams; ++beam) {
    scan.ranges.push_back(1.0f + 0.001f * static_cast<float>(number + beam));
    scan.intensities.push_back(static_cast<float>(beam));
  }
  return scan;
}

std::string writeBag(const TempDir& folder) {
  const std::string path = folder.path("scans.bag");
  rosbag::Bag bag(path, rosbag::bagmode::Write);
  for (int i = 0; i < kScans; ++i) {
    const sensor_msgs::LaserScan scan = scanOf(i);
    bag.write("/scan", scan.header.stamp, scan);
  }
  bag.write("/text", ros::Time(1000.5), std_msgs::String());
  return path;
}

TEST(BagSource, DeviceOfTheBagsRateSendsEachScanOnceOverAndOver) {
  const TempDir folder;
  HokuyoDevice device(HokuyoOptions(), std::make_shared<BagSource>(writeBag(folder), ""));
  Host host(device);
  host.ask("ME0000108001000\n", 6 * kSecond);
  const auto scans = device.takeSentScans();
  ASSERT_GT(scans.size(), 230u);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const auto expected = scanOf(static_cast<int>(i) % kScans);
    ASSERT_EQ(scans[i].ranges.size(), expected.ranges.size());
    for (std::size_t beam = 0; beam < expected.ranges.size(); ++beam) {
      ASSERT_EQ(scans[i].ranges[beam], static_cast<std::uint32_t>(std::lround(expected.ranges[beam] * 1e3)))
          << "scan " << i << " beam " << beam;
      ASSERT_EQ(scans[i].intensities[beam], static_cast<std::uint32_t>(beam));
    }
  }
}

TEST(BagSource, KeepsTheBagsRate) {
  const TempDir folder;
  BagSource source(writeBag(folder), "scan");
  EXPECT_EQ(source.scans(), static_cast<std::size_t>(kScans));
  const auto number = [&](Nanoseconds time) {
    return static_cast<int>(std::lround((source.at(time)->ranges[0][0] - 1.0f) * 1e3f));
  };
  EXPECT_EQ(number(5 * kSecond), 0) << "time starts at the first call";
  EXPECT_EQ(number(5 * kSecond + 10 * kMillisecond), 0);
  EXPECT_EQ(number(5 * kSecond + 15 * kMillisecond), 1);
  EXPECT_EQ(number(5 * kSecond + 50 * kMillisecond), 2);
  EXPECT_EQ(number(6 * kSecond), 40);
  EXPECT_EQ(number(8 * kSecond), 20);
}

TEST(BagSource, SaysWhatIsWrongWithTheBag) {
  const TempDir folder;
  const std::string path = writeBag(folder);
  EXPECT_TRUE(mentions(errorOf([&] { BagSource(path, "/odd"); }),
                       {"/odd", "/scan (sensor_msgs/LaserScan)", "/text"}));
  EXPECT_TRUE(mentions(errorOf([&] { BagSource(path, "/text"); }), {"/text"}));
  EXPECT_TRUE(mentions(errorOf([&] { BagSource(folder.path("none.bag"), ""); }), {"none.bag"}));
  EXPECT_TRUE(mentions(errorOf([&] { BagSource(folder.write("bad.bag", "no bag"), ""); }), {"bad.bag"}));
}

TEST(BagSource, MultiEcho) {
  sensor_msgs::MultiEchoLaserScan message;
  message.angle_increment = 0.1f;
  message.ranges.resize(3);
  message.ranges[0].echoes = {1.0f, 2.0f};
  message.ranges[2].echoes = {3.0f};
  message.intensities.resize(3);
  message.intensities[0].echoes = {10.0f, 20.0f};
  const Scan scan = toScan(message);
  ASSERT_EQ(scan.ranges.size(), 2u);
  ASSERT_EQ(scan.intensities.size(), 2u);
  EXPECT_EQ(scan.ranges[1][0], 2.0f);
  EXPECT_EQ(scan.intensities[1][0], 20.0f);
  EXPECT_TRUE(std::isnan(scan.ranges[0][1]));
  EXPECT_TRUE(std::isnan(scan.ranges[1][2]));
}

TEST(BagSource, RejectsScansThatDontFitTogether) {
  sensor_msgs::LaserScan scan = scanOf(0);
  scan.intensities.pop_back();
  EXPECT_TRUE(mentions(errorOf([&] { toScan(scan); }), {"1081", "1080"}));
}

TEST(ScanSource, BeamsByDirection) {
  Scan scan{-1.0, 0.5, {std::vector<float>(5, 1.0f)}, {}};
  EXPECT_EQ(beamAt(scan, -1.0), 0);
  EXPECT_EQ(beamAt(scan, 0.2), 2);
  EXPECT_EQ(beamAt(scan, 0.3), 3);
  EXPECT_EQ(beamAt(scan, 1.3), -1);
  EXPECT_EQ(beamAt(scan, -1.0 + 2.0 * M_PI), 0);
  const Scan clockwise{1.0, -0.5, {std::vector<float>(5, 1.0f)}, {}};
  EXPECT_EQ(beamAt(clockwise, 0.5), 1);
  EXPECT_EQ(beamAt(Scan(), 0.0), -1);
}

TEST(ScanSource, RoomHasWallsAndAMovingPillar) {
  RoomSource room;
  const auto scan = room.at(0);
  const auto range = [&](double degrees) { return scan->ranges[0][beamAt(*scan, degrees * M_PI / 180)]; };
  EXPECT_NEAR(range(0.0), 1.8, 1e-3);
  EXPECT_NEAR(range(90.0), 3.0, 1e-3);
  EXPECT_NEAR(range(180.0), 3.0, 1e-3);
  EXPECT_NEAR(scan->ranges[1][beamAt(*scan, 0.0)], 5.0, 1e-3);
  EXPECT_NEAR(room.at(10 * kSecond)->ranges[0][beamAt(*scan, 0.0)], 5.0, 1e-3);
}

TEST(BagSource, RealRecordingComesOutToTheMillimetre) {
  const std::string name = "rosbags_2d/hokuyo_721.bag", path = mapping_common::findRecording(name);
  if (path.empty()) GTEST_SKIP() << mapping_common::withoutRecording(name);
  const auto source = std::make_shared<BagSource>(path, "/scan");
  HokuyoDevice device(HokuyoOptions(), source);
  Host host(device);
  host.ask("MD0180090001005\n", kSecond);
  BagSource again(path, "/scan");
  const auto sent = device.takeSentScans();
  ASSERT_EQ(sent.size(), 5u);
  const Nanoseconds first = sent[0].start;
  again.at(first);
  for (const SentScan& scan : sent) {
    const auto expected = again.at(scan.start);
    for (std::size_t i = 0; i < 721; ++i) {
      const float range = expected->ranges[0][i];
      if (!(range >= 0.023f && range <= 60.0f)) continue;
      ASSERT_NEAR(scan.ranges[i] * 1e-3, range, 0.0005001) << i;
    }
  }
}

}  // namespace
}  // namespace device_emulators
