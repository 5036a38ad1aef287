// SPDX-License-Identifier: BSD-3-Clause
//
// The format: wiki.ros.org/Bags/Format/2.0. A record is the length of its header, the header (fields, each
// with its length), the length of its data, the data.
#include "cloud_bag.h"

#include <ros/message_traits.h>
#include <ros/serialization.h>

#include <cstring>
#include <limits>
#include <stdexcept>

namespace hokuyo_sick_drivers {
namespace {

enum Op : std::uint8_t {
  kMessage = 2,
  kBagHeader = 3,
  kIndex = 4,
  kChunk = 5,
  kChunkInfo = 6,
  kConnection = 7
};
constexpr std::size_t kHeaderSize = 4096;  // of the bag's header record
constexpr std::uint32_t kVersion = 1;      // of index and chunk info

template <class T>
std::string bytesOf(T value) {  // of a little-endian machine
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

std::string bytesOf(const ros::Time& time) {
  return bytesOf(time.sec) + bytesOf(time.nsec);
}

std::string field(const std::string& name, const std::string& value) {
  return bytesOf(static_cast<std::uint32_t>(name.size() + 1 + value.size())) + name + '=' + value;
}

// A record up to its data.
std::string recordStart(Op op, const std::string& fields, std::uint32_t data_size) {
  const std::string header = field("op", bytesOf(op)) + fields;
  return bytesOf(static_cast<std::uint32_t>(header.size())) + header + bytesOf(data_size);
}

std::string record(Op op, const std::string& fields, const std::string& data) {
  return recordStart(op, fields, static_cast<std::uint32_t>(data.size())) + data;
}

template <class Message>
std::string connectionHeader(const std::string& topic, bool latching) {
  namespace traits = ros::message_traits;
  return field("topic", topic) + field("type", traits::DataType<Message>::value()) +
         field("md5sum", traits::MD5Sum<Message>::value()) +
         field("message_definition", traits::Definition<Message>::value()) +
         field("latching", latching ? "1" : "0");
}

template <class Message>
std::string serialise(const Message& message) {
  std::string bytes(ros::serialization::serializationLength(message), '\0');
  ros::serialization::OStream stream(reinterpret_cast<std::uint8_t*>(&bytes[0]),
                                     static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

}  // namespace

CloudBag::CloudBag(std::ostream& out) : out_(out) {
  out_ << "#ROSBAG V2.0\n";
  writeFileHeader(0);
}

void CloudBag::writeFileHeader(std::uint64_t index_position) {
  const std::string fields = field("index_pos", bytesOf(index_position)) +
                             field("conn_count", bytesOf(static_cast<std::uint32_t>(connections_.size()))) +
                             field("chunk_count", bytesOf(static_cast<std::uint32_t>(chunks_.size())));
  const std::size_t size = record(kBagHeader, fields, "").size();
  out_ << record(kBagHeader, fields, std::string(kHeaderSize - size, ' '));
}

void CloudBag::write(const std::string& topic, const ros::Time& time,
                     const sensor_msgs::PointCloud2& message) {
  sensor_msgs::PointCloud2 without_data;
  without_data.header = message.header;
  without_data.height = message.height;
  without_data.width = message.width;
  without_data.fields = message.fields;
  without_data.is_bigendian = message.is_bigendian;
  without_data.point_step = message.point_step;
  without_data.row_step = message.row_step;
  // It ends with the length of the data, the data, and one byte, is_dense.
  std::string start = serialise(without_data);
  start.resize(start.size() - 5);
  start += bytesOf(static_cast<std::uint32_t>(message.data.size()));
  const char dense = static_cast<char>(message.is_dense);
  writeChunk(topic, connectionHeader<sensor_msgs::PointCloud2>(topic, false), time,
             {{start.data(), start.size()},
              {reinterpret_cast<const char*>(message.data.data()), message.data.size()},
              {&dense, 1}});
}

void CloudBag::write(const std::string& topic, const ros::Time& time, const tf2_msgs::TFMessage& message) {
  const std::string bytes = serialise(message);
  writeChunk(topic, connectionHeader<tf2_msgs::TFMessage>(topic, true), time, {{bytes.data(), bytes.size()}});
}

void CloudBag::writeChunk(const std::string& topic, const std::string& connection_header,
                          const ros::Time& time,
                          const std::vector<std::pair<const char*, std::size_t>>& message) {
  std::uint32_t connection = 0;
  while (connection < connections_.size() && connections_[connection].first != topic) ++connection;
  std::string chunk;
  if (connection == connections_.size()) {
    chunk =
        record(kConnection, field("conn", bytesOf(connection)) + field("topic", topic), connection_header);
    connections_.emplace_back(topic, chunk);
  }
  const auto message_offset = static_cast<std::uint32_t>(chunk.size());
  std::size_t size = 0;
  for (const auto& part : message) size += part.second;
  if (size > std::numeric_limits<std::uint32_t>::max() - 65536) {
    throw std::runtime_error("is too large for a message of a bag, which ends at 4 GiB: use voxels");
  }
  const std::string for_connection = field("conn", bytesOf(connection));
  chunk +=
      recordStart(kMessage, for_connection + field("time", bytesOf(time)), static_cast<std::uint32_t>(size));

  const auto chunk_size = static_cast<std::uint32_t>(chunk.size() + size);
  chunks_.push_back({static_cast<std::uint64_t>(out_.tellp()), time, connection});
  out_ << recordStart(kChunk, field("compression", "none") + field("size", bytesOf(chunk_size)), chunk_size)
       << chunk;
  for (const auto& part : message) out_.write(part.first, static_cast<std::streamsize>(part.second));
  out_ << record(kIndex,
                 field("ver", bytesOf(kVersion)) + for_connection + field("count", bytesOf(std::uint32_t{1})),
                 bytesOf(time) + bytesOf(message_offset));
}

void CloudBag::close() {
  const auto index_position = static_cast<std::uint64_t>(out_.tellp());
  for (const auto& connection : connections_) out_ << connection.second;
  for (const Chunk& chunk : chunks_) {
    const std::string fields = field("ver", bytesOf(kVersion)) + field("chunk_pos", bytesOf(chunk.position)) +
                               field("start_time", bytesOf(chunk.time)) +
                               field("end_time", bytesOf(chunk.time)) +
                               field("count", bytesOf(std::uint32_t{1}));
    out_ << record(kChunkInfo, fields, bytesOf(chunk.connection) + bytesOf(std::uint32_t{1}));
  }
  out_.seekp(static_cast<std::streamoff>(std::strlen("#ROSBAG V2.0\n")));
  writeFileHeader(index_position);
}

}  // namespace hokuyo_sick_drivers
