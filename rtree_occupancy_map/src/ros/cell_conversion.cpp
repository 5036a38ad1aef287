// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/cell_conversion.h"

#include <sensor_msgs/PointField.h>

#include <array>
#include <string_view>
#include <utility>

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

void castRay(const OccupancyMap& map, const CastRay::Request& request, CastRay::Response& response) {
  const RayHit hit = map.castRay(toEigen(request.origin), toEigen(request.direction), request.max_range,
                                 request.ignore_unknown);
  response.point = toPoint(hit.point);
  switch (hit.result) {
    case RayHit::Result::kOccupied:
      response.result = CastRay::Response::OCCUPIED;
      response.cell = toMessage(map, hit.cell);
      break;
    case RayHit::Result::kUnknown:
      response.result = CastRay::Response::UNKNOWN;
      break;
    case RayHit::Result::kNothing:
      response.result = CastRay::Response::NOTHING;
      break;
  }
}

namespace {

using Point = std::array<float, 8>;

void append(const MapSnapshot& map, const MapSnapshot::BlockCells& block, std::vector<std::uint8_t>& data) {
  for (const Cell& cell : block.cells) {
    if (!map.isOccupied(cell)) continue;
    const Eigen::Vector3f center = map.center(cell.box).cast<float>();
    const Eigen::Vector3f size = (map.maxCorner(cell.box) - map.minCorner(cell.box)).cast<float>();
    const Point point = {center.x(),
                         center.y(),
                         center.z(),
                         size.x(),
                         size.y(),
                         size.z(),
                         static_cast<float>(OccupancyMap::probability(cell.log_odds)),
                         cell.reflectivity.mean};
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(point.data());
    data.insert(data.end(), bytes, bytes + sizeof(point));
    if (!map.colored) continue;
    const std::uint32_t color = packedColor(block.colorOf(cell.box).value_or(kNoColor));
    const auto* packed = reinterpret_cast<const std::uint8_t*>(&color);
    data.insert(data.end(), packed, packed + sizeof(color));
  }
}

sensor_msgs::PointCloud2 cloudOf(std::vector<std::uint8_t> data, bool colored) {
  sensor_msgs::PointCloud2 cloud;
  for (const char* name :
       {"x", "y", "z", "size_x", "size_y", "size_z", "probability", "reflectivity", "rgb"}) {
    if (!colored && std::string_view(name) == "rgb") continue;
    sensor_msgs::PointField field;
    field.name = name;
    field.offset = cloud.point_step;
    field.datatype = sensor_msgs::PointField::FLOAT32;
    field.count = 1;
    cloud.fields.push_back(field);
    cloud.point_step += sizeof(float);
  }
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(data.size() / cloud.point_step);
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.is_dense = true;  // of x y z
  cloud.data = std::move(data);
  return cloud;
}

}  // namespace

sensor_msgs::PointCloud2 occupiedCloud(const MapSnapshot& map) {
  std::vector<std::uint8_t> data;
  for (const MapSnapshot::BlockCells& block : map.blocks) append(map, block, data);
  return cloudOf(std::move(data), map.colored);
}

void OccupiedCloud::update(const MapSnapshot& changed) {
  colored_ = changed.colored;
  for (const MapSnapshot::BlockCells& block : changed.blocks) {
    std::vector<std::uint8_t>& data = blocks_[block.block];
    data.clear();
    append(changed, block, data);
    if (data.empty()) blocks_.erase(block.block);
  }
}

sensor_msgs::PointCloud2 OccupiedCloud::cloud() const {
  std::size_t size = 0;
  for (const auto& [block, points] : blocks_) size += points.size();
  std::vector<std::uint8_t> data;
  data.reserve(size);
  for (const auto& [block, points] : blocks_) data.insert(data.end(), points.begin(), points.end());
  return cloudOf(std::move(data), colored_);
}

}  // namespace rtree_occupancy_map
