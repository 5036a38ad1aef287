// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace rtree_occupancy_map {

/// Threads that share out the numbers 0 to n - 1 among them. They start with the first work there is.
class WorkerPool {
 public:
  /// `worker` is 0 to size() - 1; nobody else has this number at the same time.
  using Work = std::function<void(std::size_t number, int worker)>;

  /// @param threads the caller's included; 0: as many as there are cores
  explicit WorkerPool(int threads);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  int size() const { return size_; }

  /// Calls `work` for each number below n; returns when all is done. Passes the first exception on.
  /// @param least fewer numbers than this aren't worth waking anybody up
  void run(std::size_t n, std::size_t least, const Work& work);

 private:
  void loop(int worker);
  void takeNumbers(int worker);

  const int size_;
  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable begin_, end_;
  std::size_t round_ = 0;  // counts run()
  int busy_ = 0;
  bool stop_ = false;
  const Work* work_ = nullptr;
  std::size_t count_ = 0;
  std::atomic<std::size_t> next_{0};
  std::exception_ptr failure_;
};

}  // namespace rtree_occupancy_map
