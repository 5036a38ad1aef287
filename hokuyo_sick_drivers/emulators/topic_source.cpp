// SPDX-License-Identifier: BSD-3-Clause
#include "topic_source.h"

#include <ros/console.h>

#include "bag_source.h"

namespace device_emulators {

template <class Message>
void TopicSource::arrived(const boost::shared_ptr<const Message>& message) {
  try {
    latest_ = std::make_shared<Scan>(toScan(*message));
  } catch (const std::exception& e) {
    ROS_ERROR_STREAM_THROTTLE(5.0, subscriber_.getTopic() << ": dropped a " << e.what());
  }
}

TopicSource::TopicSource(const std::string& topic, bool multi_echo) {
  if (multi_echo) {
    subscriber_ = node_.subscribe(topic, 1, &TopicSource::arrived<sensor_msgs::MultiEchoLaserScan>, this);
  } else {
    subscriber_ = node_.subscribe(topic, 1, &TopicSource::arrived<sensor_msgs::LaserScan>, this);
  }
}

}  // namespace device_emulators
