// SPDX-License-Identifier: BSD-3-Clause
//
// The transforms are heard in the thread that adds messages: what arrives between a question and the request
// to be woken up can't be missed.
#include "mapping_common/transform_queue.h"

#include <ros/console.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "mapping_common/stamps.h"

namespace mapping_common {
namespace {

// tf2's own words, without the name of its function.
std::string quote(std::string why) {
  const std::string function = "canTransform: ";
  for (std::size_t at; (at = why.find(function)) != std::string::npos;) why.erase(at, function.size());
  return "tf says \"" + why.substr(0, why.find_last_not_of(' ') + 1) + '"';
}

}  // namespace

std::string withoutSlash(const std::string& frame) {
  return !frame.empty() && frame[0] == '/' ? frame.substr(1) : frame;
}

TransformQueue::TransformQueue(const ros::NodeHandle& node, const Options& options, Failed failed)
    : options_(options),
      failed_(std::move(failed)),
      callback_(buffer_.addTransformableCallback([this](auto&&...) { advance(); })) {
  for (std::string* frame : {&options_.target_frame, &options_.other_target, &options_.other_source})
    *frame = withoutSlash(*frame);
  if (!options_.needsTransforms()) return;
  ros::NodeHandle hearing(node);
  for (const bool is_static : {false, true}) {
    listeners_.push_back(hearing.subscribe<tf2_msgs::TFMessage>(
        is_static ? "/tf_static" : "/tf", 100,
        [this, is_static](const tf2_msgs::TFMessageConstPtr& message) { hear(*message, is_static); }));
  }
}

TransformQueue::~TransformQueue() {
  buffer_.removeTransformableCallback(callback_);
}

void TransformQueue::add(const std::string& sensor, const std_msgs::Header& header, bool with_other,
                         Ready ready, const SweepTimes& sweep) {
  if (!options_.target_frame.empty() && withoutSlash(header.frame_id).empty())
    throw std::invalid_argument("it has no frame_id");
  const double before = std::max(0.0, -sweep.first), after = std::max(0.0, sweep.last);
  if (before + after > 0.0 && before >= header.stamp.toSec())
    throw std::invalid_argument("its stamp is 0, which tells no moment of its sweep");
  Sequence& sequence = sequences_[sensor];
  sequence.items.push_back({header, header.stamp - ros::Duration(before), header.stamp + ros::Duration(after),
                            with_other && !options_.other_target.empty(), arrivals_++, std::move(ready)});
  sequence.newest = std::max(sequence.newest, header.stamp);
  ++waiting_;
  advance(sequence);
  while (waiting_ > options_.most) advance(oldest(), true);
  forgetEmpty();
}

// As tf2_ros::TransformListener, but for stamps that tf2 throws on, or believes to be the newest for ever.
void TransformQueue::hear(const tf2_msgs::TFMessage& message, bool is_static) {
  const ros::Time now = ros::Time::now();
  if (now < std::exchange(last_heard_, now)) buffer_.clear();
  for (const auto& transform : message.transforms) {
    if (transform.header.stamp.sec <= Stamps::kLastSecond) {
      buffer_.setTransform(transform, "tf", is_static);
    } else {
      ROS_WARN_STREAM_THROTTLE(10.0, "The transform "
                                         << transform.header.frame_id << " -> " << transform.child_frame_id
                                         << " is left out: its stamp is " << transform.header.stamp.sec
                                         << " s, after 2038");
    }
  }
}

std::size_t TransformQueue::restart() {
  // With simulated time hear() has cleared the buffer, which may have heard of new ones since.
  if (!ros::Time::isSimTime()) buffer_.clear();
  for (auto& [sensor, sequence] : sequences_) {
    for (const auto request : sequence.requests) buffer_.cancelTransformableRequest(request);
  }
  sequences_.clear();
  other_may_come_ = true;
  return std::exchange(waiting_, 0);
}

void TransformQueue::advance() {
  for (auto& [sensor, sequence] : sequences_) advance(sequence);
  forgetEmpty();
}

void TransformQueue::forgetEmpty() {
  for (auto s = sequences_.begin(); s != sequences_.end();) {
    s = s->second.items.empty() ? sequences_.erase(s) : std::next(s);
  }
}

// @param give_up the first message, whatever it waits for
void TransformQueue::advance(Sequence& sequence, bool give_up) {
  while (!sequence.items.empty()) {
    const Item& first = sequence.items.front();
    const std_msgs::Header& header = first.header;
    const bool is_late = give_up || sequence.newest - header.stamp >= ros::Duration(options_.timeout);
    std::string why;
    const bool has_frame = options_.target_frame.empty() || knowsFrame(first, &why);
    bool failed = !has_frame;
    if (!has_frame && !is_late && !isOvertaken(sequence, &TransformQueue::knowsFrame)) {
      return wakeUpWith(sequence, options_.target_frame, withoutSlash(header.frame_id));
    }
    bool has_other = false;
    if (has_frame && first.with_other) {
      has_other = knowsOther(first, &why);
      // At the start and after a jump of time, messages may be older than all transforms.
      const bool overtaken = !has_other && isOvertaken(sequence, &TransformQueue::knowsOther);
      if (!has_other && !overtaken && !is_late && (options_.needs_other || expectsOther(header.stamp))) {
        return wakeUpWith(sequence, options_.other_target, options_.other_source);
      }
      failed = overtaken || (options_.needs_other && !has_other);
    }

    const Item item = std::move(sequence.items.front());
    sequence.items.pop_front();
    --waiting_;
    give_up = false;
    if (failed) {
      failed_(quote(why));
      continue;
    }
    if (item.with_other) {
      why_no_other_ = has_other ? "" : quote(why);
      other_may_come_ = has_other;
      other_exists_ = other_exists_ || has_other;
    }
    item.ready(lookup(item, has_other));
  }
}

TransformQueue::Sequence& TransformQueue::oldest() {
  const auto age = [](const auto& entry) {
    return entry.second.items.empty() ? ~std::uint64_t{0} : entry.second.items.front().number;
  };
  return std::min_element(sequences_.begin(), sequences_.end(),
                          [&](const auto& a, const auto& b) { return age(a) < age(b); })
      ->second;
}

bool TransformQueue::isKnown(const std::string& target, const std::string& source, const Item& item,
                             std::string* why) const {
  const ros::Time& stamp = item.header.stamp;
  if (stamp.isZero()) return buffer_.canTransform(target, source, stamp, why);
  const ros::Time last = item.last + ros::Duration(options_.tolerance);
  return buffer_.canTransform(target, source, item.first, why) &&
         (last == item.first || buffer_.canTransform(target, source, last, why));
}

bool TransformQueue::knowsFrame(const Item& item, std::string* why) const {
  const std::string frame = withoutSlash(item.header.frame_id);
  return frame == options_.target_frame || isKnown(options_.target_frame, frame, item, why);
}

bool TransformQueue::knowsOther(const Item& item, std::string* why) const {
  return isKnown(options_.other_target, options_.other_source, item, why);
}

TransformQueue::Transforms TransformQueue::lookup(const Item& item, bool other) const {
  const auto find = [&](const std::string& target, const std::string& source) {
    return tf2::transformToEigen(buffer_.lookupTransform(target, source, item.header.stamp));
  };
  Transforms transforms;
  const std::string frame = withoutSlash(item.header.frame_id);
  if (!options_.target_frame.empty() && frame != options_.target_frame) {
    transforms.message = find(options_.target_frame, frame);
  }
  if (other) transforms.other = find(options_.other_target, options_.other_source);
  return transforms;
}

// Whether the first message won't get what it waits for, as a later one has it already.
bool TransformQueue::isOvertaken(const Sequence& sequence,
                                 bool (TransformQueue::*knows)(const Item&, std::string*) const) const {
  const ros::Time& first = sequence.items.front().header.stamp;
  return std::any_of(sequence.items.begin() + 1, sequence.items.end(), [&](const Item& item) {
    return item.header.stamp > first && (this->*knows)(item, nullptr);
  });
}

// One that was there shortly before the message goes on, one that never was or has ended isn't waited for.
bool TransformQueue::expectsOther(const ros::Time& stamp) const {
  if (other_may_come_) return true;
  if (!buffer_.canTransform(options_.other_target, options_.other_source, ros::Time(0))) return false;
  const ros::Time last =
      buffer_.lookupTransform(options_.other_target, options_.other_source, ros::Time(0)).header.stamp;
  return last.toSec() + options_.timeout > stamp.toSec();
}

// For the first message, or for the last, which has overtaken it then.
void TransformQueue::wakeUpWith(Sequence& sequence, const std::string& target, const std::string& source) {
  for (const auto request : std::exchange(sequence.requests, {})) buffer_.cancelTransformableRequest(request);
  for (const Item* item : {&sequence.items.front(), &sequence.items.back()}) {
    const bool any = item->header.stamp.isZero();
    sequence.requests.push_back(buffer_.addTransformableRequest(
        callback_, target, source, any ? ros::Time(0) : item->last + ros::Duration(options_.tolerance)));
  }
}

}  // namespace mapping_common
