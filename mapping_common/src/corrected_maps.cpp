// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/corrected_maps.h"

#include <tf2_eigen/tf2_eigen.h>

#include <chrono>
#include <cmath>
#include <exception>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "mapping_common/stamps.h"
#include "mapping_common/transform_queue.h"

namespace mapping_common {
namespace {

constexpr double kPollPeriod = 0.05;     // s
constexpr std::size_t kMostWaiting = 4;  // maps, which may be large
constexpr double kFarthest = 1e6;        // m that a correction may move a map

}  // namespace

CorrectedMaps::CorrectedMaps(ros::NodeHandle& node, const std::string& topic,
                             std::shared_ptr<CallbackGuard> guard, const std::string& name,
                             const std::string& frame, Begin begin)
    : name_(name), frame_(withoutSlash(frame)), begin_(std::move(begin)) {
  subscriber_ = node.subscribe(topic, kMostWaiting, &CorrectedMaps::arrived, this);
  timer_ = node.createWallTimer(
      ros::WallDuration(kPollPeriod),
      [this, guard = std::move(guard)](const ros::WallTimerEvent&) { guard->run([this] { poll(); }); });
}

void CorrectedMaps::arrived(const mapping_msgs::CorrectedMapConstPtr& message) {
  if (waiting_.size() >= kMostWaiting) return refuse("too many wait already");
  waiting_.push_back(message);
  startNext();
}

void CorrectedMaps::startNext() {
  while (!running_.valid() && !waiting_.empty()) {
    const mapping_msgs::CorrectedMapConstPtr message = waiting_.front();
    waiting_.pop_front();
    try {
      running_ =
          std::async(std::launch::async, [message, prepare = begin_(read(*message))] { return prepare(); });
    } catch (const std::exception& e) {
      refuse(e.what());
    }
  }
}

CorrectedMaps::Map CorrectedMaps::read(const mapping_msgs::CorrectedMap& message) const {
  if (withoutSlash(message.header.frame_id) != frame_)
    throw std::invalid_argument("its frame is '" + message.header.frame_id + "', the map's is '" + frame_ +
                                '\'');
  Map map;
  tf2::fromMsg(message.correction, map.correction);
  const auto& q = message.correction.orientation;
  if (!map.correction.matrix().allFinite() ||
      !(std::abs(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1.0) < 1e-3))
    throw std::invalid_argument(
        "its correction is no pose: it isn't finite, or its quaternion not of length 1");
  if (!(map.correction.translation().norm() <= kFarthest)) {
    std::ostringstream text;
    text << "its correction is by " << map.correction.translation().norm() << " m, allowed is up to "
         << kFarthest << " m";
    throw std::invalid_argument(text.str());
  }
  Stamps::require(message.header.stamp, "its stamp");
  Stamps::require(message.corrected_from, "its corrected_from");
  map.stamp = message.header.stamp.toSec();
  map.corrected_from = message.corrected_from.isZero() ? std::numeric_limits<double>::infinity()
                                                       : message.corrected_from.toSec();
  map.begin = reinterpret_cast<const char*>(message.data.data());
  map.end = map.begin + message.data.size();
  return map;
}

void CorrectedMaps::poll() {
  if (!running_.valid() || running_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  try {
    const std::string text = running_.get()();
    ++taken_;
    ROS_INFO_STREAM(name_ << ": goes on in a corrected map. " << text);
  } catch (const std::exception& e) {
    refuse(e.what());
  }
  startNext();
}

void CorrectedMaps::refuse(const std::string& why) {
  ++refused_;
  ROS_ERROR_STREAM(name_ << ": a corrected map is refused, and the map stays as it was: " << why);
}

void CorrectedMaps::addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  if (taken_ + refused_ == 0 && !isPublished()) return;
  status.add("Corrected maps taken", taken_);
  status.add("Corrected maps refused", refused_);
}

}  // namespace mapping_common
