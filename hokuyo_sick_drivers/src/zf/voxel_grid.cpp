// SPDX-License-Identifier: BSD-3-Clause
#include "voxel_grid.h"

#include <cmath>
#include <limits>

namespace hokuyo_sick_drivers {

std::size_t VoxelGrid::Hash::operator()(const Key& key) const {
  std::uint64_t hash = 0;
  for (const std::int32_t k : key) {  // as in splitmix64
    hash = (hash ^ static_cast<std::uint32_t>(k)) * 0x9E3779B97F4A7C15U;
    hash ^= hash >> 29U;
  }
  return static_cast<std::size_t>(hash);
}

bool VoxelGrid::add(const Eigen::Vector3d& position, const ScanPoint& point) {
  Key key;
  for (int i = 0; i < 3; ++i) {
    const double index = std::floor(position[i] / edge_);
    if (!(std::abs(index) < std::numeric_limits<std::int32_t>::max())) return false;
    key[i] = static_cast<std::int32_t>(index);
  }
  const auto found = index_.try_emplace(key, static_cast<std::uint32_t>(sums_.size()));
  if (found.second) sums_.emplace_back();
  Sums& sums = sums_[found.first->second];
  for (int i = 0; i < 3; ++i) sums.position[i] += position[i];
  if (!std::isnan(point.intensity)) {
    sums.intensity += static_cast<double>(point.intensity);
    ++sums.intensities;
  }
  sums.rgb[0] += point.r;
  sums.rgb[1] += point.g;
  sums.rgb[2] += point.b;
  ++sums.count;
  return true;
}

VoxelGrid::Mean VoxelGrid::mean(std::size_t i) const {
  const Sums& sums = sums_[i];
  Mean mean;
  for (int k = 0; k < 3; ++k) mean.position[k] = sums.position[k] / sums.count;
  mean.intensity = sums.intensities > 0 ? static_cast<float>(sums.intensity / sums.intensities)
                                        : std::numeric_limits<float>::quiet_NaN();
  mean.rgb = 0;
  for (const std::uint64_t sum : sums.rgb) {
    mean.rgb = mean.rgb << 8U | static_cast<std::uint32_t>((sum + sums.count / 2) / sums.count);
  }
  return mean;
}

}  // namespace hokuyo_sick_drivers
