// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdint>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

namespace hokuyo_sick_drivers {

/// Writes clouds of any size to a bag (format 2.0) without another copy of them, as rosbag::Bag makes two.
class CloudBag {
 public:
  /// @param out can be seeked in
  explicit CloudBag(std::ostream& out);

  /// Each message is a chunk of its own. @throws std::runtime_error for one of more than 4 GiB
  void write(const std::string& topic, const ros::Time& time, const sensor_msgs::PointCloud2& message);
  void write(const std::string& topic, const ros::Time& time, const tf2_msgs::TFMessage& message);
  /// Without it the bag isn't whole.
  void close();

 private:
  struct Chunk {
    std::uint64_t position = 0;
    ros::Time time;
    std::uint32_t connection = 0;
  };

  void writeFileHeader(std::uint64_t index_position);
  void writeChunk(const std::string& topic, const std::string& connection_header, const ros::Time& time,
                  const std::vector<std::pair<const char*, std::size_t>>& message);

  std::ostream& out_;
  std::vector<std::pair<std::string, std::string>> connections_;  // topic, record
  std::vector<Chunk> chunks_;
};

}  // namespace hokuyo_sick_drivers
