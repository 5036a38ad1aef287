// SPDX-License-Identifier: BSD-3-Clause
//
// The tool from end to end, on bags of a scanner whose f(r, alpha) is known.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>

#include "laser_intensity_calib/calibration_file.h"
#include "laser_intensity_calib/incidence.h"
#include "laser_intensity_calib/ros/bag_samples.h"
#include "laser_intensity_calib/ros/conversions.h"
#include "scans_of_a_wall.h"

namespace laser_intensity_calib {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

class Calibrate : public mapping_common::ToolTest {
 protected:
  Calibrate() : ToolTest(CALIBRATE) {}
  void SetUp() override {
    // A white wall, from all distances, at changing angles.
    rosbag::Bag bag(bag_, rosbag::bagmode::Write);
    std::mt19937 random(1);
    for (int i = 0; i < 300; ++i) {
      sensor_msgs::LaserScan scan = scanOfWall(0.4 + 5.0 * i / 300.0, 0.6 * std::sin(0.7 * i), 0.8, random);
      scan.header.stamp = ros::Time(10.0 + 0.1 * i);
      bag.write("/scan", scan.header.stamp, scan);
    }
    bag.write("/note", ros::Time(10.0), tf2_msgs::TFMessage());
  }

  const std::string bag_ = dir_.path("wall.bag"), out_ = dir_.path("calibration.yaml");
};

// Of a surface of half the reflectivity, from poses that weren't part of the calibration.
TEST_F(Calibrate, TheTableGivesTheReflectivityOfAnotherSurface) {
  ASSERT_EQ(0, run("--bag " + bag_ + " --topic scan --out " + out_ + " --scanner simulated --reference wall"))
      << output();
  const Calibration c = loadCalibration(out_);
  EXPECT_EQ("simulated", c.scanner);
  EXPECT_EQ("wall", c.reference);
  EXPECT_EQ("wall.bag scan", c.source);
  EXPECT_LT(c.residuals[2].rms, 0.08);
  EXPECT_LT(c.residuals[2].median, 0.03);
  std::mt19937 random(77);
  ScanIncidence incidence;
  std::vector<float> errors;
  std::size_t beams = 0;
  for (const double distance : {0.83, 1.7, 3.1}) {
    for (const double turn : {-0.5, 0.05, 0.4}) {
      const sensor_msgs::LaserScan scan = scanOfWall(distance, turn, 0.4, random);
      const ScanArrays arrays = readScan(scan);
      const Eigen::ArrayXf result = reflectivity(
          c, ModelType::kLut, OutsidePolicy::kDrop, arrays.ranges,
          incidence.estimate(arrays.ranges, scan.angle_min, scan.angle_increment), arrays.intensities);
      beams += (!arrays.ranges.isNaN()).count();
      for (Eigen::Index i = 0; i < result.size(); ++i) {
        if (!std::isnan(result[i])) errors.push_back(std::abs(result[i] / 0.5F - 1.0F));
      }
    }
  }
  EXPECT_GT(errors.size(), 0.85 * beams);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.03) << "median";
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.08) << "nine tenths";
}

TEST_F(Calibrate, ReportsWhatItSawAndWhatIsMissing) {
  ASSERT_EQ(0, run("--bag " + bag_ + " --topic /scan --plane --out " + out_ + " --report " +
                   dir_.path("report") + " __name:=calibrate"))
      << output();
  EXPECT_TRUE(mentions(output(), {"samples of 300 scans", "range, degree", "lut", "#"}));
  EXPECT_GT(std::filesystem::file_size(dir_.path("report/cells.csv")), 1000u);
  EXPECT_GT(std::filesystem::file_size(dir_.path("report/samples.csv")), 1000u);
  if (output().find("no figures were drawn") == std::string::npos) {
    EXPECT_GT(std::filesystem::file_size(dir_.path("report/calibration.png")), 10000u);
  }

  ASSERT_EQ(0, run("--bag " + bag_ + " --topic scan --step 4 --beams 250:290 --out " + out_)) << output();
  EXPECT_TRUE(mentions(output(), {"samples of 75 scans", "No samples at", "beyond"}));
}

TEST_F(Calibrate, TakesTheBeamsInABoxOfAnotherFrame) {
  {
    rosbag::Bag bag(bag_, rosbag::bagmode::Append);
    tf2_msgs::TFMessage tf;
    geometry_msgs::TransformStamped transform;
    transform.header.frame_id = "map";
    transform.child_frame_id = "laser";
    transform.transform.translation.x = 100.0;
    transform.transform.rotation.w = 1.0;
    for (const double time : {12.0, 100.0}) {
      transform.header.stamp = ros::Time(time);
      tf.transforms.push_back(transform);
    }
    bag.write("/tf", ros::Time(10.0), tf);
  }
  BagSamplesOptions options;
  options.topic = "scan";
  options.region.frame = "map";
  options.region.box.emplace(Eigen::Vector3d(101, -1, -1), Eigen::Vector3d(103, 1, 1));
  BagSamplesReport report;
  const std::vector<Sample> samples = collectSamples(bag_, options, report);
  EXPECT_EQ(300u, report.messages);
  EXPECT_EQ(20u, report.without_transform) << "before the first";
  EXPECT_TRUE(mentions(report.last_problem, {"map"}));
  ASSERT_GT(samples.size(), 1000u);
  for (const Sample& s : samples) ASSERT_TRUE(s.range > 0.99F && s.range < 3.2F) << s.range;
}

TEST_F(Calibrate, FindsThePlaneInClouds) {
  {
    rosbag::Bag bag(bag_, rosbag::bagmode::Append);
    std::mt19937 random(2);
    std::uniform_real_distribution<float> uniform(-1.0F, 1.0F);
    for (int scan = 0; scan < 4; ++scan) {
      const float distance = 1.5F + 0.5F * scan;
      std::vector<Eigen::Vector3f> points;
      std::vector<std::uint16_t> intensities;
      for (int i = 0; i < 3000; ++i) {
        points.emplace_back(distance, 2.0F * uniform(random), uniform(random));
        const double range = points.back().norm();
        intensities.push_back(static_cast<std::uint16_t>(response(range, std::acos(distance / range))));
      }
      for (int i = 0; i < 500; ++i) {
        points.emplace_back(5.0F * uniform(random), 5.0F * uniform(random), 5.0F * uniform(random));
        intensities.push_back(9);
      }
      bag.write("/cloud", ros::Time(20.0 + scan), makeCloud(points, intensities));
    }
  }
  BagSamplesOptions options;
  options.topic = "/cloud";
  options.region.plane = true;
  options.region.plane_tolerance = 0.02;
  BagSamplesReport report;
  const std::vector<Sample> samples = collectSamples(bag_, options, report);
  EXPECT_GE(report.in_region, 12000u);
  EXPECT_LT(report.in_region, 12200u);
  ASSERT_GT(samples.size(), 10000u);
  int good = 0;
  for (const Sample& s : samples)
    good += std::abs(s.intensity / response(s.range, s.incidence) - 1.0) < 0.05 ? 1 : 0;
  EXPECT_GT(good, 0.95 * samples.size());
}

TEST_F(Calibrate, FitsWhatTheLasersOfACloudAdd) {
  {
    rosbag::Bag bag(bag_, rosbag::bagmode::Append);
    for (int scan = 0; scan < 20; ++scan) {
      const float distance = 1.0F + 0.15F * scan;
      std::vector<Eigen::Vector3f> points;
      std::vector<std::uint16_t> intensities, rings;
      for (int y = -20; y <= 20; ++y) {
        for (int z = -20; z <= 20; ++z) {
          points.emplace_back(distance, 0.06F * y, 0.06F * z);
          const double range = points.back().norm();
          rings.push_back(points.size() % 2);
          intensities.push_back(static_cast<std::uint16_t>(response(range, std::acos(distance / range)) +
                                                           (rings.back() == 0 ? 250.0 : 50.0)));
        }
      }
      bag.write("/lidar", ros::Time(20.0 + scan), withRings(makeCloud(points, intensities), rings));
    }
  }
  ASSERT_EQ(0, run("--bag " + bag_ + " --topic lidar --offsets --out " + out_)) << output();
  EXPECT_TRUE(mentions(output(), {"Offsets of 2 lasers: -"}));
  const Calibration c = loadCalibration(out_);
  ASSERT_EQ(2u, c.offsets.size());
  EXPECT_NEAR(200.0, c.offsets[0] - c.offsets[1], 10.0);
  EXPECT_EQ(1, run("--bag " + bag_ + " --topic scan --offsets --out " + out_));
  EXPECT_TRUE(mentions(output(), {"field ring"}));
}

// Scans across the way, each of one line of the wall: only together they show how it leans.
TEST_F(Calibrate, PutsPushBroomScansTogether) {
  const double lean = 0.5;  // the wall's normal towards the way
  {
    rosbag::Bag bag(bag_, rosbag::bagmode::Append);
    tf2_msgs::TFMessage tf;
    for (int i = 0; i < 100; ++i) {
      geometry_msgs::TransformStamped transform;
      transform.header.frame_id = "map";
      transform.child_frame_id = "laser";
      transform.header.stamp = ros::Time(200.0 + 0.1 * i);
      transform.transform.translation.z = 0.01 * i;  // along the scanner's axis
      transform.transform.rotation.w = 1.0;
      tf.transforms.push_back(transform);
      std::mt19937 random(i);
      sensor_msgs::LaserScan scan = scanOfWall(2.0 - 0.01 * i * std::tan(lean), 0.0, 0.8, random, 0.001);
      scan.header.stamp = transform.header.stamp;
      bag.write("/broom", scan.header.stamp, scan);
    }
    bag.write("/tf", ros::Time(200.0), tf);
  }
  BagSamplesOptions options;
  options.topic = "/broom";
  options.accumulate = 50;
  options.region.frame = "map";
  options.region.box.emplace(Eigen::Vector3d(0, -0.05, -1), Eigen::Vector3d(3, 0.05, 2));
  options.cloud.neighbors = 30;
  BagSamplesReport report;
  const std::vector<Sample> samples = collectSamples(bag_, options, report);
  ASSERT_GT(samples.size(), 200u);
  double mean = 0.0;
  for (const Sample& s : samples) mean += s.incidence / static_cast<double>(samples.size());
  EXPECT_NEAR(lean, mean, 0.03);
  options.region.frame.clear();
  EXPECT_THROW(collectSamples(bag_, options, report), std::invalid_argument);
}

// Bags that users have.
TEST_F(Calibrate, SaysWhatIsWrongWithTheScans) {
  const auto write = [this](const std::string& topic,
                            const std::function<void(sensor_msgs::LaserScan&)>& change) {
    rosbag::Bag bag(bag_, rosbag::bagmode::Append);
    std::mt19937 random(1);
    for (int i = 0; i < 60; ++i) {
      sensor_msgs::LaserScan scan = scanOfWall(0.5 + 0.05 * i, 0.6 * std::sin(0.7 * i), 0.8, random);
      scan.header.stamp = ros::Time(100.0 + 0.1 * i);
      change(scan);
      bag.write(topic, scan.header.stamp, scan);
    }
  };
  const std::string tool = "--bag " + bag_ + " --out " + out_ + " --topic ";
  write("/bare", [](auto& scan) { scan.intensities.clear(); });
  EXPECT_EQ(1, run(tool + "bare"));
  EXPECT_TRUE(mentions(output(), {"none of the 60 messages can be used", "no intensities"}));
  write("/dark", [](auto& scan) { scan.intensities.assign(scan.ranges.size(), 0.0F); });
  EXPECT_EQ(1, run(tool + "dark"));
  EXPECT_TRUE(mentions(output(), {"intensities", "are 0"}));
  write("/blind", [](auto& scan) { scan.ranges.assign(scan.ranges.size(), std::nanf("")); });
  EXPECT_EQ(1, run(tool + "blind"));
  EXPECT_TRUE(mentions(output(), {"no beam is on"}));
  write("/dotted", [](auto& scan) {
    for (std::size_t i = 0; i < scan.ranges.size(); ++i)
      if (i % 3 != 0) scan.ranges[i] = std::nanf("");
  });
  EXPECT_EQ(1, run(tool + "dotted"));
  EXPECT_TRUE(mentions(output(), {"angle of incidence", "--min-window"}));
  EXPECT_EQ(1, run(tool + "scan --frame map"));
  EXPECT_TRUE(mentions(output(), {"none of the 300 messages has a transform", "map"}));
  EXPECT_FALSE(std::filesystem::exists(out_));

  write("/constant", [](auto& scan) { scan.intensities.assign(scan.ranges.size(), 47.0F); });
  EXPECT_EQ(0, run(tool + "constant"));
  EXPECT_TRUE(mentions(output(), {"100 % of the samples have the intensity 47", "no intensities"}));
  EXPECT_EQ(1, run(tool + "scan --beams 270:270"));
  EXPECT_TRUE(mentions(output(), {"300 samples are too few, or too much alike", "--min-samples"}))
      << "one beam";
}

TEST_F(Calibrate, AReversedScanGivesTheSame) {
  {
    rosbag::Bag in(bag_), out(dir_.path("reversed.bag"), rosbag::bagmode::Write);
    for (const auto& message : rosbag::View(in, rosbag::TopicQuery("/scan"))) {
      sensor_msgs::LaserScan scan = *message.instantiate<sensor_msgs::LaserScan>();
      std::reverse(scan.ranges.begin(), scan.ranges.end());
      std::reverse(scan.intensities.begin(), scan.intensities.end());
      std::swap(scan.angle_min, scan.angle_max);
      scan.angle_increment = -scan.angle_increment;
      out.write("/scan", scan.header.stamp, scan);
    }
  }
  BagSamplesOptions options;
  options.topic = "scan";
  BagSamplesReport report;
  const Calibration c = calibrate(collectSamples(bag_, options, report), FitOptions()),
                    reversed =
                        calibrate(collectSamples(dir_.path("reversed.bag"), options, report), FitOptions());
  ASSERT_EQ(c.table.values().rows(), reversed.table.values().rows());
  EXPECT_NEAR(c.samples, reversed.samples, 0.001 * c.samples);
  EXPECT_NEAR(c.residuals[2].rms, reversed.residuals[2].rms, 0.001);
  for (float r = 0.6F; r < 5.0F; r += 0.2F)
    EXPECT_NEAR(1.0,
                reversed.at(ModelType::kLut, r, 0.5F).intensity / c.at(ModelType::kLut, r, 0.5F).intensity,
                0.005);
}

TEST_F(Calibrate, SaysWhatIsWrong) {
  const std::string ok = "--bag " + bag_ + " --out " + out_ + " --topic scan ";
  EXPECT_EQ(0, run("--help"));
  EXPECT_EQ(2, run(""));
  EXPECT_EQ(2, run(ok + "--beam 1:2"));
  EXPECT_EQ(2, run(ok + "--beams 20:10"));
  EXPECT_TRUE(mentions(output(), {"--beams is 20:10"}));
  EXPECT_EQ(2, run(ok + "--beams 1:x"));
  EXPECT_EQ(2, run(ok + "--box 1,2,3,4,5"));
  EXPECT_EQ(2, run(ok + "--box 1,2,3,0,5,6"));
  EXPECT_EQ(2, run(ok + "--range-step 0"));
  EXPECT_TRUE(mentions(output(), {"--range-step is 0, allowed is 0.001 to 100 m"}));
  EXPECT_EQ(1, run("--bag /nowhere.bag --out " + out_ + " --topic scan"));
  EXPECT_TRUE(mentions(output(), {"/nowhere.bag"}));
  EXPECT_EQ(1, run("--bag " + dir_.write("foreign.bag", "no bag") + " --out " + out_ + " --topic scan"));
  EXPECT_EQ(1, run("--bag " + bag_ + " --out " + out_ + " --topic laser"));
  EXPECT_TRUE(mentions(output(), {"no topic laser", "/scan"}));
  EXPECT_EQ(1, run("--bag " + bag_ + " --out " + out_ + " --topic note"));
  EXPECT_TRUE(mentions(output(), {"TFMessage"}));
  EXPECT_EQ(1, run(ok + "--box 50,50,50,51,51,51"));
  EXPECT_TRUE(mentions(output(), {"no beam is on the reference surface"}));
  EXPECT_EQ(1, run("--bag " + bag_ + " --out /nowhere/c.yaml --topic scan"));
  EXPECT_TRUE(mentions(output(), {"no folder /nowhere"}));
  EXPECT_FALSE(std::filesystem::exists(out_));
}

}  // namespace
}  // namespace laser_intensity_calib
