// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/multi_map.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace intensity_hector_slam {

MultiMap::MultiMap(const MapOptions& options) : options_(mapping_common::validate(options)) {
  // All levels have the same borders: sizes are whole cells of the coarsest.
  const double coarsest = options_.resolution * (1 << (options_.levels - 1));
  const int size = std::max(2, options_.size >> (options_.levels - 1));
  const Eigen::Vector2d min(-coarsest * std::round(options_.start_x * size),
                            -coarsest * std::round(options_.start_y * size));
  for (int i = 0; i < options_.levels; ++i) {
    const int scale = 1 << (options_.levels - 1 - i);
    levels_.emplace_back(coarsest / scale, min, size * scale, size * scale);
  }
}

void MultiMap::requireLike(const MapOptions& options) const {
  std::ostringstream text;
  if (std::abs(options_.resolution - options.resolution) > 1e-6 * options.resolution)
    text << "map_resolution is " << options_.resolution << " m, expected is " << options.resolution << " m";
  else if (options_.levels != options.levels)
    text << "map_multi_res_levels is " << options_.levels << ", expected is " << options.levels;
  if (!text.str().empty()) throw std::invalid_argument(text.str());
}

void MultiMap::clear() {
  for (GridMap& level : levels_) level.clear();
  updates_ = 0;
}

void MultiMap::update(const Scan& scan, const Pose& pose) {
  if (options_.grow) growTo(scan, pose);
  // Before any level changes, and on the coarsest, whose cells are larger than the noise.
  appeared_.resize(scan.points.size());
  const Eigen::Isometry2d to_map = isometry(pose);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    appeared_[i] = levels_.back().isOpen(to_map * scan.points[i].cast<double>(), options_.sure_free);
  }
  for (GridMap& level : levels_) level.update(scan, pose, options_, appeared_);
  ++updates_;
}

void MultiMap::growTo(const Scan& scan, const Pose& pose) {
  const GridMap& coarsest = levels_.back();
  const double cell = coarsest.resolution();
  const Eigen::Isometry2d to_map = isometry(pose);
  Eigen::AlignedBox2d seen(to_map * scan.origin.cast<double>());
  for (const auto* ends : {&scan.points, &scan.free}) {
    for (const Eigen::Vector2f& end : *ends) seen.extend(to_map * end.cast<double>());
  }

  // By no less than a quarter of the map, so that it doesn't grow with each scan.
  const auto added = [&](double missing, int side) {
    if (missing <= 0.0) return 0;
    const int room = std::max(0, static_cast<int>(options_.max_size / cell) - side);
    return static_cast<int>(std::min<double>(room, std::max(std::ceil(missing / cell) + 1.0, side / 4.0)));
  };
  const int width = coarsest.width(), height = coarsest.height();
  const Eigen::Vector2d min = coarsest.origin(), max = min + cell * Eigen::Vector2d(width, height);
  const Eigen::Array2d margin = Eigen::Array2d::Constant(cell);
  const Eigen::Array2d low = min.array() - seen.min().array() + margin,
                       high = seen.max().array() - max.array() + margin;
  const int left = added(low.x(), width), right = added(high.x(), width + left);
  const int below = added(low.y(), height), above = added(high.y(), height + below);
  if (left + right + below + above == 0) return;
  for (int i = 0; i < levels(); ++i) {
    const int scale = 1 << (levels() - 1 - i);
    levels_[i].grow(scale * left, scale * right, scale * below, scale * above);
  }
}

}  // namespace intensity_hector_slam
