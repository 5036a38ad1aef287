// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <intensity_hector_slam/slam.h>

#include <string>

namespace intensity_hector_slam {

/// What became of the scans that were processed, for the diagnostics.
class ScanCounts {
 public:
  /// @param time s, that it took
  void processed(const SlamResult& result, double time);
  /// @param there whether a scan had odometry
  /// @param exists whether any ever had
  void odometry(bool there, bool exists);

  /// @param seconds since the last report
  /// @param dropped scans since then
  /// @param waiting scans that wait for transforms
  /// @param state the summary, where all is well
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, double seconds, std::size_t dropped,
             std::size_t waiting, const std::string& state) const;
  void endReport();

 private:
  struct Recent {
    std::size_t processed = 0, unobservable = 0, lost_odometry = 0;
    double time = 0.0, longest = 0.0;  // s
  };

  Recent recent_;
  std::size_t all_processed_ = 0;
  bool has_odometry_ = false;
  SlamResult last_;
};

/// What may be wrong where no scan comes: who publishes there, and where there are scans.
/// @param topic its full name
std::string whyNoScan(const std::string& topic);

}  // namespace intensity_hector_slam
