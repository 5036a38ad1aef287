// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/arrivals.h"

#include <sstream>
#include <stdexcept>
#include <utility>

namespace mapping_common {
namespace {

Drops::Options withReasons(Drops::Options options, bool in_order) {
  std::vector<std::string> reasons = {Arrivals::kNoTransform, Arrivals::kMalformed, Arrivals::kTimeJump};
  if (in_order) reasons.emplace_back(Arrivals::kLate);
  options.reasons.insert(options.reasons.begin(), reasons.begin(), reasons.end());
  return options;
}

}  // namespace

Drops::Drops(Options options) : options_(std::move(options)) {}

void Drops::add(const std::string& reason, const std::string& why, std::size_t count) {
  counts_[reason] += count;
  recent_ += count;
  if (!why.empty() && throttles_[reason]()) {
    ROS_WARN_STREAM_NAMED(options_.name,
                          options_.warning << " (" << reason << "): " << why << ". So far: " << text());
  }
}

std::string Drops::text() const {
  std::ostringstream text;
  for (const std::string& reason : options_.reasons) {
    const auto count = counts_.find(reason);
    text << (text.tellp() > 0 ? ", " : "") << (count == counts_.end() ? 0 : count->second) << ' ' << reason;
  }
  return text.str();
}

void Drops::addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  for (const std::string& reason : options_.reasons) {
    const auto count = counts_.find(reason);
    status.add(options_.key + ": " + reason, count == counts_.end() ? 0 : count->second);
  }
}

Arrivals::Arrivals(const ros::NodeHandle& node, std::shared_ptr<CallbackGuard> guard, const Options& options,
                   std::function<void(const ros::Time&)> jumped_back)
    : node_(node),
      guard_(std::move(guard)),
      in_order_(options.in_order),
      jumped_back_(std::move(jumped_back)),
      name_(options.drops.name),
      drops_(withReasons(options.drops, options.in_order)),
      queue_(node, options.transforms, [this](const std::string& why) { drops_.add(kNoTransform, why); }) {}

bool Arrivals::accept(const std::string& sensor, const std::string& label, const std_msgs::Header& header) {
  ++received_;
  ++recent_[label];
  try {
    switch (stamps_.check(sensor + ' ' + header.frame_id, header.stamp)) {
      case Stamps::Order::kNext:
        break;
      case Stamps::Order::kLate:
        if (!in_order_) break;
        drops_.add(kLate, "its stamp is earlier than that of the one before");
        return false;
      case Stamps::Order::kJumpedBack:
        jumpedBack(header.stamp);
        break;
    }
    return true;
  } catch (const std::invalid_argument& e) {
    drops_.add(kMalformed, e.what());
    return false;
  }
}

void Arrivals::add(const std::string& sensor, const std_msgs::Header& header, TransformQueue::Ready process,
                   bool with_other, const SweepTimes& sweep) {
  try {
    // Guarded, as it may be called out of tf's callback, which has more to do.
    queue_.add(
        sensor + ' ' + header.frame_id, header, with_other,
        [this, process = std::move(process)](const Transforms& transforms) {
          guard_->run([&] {
            try {
              process(transforms);
            } catch (const std::invalid_argument& e) {
              drops_.add(kMalformed, e.what());
            }
          });
        },
        sweep);
  } catch (const std::invalid_argument& e) {
    drops_.add(kMalformed, e.what());
  }
}

void Arrivals::jumpedBack(const ros::Time& to) {
  if (jump_throttle_()) {
    ROS_WARN_STREAM_NAMED(name_, "Time jumped back by " << stamps_.jump() << " s to " << to
                                                        << ": transforms and messages that wait are "
                                                           "forgotten, all else goes on");
  }
  if (const std::size_t waiting = queue_.restart())
    drops_.add(kTimeJump, "it waited for a transform", waiting);
  jumped_back_(to);
}

void Arrivals::addTo(diagnostic_updater::DiagnosticStatusWrapper& status, double seconds) const {
  for (const auto& [label, count] : recent_)
    status.addf(label + " (Hz)", "%.1f", static_cast<double>(count) / seconds);
  status.add("Waiting for transforms", queue_.waiting());
  drops_.addTo(status);
}

void Arrivals::endReport() {
  drops_.endReport();
  reported_ = received_;
  for (auto& [label, count] : recent_) count = 0;
}

}  // namespace mapping_common
