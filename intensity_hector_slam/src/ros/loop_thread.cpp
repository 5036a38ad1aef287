// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/loop_thread.h"

#include <sys/resource.h>

#include <algorithm>
#include <ctime>
#include <exception>
#include <utility>

namespace intensity_hector_slam {
namespace {

constexpr std::size_t kMostWaiting = 20;  // key poses, beyond which the older ones' scans aren't sought
constexpr int kNice = 10;

// s, that the thread has taken.
double processorTime() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return time.tv_sec + 1e-9 * time.tv_nsec;
}

}  // namespace

LoopThread::LoopThread(const LoopOptions& options, const SlamOptions& slam)
    : finder_(options, slam), thread_([this] { run(); }) {}

LoopThread::~LoopThread() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

void LoopThread::add(const KeyPose& key, const Scan& scan, const std::optional<Edge>& edge) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    waiting_.push_back({key, scan, edge, starts_});
  }
  changed_.notify_one();
}

std::vector<Edge> LoopThread::take() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(found_, {});
}

void LoopThread::restart() {
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_.clear();
  found_.clear();
  ++starts_;
}

void LoopThread::run() {
  setpriority(PRIO_PROCESS, 0, kNice);  // on Linux of this thread alone
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stop_ || !waiting_.empty(); });
    if (stop_) return;
    const Item item = std::move(waiting_.front());
    waiting_.pop_front();
    const bool search = waiting_.size() < kMostWaiting;
    lock.unlock();
    const double start = processorTime();
    std::vector<Edge> loops;
    std::string error;
    try {
      loops = finder_.add(item.key, item.scan, item.edge, search);
    } catch (const std::exception& e) {
      error = e.what();
    }
    const double time = processorTime() - start;
    lock.lock();
    if (item.start == starts_) found_.insert(found_.end(), loops.begin(), loops.end());
    counts_ = finder_.counts();
    why_unsure_ = finder_.whyUnsure();
    if (!error.empty()) error_ = error;
    skipped_ += !search;
    seconds_ += time;
    longest_ = std::max(longest_, time);
  }
}

void LoopThread::addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(mutex_);
  status.summaryf(DiagnosticStatus::OK, "%zu loops among %zu key poses", counts_.loops, counts_.key_poses);
  if (waiting_.size() >= kMostWaiting)
    status.mergeSummary(DiagnosticStatus::WARN, "the search is behind, and leaves key poses out");
  if (!error_.empty()) status.mergeSummary(DiagnosticStatus::ERROR, error_);
  status.add("Key poses waiting", waiting_.size());
  status.add("Key poses not sought", skipped_);
  status.add("Key scans forgotten", counts_.forgotten);
  status.add("Searches", counts_.searches);
  status.add("Unsure places", counts_.unsure);
  status.add("Why the last was unsure", why_unsure_);
  status.add("Unconfirmed places", counts_.unconfirmed);
  status.add("Processor time per key pose (ms)",
             1e3 * seconds_ / std::max<std::size_t>(1, counts_.key_poses));
  status.add("Processor time, greatest (ms)", 1e3 * longest_);
}

}  // namespace intensity_hector_slam
