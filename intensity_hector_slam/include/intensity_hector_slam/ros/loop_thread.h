// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <intensity_hector_slam/loop_finder.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace intensity_hector_slam {

/// Seeks loops in a thread of its own, of low priority, so that no scan waits for it.
class LoopThread {
 public:
  LoopThread(const LoopOptions& options, const SlamOptions& slam);
  /// Ends with what is sought now; what waits is left.
  ~LoopThread();
  LoopThread(const LoopThread&) = delete;
  LoopThread& operator=(const LoopThread&) = delete;

  /// Takes a key pose, see LoopFinder::add. It returns at once.
  void add(const KeyPose& key, const Scan& scan, const std::optional<Edge>& edge);
  /// The loops that were found since the last call.
  std::vector<Edge> take();
  /// Leaves what waits and what was found: key poses to come aren't connected with those before.
  void restart();

  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  struct Item {
    KeyPose key;
    Scan scan;
    std::optional<Edge> edge;
    std::size_t start;  // see starts_
  };
  void run();

  LoopFinder finder_;  // of the thread alone

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> waiting_;
  std::vector<Edge> found_;
  std::size_t starts_ = 0;
  bool stop_ = false;
  LoopFinder::Counts counts_;
  std::string why_unsure_, error_;
  std::size_t skipped_ = 0;               // key poses whose scans weren't sought
  double seconds_ = 0.0, longest_ = 0.0;  // of processor time, of all key poses and of one
  std::thread thread_;
};

}  // namespace intensity_hector_slam
