// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/callback_queue_interface.h>
#include <ros/time.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace mapping_common {

/// Says the same again only after a while of wall time.
class Throttle {
 public:
  explicit Throttle(double seconds = 5.0) : period_(seconds) {}
  /// Whether it may be said now.
  bool operator()();

 private:
  ros::WallDuration period_;
  ros::WallTime last_;
};

/// Runs callbacks. An exception that one throws ends there: it is logged and counted, and the process goes
/// on.
class CallbackGuard {
 public:
  /// @param name of the nodelet
  explicit CallbackGuard(std::string name);

  /// @return whether the callback came to its end
  bool run(const std::function<void()>& callback);
  std::size_t exceptions() const;
  /// What the last one said.
  std::string lastException() const;

 private:
  void caught(const std::string& what);

  const std::string name_;
  mutable std::mutex mutex_;
  std::size_t exceptions_ = 0;
  std::string last_;
  Throttle throttle_;
};

/// Hands callbacks on to another queue, each under guard. Can be used by several threads.
class GuardedQueue : public ros::CallbackQueueInterface {
 public:
  GuardedQueue(ros::CallbackQueueInterface& queue, std::shared_ptr<CallbackGuard> guard);
  void addCallback(const ros::CallbackInterfacePtr& callback, std::uint64_t owner_id) override;
  void removeByID(std::uint64_t owner_id) override;

  /// Keeps those that come from now on until `release`, which hands them on in their order.
  void hold();
  void release();

 private:
  struct Held {
    ros::CallbackInterfacePtr callback;
    std::uint64_t owner_id;
  };
  ros::CallbackQueueInterface& queue_;
  std::shared_ptr<CallbackGuard> guard_;
  std::mutex mutex_;
  bool holds_ = false;
  std::vector<Held> held_;
};

}  // namespace mapping_common
