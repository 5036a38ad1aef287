// SPDX-License-Identifier: BSD-3-Clause
//
// The nodelet's output against the core's, its parameters, its services, and bad input.
#include <dynamic_reconfigure/Reconfigure.h>
#include <laser_intensity_calib/calibration_file.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/message_fuzz.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/temp_dir.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <thread>

#include "laser_intensity_calib/incidence.h"
#include "laser_intensity_calib/ros/conversions.h"
#include "scans_of_a_wall.h"

namespace laser_intensity_calib {
namespace {

using mapping_common::Recorder;
using mapping_common::spinFor;
using mapping_common::waitFor;

class ReflectivityNodelet : public mapping_common::NodeletTest {
 protected:
  ReflectivityNodelet()
      : mapping_common::NodeletTest("laser_intensity_calib/ReflectivityNodelet", "reflectivity") {
    static const Calibration calibration = calibrate(observe(0.8, 10, 5000), FitOptions());
    calibration_ = calibration;
    saveCalibration(calibration_, file_);
    setParam("calibration_file", file_);
  }

  bool start() {
    if (!load()) return false;
    scans_ = node_.advertise<sensor_msgs::LaserScan>("scan", 100);
    clouds_ = node_.advertise<sensor_msgs::PointCloud2>("cloud", 100);
    return waitFor([this] { return scans_.getNumSubscribers() > 0 && clouds_.getNumSubscribers() > 0; });
  }

  sensor_msgs::LaserScan wall(double distance = 2.0) {
    std::mt19937 random(3);
    sensor_msgs::LaserScan scan = scanOfWall(distance, 0.2, 0.4, random);
    scan.header.stamp = ros::Time(100.0);
    return scan;
  }

  Eigen::ArrayXf expected(const sensor_msgs::LaserScan& scan, ModelType type = ModelType::kLut,
                          OutsidePolicy policy = OutsidePolicy::kDrop) const {
    const ScanArrays arrays = readScan(scan);
    ScanIncidence incidence;
    return reflectivity(calibration_, type, policy, arrays.ranges,
                        incidence.estimate(arrays.ranges, scan.angle_min, scan.angle_increment),
                        arrays.intensities);
  }

  /// The answer to a scan, which is told by a frame of its own from those to others that are on their way.
  sensor_msgs::LaserScan answer(sensor_msgs::LaserScan scan) {
    Recorder<sensor_msgs::LaserScan> results(node_, "scan_reflectivity");
    EXPECT_TRUE(waitFor([this] { return scans_.getNumSubscribers() > 0; }));
    EXPECT_TRUE(results.waitForLink());
    scan.header.frame_id = "laser" + std::to_string(++answers_);
    scans_.publish(scan);
    EXPECT_TRUE(waitFor([&] {
      return !results.messages.empty() && results.messages.back().header.frame_id == scan.header.frame_id;
    }));
    return results.messages.empty() ? sensor_msgs::LaserScan() : results.messages.back();
  }
  static void expectSame(const Eigen::ArrayXf& expected, const std::vector<float>& result) {
    ASSERT_EQ(static_cast<std::size_t>(expected.size()), result.size());
    for (std::size_t i = 0; i < result.size(); ++i) {
      ASSERT_EQ(std::isnan(expected[i]), std::isnan(result[i])) << i;
      if (std::isnan(result[i])) continue;
      ASSERT_NEAR(expected[i], result[i], 1e-4 * expected[i]) << i;
    }
  }

  std_srvs::Trigger::Response reload() {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::call(name_ + "/reload", trigger));
    EXPECT_FALSE(trigger.response.message.empty());
    return trigger.response;
  }
  void reconfigure(const std::string& parameter, const std::string& value) {
    dynamic_reconfigure::Reconfigure call;
    call.request.config.strs.resize(1);
    call.request.config.strs[0].name = parameter;
    call.request.config.strs[0].value = value;
    EXPECT_TRUE(ros::service::call(name_ + "/set_parameters", call));
  }

  mapping_common::TempDir dir_;
  const std::string file_ = dir_.path("calibration.yaml");
  Calibration calibration_;
  int answers_ = 0;
  ros::Publisher scans_, clouds_;
};

TEST_F(ReflectivityNodelet, SurvivesWhateverArrives) {
  ASSERT_TRUE(start());
  Recorder<sensor_msgs::PointCloud2> results(node_, "cloud_reflectivity");
  const sensor_msgs::LaserScan scan = wall();
  const sensor_msgs::PointCloud2 cloud =
      makeCloud({{2, 0, 0}, {2, 0.1, 0}, {2, 0, 0.1}, {2, 0.1, 0.1}}, {100, 110, 120, 130},
                std::vector<Eigen::Vector3f>(4, Eigen::Vector3f::Zero()));
  mapping_common::fuzz({"laser", "lidar"}, [&](mapping_common::MessageFuzz& fuzz) {
    if (fuzz.pick<int>({0, 1}) == 0) {
      sensor_msgs::LaserScan bad = scan;
      fuzz.spoil(bad);
      scans_.publish(bad);
    } else {
      sensor_msgs::PointCloud2 bad = cloud;
      fuzz.spoil(bad);
      clouds_.publish(bad);
    }
  });
  expectDiagnostic("Nodelet", "Callbacks that failed", "0");
  expectSame(expected(scan), answer(scan).intensities);
}

TEST_F(ReflectivityNodelet, GivesTheReflectivityOfScans) {
  ASSERT_TRUE(start());
  const sensor_msgs::LaserScan scan = wall();
  const sensor_msgs::LaserScan result = answer(scan);
  expectSame(expected(scan), result.intensities);
  EXPECT_EQ(scan.header.stamp, result.header.stamp);
  EXPECT_EQ("laser1", result.header.frame_id);
  EXPECT_EQ(scan.ranges, result.ranges);
  EXPECT_NEAR(0.5, result.intensities[270 + 40], 0.05);
  const long valid = (!expected(scan).isNaN()).count();
  expectDiagnostic("Reflectivity", "Beams with reflectivity", std::to_string(valid));
  expectDiagnostic("Reflectivity", "Model", "lut");
}

TEST_F(ReflectivityNodelet, GivesTheReflectivityOfClouds) {
  ASSERT_TRUE(start());
  std::vector<Eigen::Vector3f> points;
  std::vector<std::uint16_t> intensities;
  for (int y = -20; y <= 20; ++y) {
    for (int z = -20; z <= 20; ++z) {
      points.emplace_back(2.0F, 0.05F * y, 0.05F * z);
      const double range = points.back().norm();
      intensities.push_back(static_cast<std::uint16_t>(0.4 * response(range, std::acos(2.0 / range))));
    }
  }
  Recorder<sensor_msgs::PointCloud2> results(node_, "cloud_reflectivity");
  ASSERT_TRUE(results.waitForLink());
  clouds_.publish(makeCloud(points, intensities));
  ASSERT_TRUE(results.waitForOne());
  sensor_msgs::PointCloud2ConstIterator<float> value(results.messages[0], "reflectivity");
  int good = 0;
  for (std::size_t i = 0; i < points.size(); ++i, ++value) good += std::abs(*value - 0.5F) < 0.03F ? 1 : 0;
  EXPECT_GT(good, 1500) << "of " << points.size();
}

TEST_F(ReflectivityNodelet, TakesOffWhatTheLasersOfACloudAdd) {
  calibration_.offsets = {300.0F, -300.0F};
  saveCalibration(calibration_, file_);
  ASSERT_TRUE(start());
  std::vector<Eigen::Vector3f> points;
  std::vector<std::uint16_t> intensities, rings;
  for (int y = -20; y <= 20; ++y) {
    for (int z = -20; z <= 20; ++z) {
      points.emplace_back(2.0F, 0.05F * y, 0.05F * z);
      const double range = points.back().norm();
      rings.push_back(points.size() % 2);
      intensities.push_back(static_cast<std::uint16_t>(0.4 * response(range, std::acos(2.0 / range)) +
                                                       calibration_.offsets[rings.back()]));
    }
  }
  Recorder<sensor_msgs::PointCloud2> results(node_, "cloud_reflectivity");
  ASSERT_TRUE(results.waitForLink());
  const sensor_msgs::PointCloud2 cloud = makeCloud(points, intensities);
  clouds_.publish(cloud);  // without rings
  clouds_.publish(withRings(cloud, rings));
  ASSERT_TRUE(results.waitForOne());
  expectDiagnostic("Reflectivity", "Dropped: malformed", "1");
  sensor_msgs::PointCloud2ConstIterator<float> value(results.messages[0], "reflectivity");
  int good = 0;
  for (std::size_t i = 0; i < points.size(); ++i, ++value) good += std::abs(*value - 0.5F) < 0.03F ? 1 : 0;
  EXPECT_GT(good, 1500) << "of " << points.size();
}

TEST_F(ReflectivityNodelet, DropsBadMessagesAndGoesOn) {
  ASSERT_TRUE(start());
  sensor_msgs::LaserScan scan = wall(), bad = scan;
  bad.intensities.clear();
  scans_.publish(bad);
  bad = scan;
  bad.intensities.pop_back();
  scans_.publish(bad);
  scans_.publish(sensor_msgs::LaserScan());
  bad = scan;
  bad.angle_increment = std::numeric_limits<float>::quiet_NaN();
  scans_.publish(bad);
  clouds_.publish(sensor_msgs::PointCloud2());
  expectDiagnostic("Reflectivity", "Dropped: malformed", "5");
  expectSame(expected(scan), answer(scan).intensities);
}

TEST_F(ReflectivityNodelet, GoesOnWhenTimeJumpsBack) {
  ASSERT_TRUE(start());
  sensor_msgs::LaserScan scan = wall();
  expectSame(expected(scan), answer(scan).intensities);
  scan.header.stamp = ros::Time(1.0);
  EXPECT_EQ(ros::Time(1.0), answer(scan).header.stamp);
}

TEST_F(ReflectivityNodelet, ModelAndPolicyChangeWhileItRuns) {
  ASSERT_TRUE(start());
  const sensor_msgs::LaserScan scan = wall(0.25);  // partly nearer than what was calibrated
  ASSERT_GT((!expected(scan, ModelType::kLut, OutsidePolicy::kClamp).isNaN()).count(),
            (!expected(scan).isNaN()).count());
  expectSame(expected(scan), answer(scan).intensities);
  reconfigure("outside", "clamp");
  expectSame(expected(scan, ModelType::kLut, OutsidePolicy::kClamp), answer(scan).intensities);
  reconfigure("model", "raw");
  expectSame(expected(scan, ModelType::kRaw), answer(scan).intensities);
  reconfigure("model", "range");
  expectSame(expected(scan, ModelType::kRange, OutsidePolicy::kClamp), answer(scan).intensities);
  reconfigure("calibration_file", "/nowhere/none.yaml");
  expectDiagnostic("Reflectivity", "Calibration file", file_);
  expectSame(expected(scan, ModelType::kRange, OutsidePolicy::kClamp), answer(scan).intensities);
}

TEST_F(ReflectivityNodelet, ReloadsTheFileOrKeepsWhatItHas) {
  ASSERT_TRUE(start());
  const sensor_msgs::LaserScan scan = wall();
  const Calibration before = calibration_;
  dir_.write("calibration.yaml", "damaged");
  const std_srvs::Trigger::Response refused = reload();
  EXPECT_FALSE(refused.success);
  EXPECT_NE(std::string::npos, refused.message.find(file_)) << refused.message;
  expectSame(expected(scan), answer(scan).intensities);

  calibration_.table =
      LookupTable(before.table.range(), before.table.incidence(), 2.0F * before.table.values());
  saveCalibration(calibration_, file_);
  EXPECT_TRUE(reload().success);
  expectSame(expected(scan), answer(scan).intensities);
}

// Files come and go under it, good, damaged, and none; each scan gets one calibration or the other, whole.
TEST_F(ReflectivityNodelet, NoScanIsLostOrMixedWhileItReloads) {
  setParam("queue_size", 1000);
  ASSERT_TRUE(start());
  Calibration twice = calibration_;
  twice.table = LookupTable(twice.table.range(), twice.table.incidence(), 0.5F * twice.table.values());
  saveCalibration(twice, dir_.path("twice.yaml"));
  saveCalibration(calibration_, dir_.path("once.yaml"));
  const std::string good[] = {mapping_common::readFile(dir_.path("once.yaml")),
                              mapping_common::readFile(dir_.path("twice.yaml"))};
  const sensor_msgs::LaserScan scan = wall();
  const Eigen::ArrayXf once = expected(scan);

  Recorder<sensor_msgs::LaserScan> results(node_, "scan_reflectivity");
  ASSERT_TRUE(results.waitForLink());
  constexpr int kRounds = 12, kScans = 5;
  std::atomic<int> refused{0}, read{0};
  std::thread other([&] {
    for (int i = 0; i < kRounds; ++i) {
      const std::string& text = good[i / 2 % 2];
      if (i == 7)
        std::filesystem::remove(file_);
      else
        mapping_common::writeFile(file_, [&](std::ostream& out) {
          out << (i % 2 == 0 ? text : i % 4 == 1 ? text.substr(0, text.size() / 2) : std::string());
        });
      std_srvs::Trigger trigger;
      ros::service::call(name_ + "/reload", trigger);
      ++(trigger.response.success ? read : refused);
    }
  });
  for (int i = 0; i < kRounds * kScans; ++i) {
    scans_.publish(scan);
    spinFor(0.01);
  }
  other.join();
  EXPECT_TRUE(waitFor([&] { return results.messages.size() == kRounds * kScans; }));
  EXPECT_EQ(kRounds / 2, read);
  EXPECT_EQ(kRounds / 2, refused);
  for (const sensor_msgs::LaserScan& result : results.messages) {
    const Eigen::Map<const Eigen::ArrayXf> values(result.intensities.data(), result.intensities.size());
    const Eigen::ArrayXf ratio = (once.isNaN() || values.isNaN()).select(1.0F, values / once);
    const float first = values[270] / once[270];
    EXPECT_TRUE(std::abs(first - 1.0F) < 1e-3F || std::abs(first - 2.0F) < 1e-3F) << first;
    EXPECT_TRUE(((ratio - first).abs() < 1e-3F || once.isNaN()).all()) << "two calibrations in one scan";
  }
}

TEST_F(ReflectivityNodelet, PassesIntensitiesOnWithoutACalibration) {
  setParam("calibration_file", std::string());
  setParam("model", "raw");
  ASSERT_TRUE(start());
  const sensor_msgs::LaserScan scan = wall(), result = answer(scan);
  for (std::size_t i = 0; i < scan.ranges.size(); ++i) {
    if (std::isinf(scan.ranges[i])) {
      EXPECT_TRUE(std::isnan(result.intensities[i]));
    } else {
      EXPECT_EQ(scan.intensities[i], result.intensities[i]);
    }
  }
}

TEST_F(ReflectivityNodelet, SaysWhichParameterIsBad) {
  const auto bad = [this](const std::string& parameter, const auto& value, const auto& good) {
    setParam(parameter, value);
    const std::string why = whyNotLoaded();
    setParam(parameter, good);
    return why;
  };
  EXPECT_EQ("Not started: ~model is 'lambert', allowed is raw | range | lut", bad("model", "lambert", "lut"));
  EXPECT_EQ("Not started: ~scan/min_window is 2, allowed is 3 to 1000", bad("scan/min_window", 2, 7));
  EXPECT_EQ("Not started: ~cloud/leaf is -1, allowed is 0 to 100 m", bad("cloud/leaf", -1.0, 0.0));
  EXPECT_EQ(0u, bad("calibration_file", "/nowhere/none.yaml", file_)
                    .find("Not started: ~calibration_file: /nowhere/none.yaml"));
  EXPECT_EQ(0u, bad("calibration_file", "", file_).find("Not started: ~calibration_file is empty"));
  setParam("modell", "lut");
  EXPECT_EQ(0u, whyNotLoaded().find("Not started: unknown: ~modell"));
}

}  // namespace
}  // namespace laser_intensity_calib

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_reflectivity_nodelet");
  ros::NodeHandle node;
  return RUN_ALL_TESTS();
}
