// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/MultiEchoLaserScan.h>

#include <memory>
#include <optional>
#include <string>

#include "scan_source.h"

namespace device_emulators {

Scan toScan(const sensor_msgs::LaserScan& message);
Scan toScan(const sensor_msgs::MultiEchoLaserScan& message);

/// The scans of a bag, one after the other at the bag's rate, over and over. At a time it gives the scan
/// whose stamp is the nearest, so that a device of the bag's rate sends each scan once.
class BagSource : public ScanSource {
 public:
  /// @param topic of LaserScan or MultiEchoLaserScan; empty: the only such topic
  /// @throws std::runtime_error with the topics that the bag has
  BagSource(const std::string& file, const std::string& topic);
  std::shared_ptr<const Scan> at(Nanoseconds time) override;

  std::size_t scans() const { return view_->size(); }

 private:
  struct Stamped {
    Nanoseconds time = 0;  // since the first start of the bag
    std::shared_ptr<const Scan> scan;
  };
  Stamped read(const rosbag::MessageInstance& message) const;
  void advance();

  rosbag::Bag bag_;
  std::string topic_;
  std::unique_ptr<rosbag::View> view_;
  rosbag::View::iterator next_message_;
  Nanoseconds first_stamp_ = 0, period_ = 0;  // of the loop
  Nanoseconds loop_start_ = 0;
  std::optional<Nanoseconds> start_;  // time of the first call
  Stamped current_, next_;
};

}  // namespace device_emulators
