// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <geometry_msgs/Point.h>
#include <rtree_occupancy_map/CastRay.h>
#include <rtree_occupancy_map/MapCell.h>
#include <rtree_occupancy_map/map_snapshot.h>
#include <rtree_occupancy_map/occupancy_map.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <vector>

namespace rtree_occupancy_map {

/// Of a geometry_msgs/Point or Vector3.
template <class Message>
Eigen::Vector3d toEigen(const Message& m) {
  return {m.x, m.y, m.z};
}
geometry_msgs::Point toPoint(const Eigen::Vector3d& p);
MapCell toMessage(const OccupancyMap& map, const Cell& cell);
/// Answers the service.
void castRay(const OccupancyMap& map, const CastRay::Request& request, CastRay::Response& response);

/// A cloud of the occupied cells' centres: float32 x y z, size_x size_y size_z (m), probability, reflectivity
/// (NaN without), and of a map with colours rgb (white without). The header is left to the caller.
sensor_msgs::PointCloud2 occupiedCloud(const MapSnapshot& map);

/// The same cloud of a map that changes: only blocks that changed are converted.
class OccupiedCloud {
 public:
  void update(const MapSnapshot& changed);
  sensor_msgs::PointCloud2 cloud() const;
  void clear() { blocks_.clear(); }

 private:
  bool colored_ = false;
  std::map<Block, std::vector<std::uint8_t>> blocks_;  // the data of their points
};

}  // namespace rtree_occupancy_map
