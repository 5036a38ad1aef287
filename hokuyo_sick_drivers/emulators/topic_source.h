// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>

#include <memory>
#include <string>

#include "scan_source.h"

namespace device_emulators {

/// The latest scan of a topic. Needs ros::init, and somebody who lets callbacks run.
class TopicSource : public ScanSource {
 public:
  /// @param multi_echo whether the topic is of MultiEchoLaserScan, otherwise of LaserScan
  TopicSource(const std::string& topic, bool multi_echo);
  std::shared_ptr<const Scan> at(Nanoseconds) override { return latest_; }

 private:
  template <class Message>
  void arrived(const boost::shared_ptr<const Message>& message);

  ros::NodeHandle node_;
  ros::Subscriber subscriber_;
  std::shared_ptr<const Scan> latest_;
};

}  // namespace device_emulators
