// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/resource.h>

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace mapping_common {

/// Work that ends in another thread than where it began, which is left to go on meanwhile.
class Worker {
 public:
  using Work = std::function<void()>;

  /// @param nice of the thread: above 0, others go first
  explicit Worker(int nice = 0) : thread_([this, nice] { run(nice); }) {}
  /// Ends what is at work, and forgets what waits.
  ~Worker() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ending_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }
  /// @param work is done in the worker's thread; it throws nothing. It returns what is left to be done by who
  /// calls finish()
  void post(std::function<Work()> work) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      jobs_.push_back(std::move(work));
    }
    wake_.notify_all();
  }
  /// Does what is left of work that is done.
  void finish() {
    std::vector<Work> left;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      left.swap(done_);
    }
    for (const Work& work : left) work();
  }
  bool isIdle() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return jobs_.empty() && !working_ && done_.empty();
  }
  /// Whether work should come to its end, for who asks while it is done.
  bool isEnding() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return ending_;
  }

 private:
  void run(int nice) {
    if (nice > 0) setpriority(PRIO_PROCESS, 0, nice);  // on Linux of this thread alone
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      wake_.wait(lock, [this] { return ending_ || !jobs_.empty(); });
      if (ending_) return;
      const std::function<Work()> job = std::move(jobs_.front());
      jobs_.pop_front();
      working_ = true;
      lock.unlock();
      Work left = job();
      lock.lock();
      working_ = false;
      if (left) done_.push_back(std::move(left));
    }
  }

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::function<Work()>> jobs_;
  std::vector<Work> done_;
  bool working_ = false, ending_ = false;
  std::thread thread_;  // the last, as it uses all others
};

}  // namespace mapping_common
