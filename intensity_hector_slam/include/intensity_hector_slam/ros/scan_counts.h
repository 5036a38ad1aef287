// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/slam.h>
#include <mapping_common/nodelet.h>

#include <string>

namespace intensity_hector_slam {

/// What became of the scans, for the diagnostics.
class ScanCounts {
 public:
  /// Why a scan gave no pose.
  enum Reason { kNoTransform, kMalformed, kEmpty, kRejected, kTimeJump, kPaused };

  void received();
  /// @param time s, that it took
  void processed(const SlamResult& result, double time);
  /// @param there whether a scan had odometry
  /// @param exists whether any ever had
  void odometry(bool there, bool exists);
  void drop(Reason reason, std::size_t count = 1) { drops_.add(reason, count); }
  const std::string& name(Reason reason) const { return drops_.name(reason); }
  /// Of the drops.
  std::string text() const { return drops_.text(); }
  std::size_t allReceived() const { return all_received_; }

  /// @param seconds since the last report
  /// @param waiting scans that wait for transforms
  /// @param state the summary, where all is well
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, double seconds, std::size_t waiting,
             const std::string& state) const;
  void endReport();

 private:
  struct Recent {
    std::size_t received = 0, processed = 0, unobservable = 0, lost_odometry = 0;
    double time = 0.0, longest = 0.0;  // s
  };

  Recent recent_;
  mapping_common::DropCounts drops_{
      {"no transform", "malformed", "empty", "rejected", "time jump", "paused"}};
  std::size_t all_received_ = 0, all_processed_ = 0;
  bool has_odometry_ = false;
  SlamResult last_;
};

/// What may be wrong where no scan comes: who publishes there, and where there are scans.
/// @param topic its full name
std::string whyNoScan(const std::string& topic);

}  // namespace intensity_hector_slam
