// SPDX-License-Identifier: BSD-3-Clause
//
// Messages to test with.
#pragma once

#include <rtree_occupancy_map/occupancy_map.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/PointField.h>
#include <visualization_msgs/MarkerArray.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace rtree_occupancy_map {

struct Field {
  std::string name;
  std::uint8_t type;
};

/// A value of a PointField type at `to`. @return its size
inline std::size_t writeField(std::uint8_t type, double value, std::uint8_t* to) {
  const auto write = [to](auto typed) {
    std::memcpy(to, &typed, sizeof(typed));
    return sizeof(typed);
  };
  using sensor_msgs::PointField;
  switch (type) {
    case PointField::INT8:
      return write(static_cast<std::int8_t>(value));
    case PointField::UINT8:
      return write(static_cast<std::uint8_t>(value));
    case PointField::INT16:
      return write(static_cast<std::int16_t>(value));
    case PointField::UINT16:
      return write(static_cast<std::uint16_t>(value));
    case PointField::INT32:
      return write(static_cast<std::int32_t>(value));
    case PointField::UINT32:
      return write(static_cast<std::uint32_t>(value));
    case PointField::FLOAT32:
      return write(static_cast<float>(value));
    case PointField::FLOAT64:
      return write(value);
    default:
      throw std::invalid_argument("type");
  }
}

/// A cloud of one row; a point has a value for each field.
inline sensor_msgs::PointCloud2 makeCloud(const std::vector<Field>& fields,
                                          const std::vector<std::vector<double>>& points) {
  sensor_msgs::PointCloud2 cloud;
  std::uint8_t scratch[8];
  for (const Field& f : fields) {
    sensor_msgs::PointField field;
    field.name = f.name;
    field.offset = cloud.point_step;
    field.datatype = f.type;
    field.count = 1;
    cloud.fields.push_back(field);
    cloud.point_step += writeField(f.type, 0.0, scratch);
  }
  cloud.height = 1;
  cloud.width = points.size();
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.data.resize(cloud.row_step);
  std::uint8_t* to = cloud.data.data();
  for (const auto& point : points) {
    for (std::size_t i = 0; i < fields.size(); ++i) to += writeField(fields[i].type, point[i], to);
  }
  return cloud;
}

inline sensor_msgs::PointCloud2 makeCloud(const std::vector<Eigen::Vector3f>& points) {
  constexpr std::uint8_t kFloat = sensor_msgs::PointField::FLOAT32;
  std::vector<std::vector<double>> values;
  for (const auto& p : points) values.push_back({p.x(), p.y(), p.z()});
  return makeCloud({{"x", kFloat}, {"y", kFloat}, {"z", kFloat}}, values);
}

/// Returns from the walls, floor and ceiling of a box around the sensor at the origin.
inline std::vector<Eigen::Vector3f> roomPoints(const Eigen::Vector3f& half_size, int count, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<Eigen::Vector3f> points;
  while (static_cast<int>(points.size()) < count) {
    const Eigen::Vector3f direction(normal(random), normal(random), normal(random));
    points.push_back(direction / (direction.cwiseAbs().cwiseQuotient(half_size)).maxCoeff());
  }
  return points;
}

/// Corners in voxels of a cuboid of this centre and size.
inline std::array<int, 6> boxOf(const Eigen::Vector3d& center, const Eigen::Vector3d& size,
                                double resolution) {
  std::array<int, 6> box;
  for (int i = 0; i < 3; ++i) {
    box[i] = static_cast<int>(std::lround((center[i] - 0.5 * size[i]) / resolution));
    box[i + 3] = static_cast<int>(std::lround((center[i] + 0.5 * size[i]) / resolution));
  }
  return box;
}

/// Boxes of the map's occupied, or free, cells.
inline std::vector<std::array<int, 6>> boxesOf(const OccupancyMap& map, bool occupied) {
  std::vector<std::array<int, 6>> boxes;
  map.tree().visitAll([&](const Cell& cell) {
    const VoxelBox& b = cell.box;
    if (map.isOccupied(cell) == occupied) {
      boxes.push_back({b.min[0], b.min[1], b.min[2], b.max[0], b.max[1], b.max[2]});
    }
    return true;
  });
  std::sort(boxes.begin(), boxes.end());
  return boxes;
}

/// What a display shows after a sequence of MarkerArrays.
class MarkerDisplay {
 public:
  using Id = std::pair<std::string, int>;

  void show(const visualization_msgs::MarkerArray& message) {
    std::set<Id> seen;
    for (const auto& m : message.markers) {
      if (m.action != visualization_msgs::Marker::DELETEALL && !seen.insert({m.ns, m.id}).second) {
        throw std::runtime_error("an id that is twice in one message");
      }
      if (m.action == visualization_msgs::Marker::DELETEALL) {
        markers_.clear();
      } else if (m.action == visualization_msgs::Marker::DELETE) {
        if (markers_.erase({m.ns, m.id}) == 0) throw std::runtime_error("DELETE of what isn't shown");
      } else {
        markers_[{m.ns, m.id}] = m;
      }
    }
  }
  const std::map<Id, visualization_msgs::Marker>& markers() const { return markers_; }

  /// Minimum and maximum corner of each cube, in voxels.
  std::vector<std::array<int, 6>> boxes(double resolution) const {
    std::vector<std::array<int, 6>> boxes;
    for (const auto& [id, m] : markers_) {
      for (const auto& p : m.points) {
        boxes.push_back(boxOf({p.x, p.y, p.z}, {m.scale.x, m.scale.y, m.scale.z}, resolution));
      }
    }
    std::sort(boxes.begin(), boxes.end());
    return boxes;
  }

 private:
  std::map<Id, visualization_msgs::Marker> markers_;
};

}  // namespace rtree_occupancy_map
