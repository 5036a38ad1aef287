// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

/// The mean of the points in each voxel, in the order in which voxels got their first point.
class VoxelGrid {
 public:
  struct Mean {
    Eigen::Vector3d position;
    float intensity;  ///< of those points that have one
    std::uint32_t rgb;
  };

  explicit VoxelGrid(double edge) : edge_(edge) {}

  /// @return false for a position too far away
  bool add(const Eigen::Vector3d& position, const ScanPoint& point);
  std::size_t size() const { return sums_.size(); }
  Mean mean(std::size_t i) const;

 private:
  using Key = std::array<std::int32_t, 3>;
  struct Hash {
    std::size_t operator()(const Key& key) const;
  };
  struct Sums {
    std::array<double, 3> position{};
    double intensity = 0.0;
    std::array<std::uint64_t, 3> rgb{};
    std::uint32_t count = 0, intensities = 0;
  };

  double edge_;
  std::unordered_map<Key, std::uint32_t, Hash> index_;
  std::vector<Sums> sums_;
};

}  // namespace hokuyo_sick_drivers
