// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/callback_guard.h"

#include <ros/console.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <exception>
#include <utility>

namespace mapping_common {
namespace {

class GuardedCallback : public ros::CallbackInterface {
 public:
  GuardedCallback(ros::CallbackInterfacePtr callback, std::shared_ptr<CallbackGuard> guard)
      : callback_(std::move(callback)), guard_(std::move(guard)) {}
  CallResult call() override {
    CallResult result = Success;
    guard_->run([&] { result = callback_->call(); });
    return result;
  }
  bool ready() override { return callback_->ready(); }

 private:
  ros::CallbackInterfacePtr callback_;
  std::shared_ptr<CallbackGuard> guard_;
};

}  // namespace

bool Throttle::operator()() {
  const ros::WallTime now = ros::WallTime::now();
  if (!last_.isZero() && now >= last_ && now - last_ < period_) return false;
  last_ = now;
  return true;
}

CallbackGuard::CallbackGuard(std::string name) : name_(std::move(name)) {}

bool CallbackGuard::run(const std::function<void()>& callback) {
  try {
    callback();
    return true;
  } catch (const std::exception& e) {
    caught(e.what());
  } catch (...) {
    caught("an exception that says nothing");
  }
  return false;
}

void CallbackGuard::caught(const std::string& what) {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++exceptions_;
  last_ = what;
  if (throttle_()) {
    ROS_ERROR_STREAM_NAMED(name_, name_ << ": a callback failed, what it had to do is left out: " << what
                                        << ". So far: " << exceptions_);
  }
}

std::size_t CallbackGuard::exceptions() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return exceptions_;
}

std::string CallbackGuard::lastException() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return last_;
}

GuardedQueue::GuardedQueue(ros::CallbackQueueInterface& queue, std::shared_ptr<CallbackGuard> guard)
    : queue_(queue), guard_(std::move(guard)) {}

void GuardedQueue::addCallback(const ros::CallbackInterfacePtr& callback, std::uint64_t owner_id) {
  const auto guarded = boost::make_shared<GuardedCallback>(callback, guard_);
  const std::lock_guard<std::mutex> lock(mutex_);
  if (holds_) {
    held_.push_back({guarded, owner_id});
  } else {
    queue_.addCallback(guarded, owner_id);
  }
}

void GuardedQueue::removeByID(std::uint64_t owner_id) {
  // They end without the lock, and so does one that runs, which the queue waits for.
  std::vector<Held> removed;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto first = std::stable_partition(
        held_.begin(), held_.end(), [owner_id](const Held& held) { return held.owner_id != owner_id; });
    removed.assign(first, held_.end());
    held_.erase(first, held_.end());
  }
  queue_.removeByID(owner_id);
}

void GuardedQueue::hold() {
  const std::lock_guard<std::mutex> lock(mutex_);
  holds_ = true;
}

void GuardedQueue::release() {
  const std::lock_guard<std::mutex> lock(mutex_);
  holds_ = false;
  for (const Held& held : held_) queue_.addCallback(held.callback, held.owner_id);
  held_.clear();
}

}  // namespace mapping_common
