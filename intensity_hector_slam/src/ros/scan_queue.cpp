// SPDX-License-Identifier: BSD-3-Clause
//
// The transforms are heard in the thread that adds scans: what arrives between a question and the request to
// be woken up can't be missed.
#include "intensity_hector_slam/ros/scan_queue.h"

#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <utility>

#include "intensity_hector_slam/ros/scan_conversion.h"

namespace intensity_hector_slam {

namespace {

constexpr std::size_t kMostWaiting = 1000;  // where stamps don't go on

// Without the name of tf2's function, and without the full stop that some of its sentences have.
std::string asClause(std::string why) {
  const std::string function = "canTransform: ";
  for (std::size_t at; (at = why.find(function)) != std::string::npos;) why.erase(at, function.size());
  return why.substr(0, why.find_last_not_of(". ") + 1);
}

}  // namespace

std::string withoutSlash(const std::string& frame) {
  return !frame.empty() && frame[0] == '/' ? frame.substr(1) : frame;
}

ScanQueue::ScanQueue(const ros::NodeHandle& node, const Options& options,
                     std::function<void(const Scan&, const Transforms&)> ready,
                     std::function<void(const Scan&, const std::string& why)> failed)
    : options_(options),
      ready_(std::move(ready)),
      failed_(std::move(failed)),
      callback_(buffer_.addTransformableCallback([this](auto&&...) { advance(); })),
      listener_(buffer_, node, false) {}

ScanQueue::~ScanQueue() {
  buffer_.removeTransformableCallback(callback_);
}

void ScanQueue::add(const ScanPointer& scan) {
  waiting_.push_back(scan);
  newest_ = std::max(newest_, scan->header.stamp);
  advance();
}

std::size_t ScanQueue::restart() {
  // With simulated time the buffer has cleared itself, and may have heard of new ones since.
  if (!ros::Time::isSimTime()) buffer_.clear();
  newest_ = {};
  body_may_come_ = true;
  return std::exchange(waiting_, {}).size();
}

void ScanQueue::advance() {
  while (!waiting_.empty()) {
    const ScanPointer scan = waiting_.front();
    const std_msgs::Header& header = scan->header;
    std::string why;
    const bool has_sensor = !options_.use_sensor_frame || knowsSensor(*scan, &why);
    bool failed = !has_sensor;
    if (!has_sensor && !header.frame_id.empty() && !isLate() && !isOvertaken(&ScanQueue::knowsSensor)) {
      return wakeUpWith(options_.base_frame, withoutSlash(header.frame_id));
    }
    bool has_body = false;
    if (has_sensor && !options_.fixed_frame.empty()) {
      has_body = knowsBody(*scan, &why);
      // At the start and after a jump of time, scans may be older than all odometry.
      const bool overtaken = !has_body && isOvertaken(&ScanQueue::knowsBody);
      if (!has_body && !overtaken && !isLate() && (options_.needs_body || expectsBody(header.stamp))) {
        return wakeUpWith(options_.fixed_frame, options_.base_frame);
      }
      failed = overtaken || (options_.needs_body && !has_body);
    }

    waiting_.pop_front();
    if (failed) {
      failed_(*scan, asClause(why));
    } else {
      why_no_body_ = asClause(why);
      body_may_come_ = has_body;
      body_exists_ = body_exists_ || has_body;
      ready_(*scan, lookup(*scan, has_body));
    }
  }
}

bool ScanQueue::knowsSensor(const Scan& scan, std::string* why) const {
  const std::string frame = withoutSlash(scan.header.frame_id);
  if (frame.empty() && why != nullptr) *why = "it has no frame_id";
  return !frame.empty() && (frame == options_.base_frame ||
                            buffer_.canTransform(options_.base_frame, frame, scan.header.stamp, why));
}

bool ScanQueue::knowsBody(const Scan& scan, std::string* why) const {
  return buffer_.canTransform(options_.fixed_frame, options_.base_frame, scan.header.stamp, why);
}

ScanQueue::Transforms ScanQueue::lookup(const Scan& scan, bool body) const {
  const auto find = [&](const std::string& target, const std::string& source) {
    return tf2::transformToEigen(buffer_.lookupTransform(target, source, scan.header.stamp));
  };
  Transforms transforms;
  if (options_.use_sensor_frame) {
    transforms.sensor_in_body = find(options_.base_frame, withoutSlash(scan.header.frame_id));
  }
  if (body) transforms.body = toPose(find(options_.fixed_frame, options_.base_frame));
  return transforms;
}

// Whether the first scan has waited for too long.
bool ScanQueue::isLate() const {
  return newest_ - waiting_.front()->header.stamp >= ros::Duration(options_.timeout) ||
         waiting_.size() > kMostWaiting;
}

// Whether it won't get what it waits for, as a later one has it already.
bool ScanQueue::isOvertaken(bool (ScanQueue::*knows)(const Scan&, std::string*) const) const {
  const ros::Time& first = waiting_.front()->header.stamp;
  return std::any_of(waiting_.begin() + 1, waiting_.end(), [&](const ScanPointer& scan) {
    return scan->header.stamp > first && (this->*knows)(*scan, nullptr);
  });
}

// One that was there shortly before the scan goes on, one that never was or has ended isn't waited for.
bool ScanQueue::expectsBody(const ros::Time& stamp) const {
  if (body_may_come_) return true;
  if (!buffer_.canTransform(options_.fixed_frame, options_.base_frame, ros::Time(0))) return false;
  const ros::Time last =
      buffer_.lookupTransform(options_.fixed_frame, options_.base_frame, ros::Time(0)).header.stamp;
  return last.toSec() + options_.timeout > stamp.toSec();
}

// For the first scan, or for the last, which has overtaken it then.
void ScanQueue::wakeUpWith(const std::string& target, const std::string& source) {
  for (const auto request : std::exchange(requests_, {})) buffer_.cancelTransformableRequest(request);
  for (const ScanPointer& scan : {waiting_.front(), waiting_.back()}) {
    requests_.push_back(buffer_.addTransformableRequest(callback_, target, source, scan->header.stamp));
  }
}

}  // namespace intensity_hector_slam
