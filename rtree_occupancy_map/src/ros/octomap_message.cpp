// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/octomap_message.h"

#include <utility>

namespace rtree_occupancy_map {

OctomapMessage toMessage(OctomapData octree, OctomapFormat format, double resolution,
                         const std_msgs::Header& header) {
  OctomapMessage message;
  message.header = header;
  message.binary = format == OctomapFormat::kBinary ? 1 : 0;
  message.id = octree.id();
  message.resolution = resolution;
  message.data = std::move(octree.bytes);
  return message;
}

}  // namespace rtree_occupancy_map
