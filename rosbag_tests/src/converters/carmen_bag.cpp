// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_common/files.h>
#include <mapping_simulation/ros/conversions.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <mapping_simulation/ros/stamped.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag_tests/converters/carmen_bag.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <system_error>

namespace rosbag_tests {

using mapping_simulation::makeHeader;
using mapping_simulation::makeTransform;
using mapping_simulation::PlanarScan;
using mapping_simulation::TimedPose;
using mapping_simulation::toLaserScan;
using mapping_simulation::toPose;
using mapping_simulation::writeStaticTransforms;
using mapping_simulation::writeTum;

namespace {

using Kind = CarmenRecord::Kind;

using Stamps = CarmenBagOptions::Stamps;

/// Scans at the rate; lines between two get what lies between their stamps. The line after a scan that has
/// the pose logged with it is of the same time.
std::vector<double> madeUpStamps(const CarmenLog& log, double rate) {
  std::vector<double> stamps;
  std::size_t scans = 0;
  for (const CarmenRecord& record : log.records)
    stamps.push_back(record.kind == Kind::kFrontScan ? 1.0 + scans++ / rate
                                                     : std::numeric_limits<double>::quiet_NaN());
  std::size_t repaired = 0;
  stamps = risingStamps(stamps, repaired);
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const CarmenRecord &scan = log.records[i - 1], &line = log.records[i];
    if (scan.kind == Kind::kFrontScan && line.kind == Kind::kOdometry &&
        line.robot.isApprox(scan.robot, 1e-9))
      stamps[i] = stamps[i - 1];
  }
  return stamps;
}

/// Each scanner and the odometry were logged by a process of their own, whose lines may come late: only among
/// those of one kind do stamps have to rise.
std::vector<double> loggedStamps(const CarmenLog& log, Stamps clock, std::size_t& repaired_scans) {
  std::vector<double> stamps(log.records.size());
  repaired_scans = 0;
  for (const Kind kind : {Kind::kOdometry, Kind::kFrontScan, Kind::kRearScan}) {
    std::vector<std::size_t> indices;
    std::vector<double> logged;
    for (std::size_t i = 0; i < log.records.size(); ++i) {
      if (log.records[i].kind != kind) continue;
      indices.push_back(i);
      logged.push_back(clock == Stamps::kIpc ? log.records[i].ipc_stamp : log.records[i].logger_stamp);
    }
    std::size_t count = 0;
    const std::vector<double> rising = risingStamps(logged, count);
    if (kind != Kind::kOdometry) repaired_scans += count;
    for (std::size_t k = 0; k < indices.size(); ++k) stamps[indices[k]] = rising[k];
  }
  return stamps;
}

class Writer {
 public:
  Writer(const std::string& file, const CarmenLog& log, const CarmenBagOptions& options)
      : options_(options), bag_(file, rosbag::bagmode::Write), log_(log) {}

  void writeMounts(double stamp) {
    std::vector<geometry_msgs::TransformStamped> mounts;
    for (const Kind kind : {Kind::kFrontScan, Kind::kRearScan}) {
      for (const CarmenRecord& record : log_.records) {
        if (record.kind != kind) continue;
        mounts.push_back(makeTransform(ros::Time(stamp), options_.base_frame,
                                       options_.laser_frame + suffix(kind), log_.mount(kind)));
        break;
      }
    }
    writeStaticTransforms(bag_, ros::Time(stamp), mounts);
  }

  void writeOdometry(const CarmenRecord& record, double stamp) {
    tf2_msgs::TFMessage tf;
    tf.transforms.push_back(
        makeTransform(ros::Time(stamp), options_.odom_frame, options_.base_frame, record.robot));
    bag_.write("/tf", ros::Time(stamp), tf);
    nav_msgs::Odometry message;
    message.header = makeHeader(ros::Time(stamp), options_.odom_frame);
    message.child_frame_id = options_.base_frame;
    message.pose.pose = toPose(record.robot);
    message.twist.twist.linear.x = record.linear_velocity;
    message.twist.twist.angular.z = record.angular_velocity;
    bag_.write("/odom", ros::Time(stamp), message);
  }

  void writeScan(const CarmenRecord& record, double stamp) {
    PlanarScan scan = record.scan;
    scan.stamp = stamp;
    bag_.write(options_.scan_topic + suffix(record.kind), ros::Time(stamp),
               toLaserScan(scan, options_.laser_frame + suffix(record.kind)));
  }

  void close() { bag_.close(); }

 private:
  static std::string suffix(Kind kind) { return kind == Kind::kRearScan ? "_rear" : ""; }

  const CarmenBagOptions& options_;
  rosbag::Bag bag_;
  const CarmenLog& log_;
};

void check(double first, double last) {
  if (first <= 0.0 || last >= 4e9)
    throw std::runtime_error("the stamps go from " + std::to_string(first) + " to " + std::to_string(last) +
                             " s, expected 0 s to 4e9 s: another --offset, or stamps made up by --clock none "
                             "--rate HZ, are needed");
}

}  // namespace

CarmenBagSummary writeCarmenBag(const std::string& file, const CarmenLog& log,
                                const CarmenBagOptions& options, const std::string& stamps_file,
                                const std::string& reference_file,
                                const std::function<void(std::size_t)>& progress) {
  if (options.stamps == Stamps::kRate && !(options.rate > 0.0 && options.rate <= 1000.0))
    throw std::runtime_error("the rate must be in (0, 1000] Hz");
  CarmenBagSummary summary;
  const std::vector<double> stamps = options.stamps == Stamps::kRate
                                         ? madeUpStamps(log, options.rate)
                                         : loggedStamps(log, options.stamps, summary.repaired_scans);
  std::vector<std::size_t> order(stamps.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return stamps[a] < stamps[b]; });
  check(stamps[order.front()] + options.offset, stamps[order.back()] + options.offset);
  std::vector<TimedPose> reference;
  std::vector<std::pair<double, double>> changed;  // stamp, original
  const std::string part = file + ".part";
  try {
    Writer writer(part, log, options);
    writer.writeMounts(stamps[order.front()] + options.offset);
    for (const std::size_t i : order) {
      const CarmenRecord& record = log.records[i];
      const double stamp = stamps[i] + options.offset;
      const bool lines = options.odometry == CarmenBagOptions::Odometry::kLines;
      if (record.kind == (lines ? Kind::kOdometry : Kind::kFrontScan)) {
        writer.writeOdometry(record, stamp);
        ++summary.odometry;
      }
      if (!record.isScan()) continue;
      writer.writeScan(record, stamp);
      if (record.kind == Kind::kFrontScan) reference.push_back({stamp, record.robot});
      if (std::abs(stamp - record.ipc_stamp) >= 1e-6) changed.emplace_back(stamp, record.ipc_stamp);
      ++(record.kind == Kind::kFrontScan ? summary.scans : summary.rear_scans);
      if (progress) progress(summary.scans + summary.rear_scans);
    }
    writer.close();
    std::filesystem::rename(part, file);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
    throw;
  }
  if (!reference_file.empty()) writeTum(reference_file, reference);
  if (!stamps_file.empty()) {
    mapping_common::writeFile(stamps_file, [&](std::ostream& out) {
      out << "# stamp original\n" << std::fixed << std::setprecision(6);
      for (const auto& pair : changed) out << pair.first << ' ' << pair.second << '\n';
    });
  }
  return summary;
}

}  // namespace rosbag_tests
