// SPDX-License-Identifier: BSD-3-Clause
//
// octomap_msgs/Octomap and octomap_msgs/GetOctomap, for whoever has them: the same names, checksums and
// bytes. They are defined here, by roscpp's traits, since Debian has no package octomap_msgs, and one of that
// name in this workspace would hide the one that Noetic has.
#pragma once

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <ros/service_traits.h>
#include <rtree_occupancy_map/octomap_file.h>
#include <std_msgs/Header.h>

#include <cstdint>
#include <string>

namespace rtree_occupancy_map {

struct OctomapMessage {
  std_msgs::Header header;
  std::uint8_t binary = 0;  ///< bool: whether data is that of a .bt file, otherwise that of an .ot file
  std::string id;           ///< "OcTree", "ColorOcTree"
  double resolution = 0.0;  ///< m
  std::string data;         ///< int8[], which has the bytes of a string
};

struct GetOctomap {
  struct Request {};
  struct Response {
    OctomapMessage map;
  };
  Request request;
  Response response;
};

/// @param resolution m
OctomapMessage toMessage(OctomapData octree, OctomapFormat format, double resolution,
                         const std_msgs::Header& header);

}  // namespace rtree_occupancy_map

namespace rtree_occupancy_map::octomap_traits {

// What the traits of roscpp look like.
template <const char* (*Text)()>
struct Value {
  static const char* value() { return Text(); }
  template <class T>
  static const char* value(const T&) {
    return Text();
  }
};

inline const char* messageMd5() {
  return "9a45536b45c5e409cd49f04bb2d9999f";
}
inline const char* messageType() {
  return "octomap_msgs/Octomap";
}
inline const char* messageDefinition() {
  static const std::string text = "Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data\n" +
                                  std::string(80, '=') + "\nMSG: std_msgs/Header\n" +
                                  ros::message_traits::definition<std_msgs::Header>();
  return text.c_str();
}
inline const char* serviceMd5() {
  return "be9d2869d24fe40d6bc21ac21f6bb2c5";
}
inline const char* serviceType() {
  return "octomap_msgs/GetOctomap";
}
inline const char* requestType() {
  return "octomap_msgs/GetOctomapRequest";
}
inline const char* responseType() {
  return "octomap_msgs/GetOctomapResponse";
}

}  // namespace rtree_occupancy_map::octomap_traits

namespace ros {
namespace message_traits {

namespace octomap = rtree_occupancy_map::octomap_traits;
template <>
struct MD5Sum<rtree_occupancy_map::OctomapMessage> : octomap::Value<octomap::messageMd5> {};
template <>
struct DataType<rtree_occupancy_map::OctomapMessage> : octomap::Value<octomap::messageType> {};
template <>
struct Definition<rtree_occupancy_map::OctomapMessage> : octomap::Value<octomap::messageDefinition> {};
template <>
struct HasHeader<rtree_occupancy_map::OctomapMessage> : TrueType {};
template <>
struct DataType<rtree_occupancy_map::GetOctomap::Request> : octomap::Value<octomap::requestType> {};
template <>
struct DataType<rtree_occupancy_map::GetOctomap::Response> : octomap::Value<octomap::responseType> {};

}  // namespace message_traits

namespace service_traits {

namespace octomap = rtree_occupancy_map::octomap_traits;
template <>
struct MD5Sum<rtree_occupancy_map::GetOctomap> : octomap::Value<octomap::serviceMd5> {};
template <>
struct MD5Sum<rtree_occupancy_map::GetOctomap::Request> : octomap::Value<octomap::serviceMd5> {};
template <>
struct MD5Sum<rtree_occupancy_map::GetOctomap::Response> : octomap::Value<octomap::serviceMd5> {};
template <>
struct DataType<rtree_occupancy_map::GetOctomap> : octomap::Value<octomap::serviceType> {};
template <>
struct DataType<rtree_occupancy_map::GetOctomap::Request> : octomap::Value<octomap::serviceType> {};
template <>
struct DataType<rtree_occupancy_map::GetOctomap::Response> : octomap::Value<octomap::serviceType> {};

}  // namespace service_traits

namespace serialization {

template <>
struct Serializer<rtree_occupancy_map::OctomapMessage> {
  template <class Stream, class Message>
  static void allInOne(Stream& stream, Message message) {
    stream.next(message.header);
    stream.next(message.binary);
    stream.next(message.id);
    stream.next(message.resolution);
    stream.next(message.data);
  }
  ROS_DECLARE_ALLINONE_SERIALIZER
};

template <>
struct Serializer<rtree_occupancy_map::GetOctomap::Request> {
  template <class Stream, class Message>
  static void allInOne(Stream&, Message) {}
  ROS_DECLARE_ALLINONE_SERIALIZER
};

template <>
struct Serializer<rtree_occupancy_map::GetOctomap::Response> {
  template <class Stream, class Message>
  static void allInOne(Stream& stream, Message message) {
    stream.next(message.map);
  }
  ROS_DECLARE_ALLINONE_SERIALIZER
};

}  // namespace serialization
}  // namespace ros
