// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/scan_counts.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/master.h>

#include <algorithm>

namespace intensity_hector_slam {

using diagnostic_msgs::DiagnosticStatus;

void ScanCounts::processed(const SlamResult& result, double time) {
  ++all_processed_;
  ++recent_.processed;
  recent_.unobservable += result.status == Status::kUnobservable;
  recent_.time += time;
  recent_.longest = std::max(recent_.longest, time);
  last_ = result;
}

void ScanCounts::odometry(bool there, bool exists) {
  has_odometry_ = there;
  recent_.lost_odometry += exists && !there;
}

void ScanCounts::addTo(diagnostic_updater::DiagnosticStatusWrapper& status, double seconds,
                       std::size_t dropped, std::size_t waiting, const std::string& state) const {
  if (dropped > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans without a pose", dropped);
  } else if (recent_.processed == 0 && waiting > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans wait for transforms", waiting);
  } else if (recent_.time > 0.9 * seconds) {
    status.summary(DiagnosticStatus::WARN, "Scans come faster than they are processed");
  } else if (recent_.lost_odometry > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans without odometry", recent_.lost_odometry);
  } else if (recent_.unobservable > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu scans don't tell the whole pose", recent_.unobservable);
  } else {
    status.summary(DiagnosticStatus::OK, recent_.processed > 0 ? state : "No input");
  }
  status.add("Processed", all_processed_);
  status.add("Odometry", has_odometry_ ? "used" : "none");
  status.addf("Time, mean (ms)", "%.3f",
              recent_.processed > 0 ? 1e3 * recent_.time / recent_.processed : 0.0);
  status.addf("Time, longest (ms)", "%.3f", 1e3 * recent_.longest);
  status.add("Last scan", all_processed_ > 0 ? toString(last_.status) : "");
  status.add("Last cost", last_.match.iterations > 0 ? last_.match.cost : "");
  status.addf("Last contradiction", "%.3f", last_.match.contradiction);
}

void ScanCounts::endReport() {
  recent_ = {};
}

std::string whyNoScan(const std::string& topic) {
  ros::master::V_TopicInfo topics;
  ros::master::getTopics(topics);  // that are published
  std::string here = "which nobody publishes", others;
  for (const ros::master::TopicInfo& info : topics) {
    const bool is_scan = info.datatype == "sensor_msgs/LaserScan";
    if (info.name == topic) {
      here = is_scan ? "though it is published" : "which is a " + info.datatype;
    } else if (is_scan) {
      others += (others.empty() ? "" : ", ") + info.name;
    }
  }
  return "No scan came on " + topic + ", " + here + (others.empty() ? "" : "; there are scans on " + others);
}

}  // namespace intensity_hector_slam
