// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/cell_conversion.h"

#include <sensor_msgs/PointField.h>

#include <algorithm>
#include <cstring>

namespace rtree_occupancy_map {

geometry_msgs::Point toPoint(const Eigen::Vector3d& p) {
  geometry_msgs::Point point;
  point.x = p.x();
  point.y = p.y();
  point.z = p.z();
  return point;
}

MapCell toMessage(const OccupancyMap& map, const Cell& cell) {
  MapCell message;
  message.min = toPoint(map.minCorner(cell.box));
  message.max = toPoint(map.maxCorner(cell.box));
  message.occupied = map.isOccupied(cell);
  message.probability = static_cast<float>(OccupancyMap::probability(cell.log_odds));
  message.reflectivity = cell.reflectivity.mean;
  message.returns = cell.reflectivity.hits;
  return message;
}

sensor_msgs::PointCloud2 toPointCloud2(const OccupancyMap& map, const std::vector<Cell>& cells) {
  sensor_msgs::PointCloud2 cloud;
  for (const char* name : {"x", "y", "z", "size_x", "size_y", "size_z", "probability", "reflectivity"}) {
    sensor_msgs::PointField field;
    field.name = name;
    field.offset = cloud.point_step;
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.count = 1;
    cloud.fields.push_back(field);
    cloud.point_step += sizeof(float);
  }
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(cells.size());
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.is_dense = true;  // of x y z
  cloud.data.resize(cells.size() * cloud.point_step);
  std::uint8_t* out = cloud.data.data();
  for (const Cell& cell : cells) {
    const Eigen::Vector3f center = map.center(cell.box).cast<float>();
    const Eigen::Vector3f size = (map.maxCorner(cell.box) - map.minCorner(cell.box)).cast<float>();
    const float values[] = {center.x(),
                            center.y(),
                            center.z(),
                            size.x(),
                            size.y(),
                            size.z(),
                            static_cast<float>(OccupancyMap::probability(cell.log_odds)),
                            cell.reflectivity.mean};
    std::memcpy(out, values, sizeof(values));
    out += sizeof(values);
  }
  return cloud;
}

std::vector<Block> knownBlocks(const OccupancyMap& map) {
  std::vector<Block> blocks;
  map.tree().visitAll([&blocks](const Cell& cell) {
    const Block block = OccupancyMap::blockOf({cell.box.min[0], cell.box.min[1], cell.box.min[2]});
    if (blocks.empty() || blocks.back() != block) blocks.push_back(block);
    return true;
  });
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

void appendOccupied(const OccupancyMap& map, const Block& block, std::vector<Cell>& cells) {
  const VoxelBox box = OccupancyMap::boxOf(block);
  map.tree().visitOccupiedIf([&box](const VoxelBox& b) { return box.overlaps(b); },
                             [&cells](const Cell& cell) {
                               cells.push_back(cell);
                               return true;
                             });
}

}  // namespace rtree_occupancy_map
