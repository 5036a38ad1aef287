// SPDX-License-Identifier: BSD-3-Clause
#include <geometry_msgs/PoseStamped.h>
#include <mapping_simulation/ros/conversions.h>
#include <mapping_simulation/ros/stamped.h>
#include <rosbag_tests/converters/scan_bag_writer.h>
#include <rosgraph_msgs/Clock.h>
#include <tf2_msgs/TFMessage.h>

#include <cmath>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <system_error>

namespace rosbag_tests {

using mapping_simulation::makeHeader;
using mapping_simulation::makeTransform;
using mapping_simulation::PosedScan;
using mapping_simulation::toPointCloud2;
using mapping_simulation::toPose;
using mapping_simulation::writeStaticTransforms;

namespace {

const ros::Duration kLead(1.0);           // of /clock before the first scan and after the last
const ros::Duration kTick(0, 10000000);   // 100 Hz
const ros::Duration kMargin(0, 1000000);  // of /tf around a scan

std::string absolute(const std::string& topic) {
  return topic.rfind('/', 0) == 0 ? topic : "/" + topic;
}

}  // namespace

ScanBagWriter::ScanBagWriter(const std::string& file, const ScanBagOptions& options)
    : file_(file), part_(file + ".part"), options_(options) {
  const std::set<std::string> frames{options.map_frame, options.odom_frame, options.base_frame,
                                     options.sensor_frame};
  if (frames.size() != 4 || frames.count("") != 0)
    throw std::runtime_error(file + ": the map, odom, base and sensor frames need names of their own");
  bag_.open(part_, rosbag::bagmode::Write);
  open_ = true;
}

ScanBagWriter::~ScanBagWriter() {
  if (!open_) return;
  try {
    bag_.close();
  } catch (const std::exception&) {
    // The bag is thrown away in any case.
  }
  std::error_code ignored;
  std::filesystem::remove(part_, ignored);
}

void ScanBagWriter::write(const PosedScan& scan) {
  const double seconds = scan.stamp + options_.stamp_offset;
  if (!(seconds > kLead.toSec() && seconds < 4e9))
    throw std::runtime_error(scan.name + ": stamp " + std::to_string(seconds) + " s, expected 1 s to 4e9 s");
  const ros::Time stamp(seconds);
  if (!last_stamp_.isZero() && stamp <= last_stamp_ + kMargin + kMargin)
    throw std::runtime_error(scan.name + ": stamp " + std::to_string(seconds) +
                             " s, expected more than 2 ms after the scan before");

  const Eigen::Isometry3d base = scan.pose * options_.base_to_sensor.inverse();
  if (last_stamp_.isZero()) start(stamp - kLead, base);
  writeClock(stamp);
  writeTransforms(stamp - kMargin, {stamp - kMargin, stamp, stamp + kMargin}, base);
  geometry_msgs::PoseStamped truth;
  truth.header = makeHeader(stamp, options_.map_frame);
  truth.pose = toPose(base);
  bag_.write(absolute(options_.pose_topic), stamp, truth);
  bag_.write(absolute(options_.cloud_topic), stamp,
             toPointCloud2(scan.cloud, makeHeader(stamp, options_.sensor_frame)));
  last_stamp_ = stamp;
}

void ScanBagWriter::close() {
  if (!last_stamp_.isZero()) writeClock(last_stamp_ + kLead);
  bag_.close();
  std::filesystem::rename(part_, file_);
  open_ = false;
}

void ScanBagWriter::start(const ros::Time& time, const Eigen::Isometry3d& base) {
  next_clock_ = time;
  writeStaticTransforms(
      bag_, time, {makeTransform(time, options_.base_frame, options_.sensor_frame, options_.base_to_sensor)});
  writeTransforms(time, {time}, base);
}

void ScanBagWriter::writeTransforms(const ros::Time& time, const std::vector<ros::Time>& stamps,
                                    const Eigen::Isometry3d& base) {
  tf2_msgs::TFMessage message;
  for (const ros::Time& stamp : stamps) {
    message.transforms.push_back(
        makeTransform(stamp, options_.map_frame, options_.odom_frame, options_.map_to_odom));
    message.transforms.push_back(makeTransform(stamp, options_.odom_frame, options_.base_frame,
                                               options_.map_to_odom.inverse() * base));
  }
  bag_.write("/tf", time, message);
}

void ScanBagWriter::writeClock(const ros::Time& until) {
  for (; next_clock_ <= until; next_clock_ += kTick) {
    rosgraph_msgs::Clock clock;
    clock.clock = next_clock_;
    bag_.write("/clock", next_clock_, clock);
  }
}

}  // namespace rosbag_tests
