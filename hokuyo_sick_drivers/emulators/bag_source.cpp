// SPDX-License-Identifier: BSD-3-Clause
#include "bag_source.h"

#include <algorithm>
#include <limits>
#include <set>
#include <stdexcept>

namespace device_emulators {
namespace {

bool isScan(const std::string& type) {
  return type == "sensor_msgs/LaserScan" || type == "sensor_msgs/MultiEchoLaserScan";
}

std::string withoutSlash(const std::string& name) {
  return name.rfind('/', 0) == 0 ? name.substr(1) : name;
}

std::string findTopic(const rosbag::Bag& bag, const std::string& wanted) {
  std::set<std::string> fitting;
  std::string all;
  for (const rosbag::ConnectionInfo* connection : rosbag::View(bag).getConnections()) {
    all += "\n  " + connection->topic + " (" + connection->datatype + ")";
    if (isScan(connection->datatype) &&
        (wanted.empty() || withoutSlash(wanted) == withoutSlash(connection->topic)))
      fitting.insert(connection->topic);
  }
  if (fitting.size() == 1) return *fitting.begin();
  throw std::runtime_error(bag.getFileName() + ": expected one topic" + (wanted.empty() ? "" : " " + wanted) +
                           " of LaserScan or MultiEchoLaserScan, found " + std::to_string(fitting.size()) +
                           "; the bag holds:" + (all.empty() ? " nothing" : all));
}

void checkBeams(std::size_t ranges, std::size_t intensities) {
  if (intensities != 0 && intensities != ranges)
    throw std::runtime_error("scan of " + std::to_string(ranges) + " ranges and " +
                             std::to_string(intensities) + " intensities");
}

// echo by echo, NaN where a beam has none
std::vector<std::vector<float>> byEcho(const std::vector<sensor_msgs::LaserEcho>& beams) {
  std::size_t echoes = 1;
  for (const auto& beam : beams) echoes = std::max(echoes, beam.echoes.size());
  std::vector<std::vector<float>> values(
      echoes, std::vector<float>(beams.size(), std::numeric_limits<float>::quiet_NaN()));
  for (std::size_t i = 0; i < beams.size(); ++i)
    for (std::size_t echo = 0; echo < beams[i].echoes.size(); ++echo) values[echo][i] = beams[i].echoes[echo];
  return values;
}

}  // namespace

Scan toScan(const sensor_msgs::LaserScan& message) {
  checkBeams(message.ranges.size(), message.intensities.size());
  Scan scan{message.angle_min, message.angle_increment, {message.ranges}, {}};
  if (!message.intensities.empty()) scan.intensities.push_back(message.intensities);
  return scan;
}

Scan toScan(const sensor_msgs::MultiEchoLaserScan& message) {
  checkBeams(message.ranges.size(), message.intensities.size());
  Scan scan{message.angle_min, message.angle_increment, byEcho(message.ranges), {}};
  if (!message.intensities.empty()) {
    scan.intensities = byEcho(message.intensities);
    scan.intensities.resize(scan.ranges.size(), std::vector<float>(message.ranges.size(), 0.0f));
  }
  return scan;
}

BagSource::BagSource(const std::string& file, const std::string& topic) {
  try {
    bag_.open(file, rosbag::bagmode::Read);
  } catch (const rosbag::BagUnindexedException&) {
    throw std::runtime_error(file + ": bag without an index, run `rosbag reindex` on it");
  } catch (const rosbag::BagException& e) {
    throw std::runtime_error(file + ": " + e.what());
  }
  topic_ = findTopic(bag_, topic);
  view_ = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(topic_));
  if (view_->size() == 0) throw std::runtime_error(file + ": no message on " + topic_);

  first_stamp_ = read(*view_->begin()).time;
  Nanoseconds last_stamp = first_stamp_;
  rosbag::View end(bag_, rosbag::TopicQuery(topic_), view_->getEndTime(), view_->getEndTime());
  for (const rosbag::MessageInstance& message : end) last_stamp = std::max(last_stamp, read(message).time);
  const Nanoseconds duration = last_stamp - first_stamp_;
  const auto scans = static_cast<Nanoseconds>(view_->size());
  period_ = scans > 1 ? duration + duration / (scans - 1) : kSecond;
  if (period_ <= 0) throw std::runtime_error(file + ": all stamps of " + topic_ + " are the same");

  next_message_ = view_->begin();
  next_ = read(*next_message_);
  next_.time -= first_stamp_;
  advance();
}

BagSource::Stamped BagSource::read(const rosbag::MessageInstance& message) const {
  const auto stamped = [&](const auto& scan) {
    const ros::Time stamp = scan->header.stamp.isZero() ? message.getTime() : scan->header.stamp;
    return Stamped{static_cast<Nanoseconds>(stamp.toNSec()), std::make_shared<Scan>(toScan(*scan))};
  };
  try {
    if (const auto scan = message.instantiate<sensor_msgs::LaserScan>()) return stamped(scan);
    if (const auto scan = message.instantiate<sensor_msgs::MultiEchoLaserScan>()) return stamped(scan);
  } catch (const std::exception& e) {
    throw std::runtime_error(bag_.getFileName() + ": " + topic_ + ": " + e.what());
  }
  throw std::runtime_error(bag_.getFileName() + ": " + topic_ + ": not a scan");
}

void BagSource::advance() {
  current_ = next_;
  if (++next_message_ == view_->end()) {
    next_message_ = view_->begin();
    loop_start_ += period_;
  }
  next_ = read(*next_message_);
  // Stamps that are out of order don't stop the replay.
  next_.time = std::max(next_.time - first_stamp_ + loop_start_, current_.time);
}

std::shared_ptr<const Scan> BagSource::at(Nanoseconds time) {
  if (!start_) start_ = time;
  const Nanoseconds elapsed = time - *start_;
  while (next_.time - elapsed < elapsed - current_.time || next_.time <= elapsed) advance();
  return current_.scan;
}

}  // namespace device_emulators
