// SPDX-License-Identifier: BSD-3-Clause
#include "worker_pool.h"

#include <algorithm>

namespace rtree_occupancy_map {

WorkerPool::WorkerPool(int threads)
    : size_(threads > 0 ? threads : std::max(1, static_cast<int>(std::thread::hardware_concurrency()))) {}

WorkerPool::~WorkerPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  begin_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerPool::run(std::size_t n, std::size_t least, const Work& work) {
  if (size_ == 1 || n < std::max<std::size_t>(least, 2)) {
    for (std::size_t i = 0; i < n; ++i) work(i, 0);
    return;
  }
  while (threads_.size() + 1 < static_cast<std::size_t>(size_)) {
    const int worker = static_cast<int>(threads_.size()) + 1;
    threads_.emplace_back([this, worker] { loop(worker); });
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    work_ = &work;
    count_ = n;
    next_ = 0;
    failure_ = nullptr;
    busy_ = size_ - 1;
    ++round_;
  }
  begin_.notify_all();
  takeNumbers(0);
  std::unique_lock<std::mutex> lock(mutex_);
  end_.wait(lock, [this] { return busy_ == 0; });
  if (failure_) std::rethrow_exception(failure_);
}

void WorkerPool::loop(int worker) {
  std::size_t done = 0;
  while (true) {
    {
      std::unique_lock<std::mutex> lock(mutex_);
      begin_.wait(lock, [&] { return stop_ || round_ > done; });
      if (stop_) return;
      done = round_;
    }
    takeNumbers(worker);
    const std::lock_guard<std::mutex> lock(mutex_);
    if (--busy_ == 0) end_.notify_one();
  }
}

void WorkerPool::takeNumbers(int worker) {
  try {
    for (std::size_t i = next_++; i < count_; i = next_++) (*work_)(i, worker);
  } catch (...) {
    next_ = count_;
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!failure_) failure_ = std::current_exception();
  }
}

}  // namespace rtree_occupancy_map
