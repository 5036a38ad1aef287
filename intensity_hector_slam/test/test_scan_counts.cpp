// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "intensity_hector_slam/ros/scan_counts.h"

namespace intensity_hector_slam {
namespace {

using diagnostic_msgs::DiagnosticStatus;

std::string summary(const ScanCounts& counts, std::size_t waiting = 0, std::size_t dropped = 0) {
  diagnostic_updater::DiagnosticStatusWrapper status;
  counts.addTo(status, 1.0, dropped, waiting, "Mapping");
  EXPECT_EQ(status.message != "Mapping" && status.message != "No input",
            status.level == DiagnosticStatus::WARN);
  return status.message;
}

TEST(ScanCounts, TellWhatIsWrong) {
  ScanCounts counts;
  EXPECT_EQ("No input", summary(counts));
  EXPECT_EQ("3 scans wait for transforms", summary(counts, 3));
  SlamResult result;
  result.status = Status::kMatched;
  counts.processed(result, 0.001);
  counts.odometry(false, false);
  EXPECT_EQ("Mapping", summary(counts, 1));
  counts.odometry(false, true);
  EXPECT_EQ("1 scans without odometry", summary(counts));
  counts.processed(result, 0.95);
  EXPECT_EQ("Scans come faster than they are processed", summary(counts));
  EXPECT_EQ("2 scans without a pose", summary(counts, 0, 2));

  counts.endReport();
  EXPECT_EQ("No input", summary(counts));
  result.status = Status::kUnobservable;
  counts.processed(result, 0.001);
  EXPECT_EQ("1 scans don't tell the whole pose", summary(counts));
}

}  // namespace
}  // namespace intensity_hector_slam
