// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/multi_map.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <stdexcept>

namespace intensity_hector_slam {
namespace {

// The same area in cells that are so many times smaller.
Eigen::AlignedBox2i scaled(const Eigen::AlignedBox2i& box, int scale) {
  const Eigen::Vector2i one = Eigen::Vector2i::Ones();
  return {scale * box.min(), scale * (box.max() + one) - one};
}

}  // namespace

MultiMap::MultiMap(const MapOptions& options) : options_(mapping_common::validate(options)) {
  // All levels have the same borders: sizes are whole cells of the coarsest.
  const double coarsest = options_.resolution * (1 << (options_.levels - 1));
  const int size = std::max(2, options_.size >> (options_.levels - 1));
  const Eigen::Vector2i min(-std::lround(options_.start_x * size), -std::lround(options_.start_y * size));
  const Eigen::AlignedBox2i box(min, min + Eigen::Vector2i::Constant(size - 1));
  for (int i = 0; i < options_.levels; ++i) {
    const int scale = 1 << (options_.levels - 1 - i);
    levels_.emplace_back(coarsest / scale, scaled(box, scale));
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
  constexpr double kLeast = 5.0;  // m, so that the borders don't move with each scan
  const GridMap& coarsest = levels_.back();
  const Eigen::Isometry2d to_map = isometry(pose);
  Eigen::AlignedBox2i seen(coarsest.cellAt(to_map * scan.origin.cast<double>()));
  for (const auto* ends : {&scan.points, &scan.free}) {
    for (const Eigen::Vector2f& end : *ends) seen.extend(coarsest.cellAt(to_map * end.cast<double>()));
  }

  Eigen::AlignedBox2i box = coarsest.box();
  const int most = static_cast<int>(options_.max_size / coarsest.resolution()),
            least = static_cast<int>(std::ceil(kLeast / coarsest.resolution()));
  for (int axis : {0, 1}) {
    const auto added = [&](int missing) {
      const int room = std::max(0, most - (box.sizes()[axis] + 1));
      return missing < 0 ? 0 : std::min(room, std::max(missing + 1, least));
    };
    box.min()[axis] -= added(box.min()[axis] - seen.min()[axis]);
    box.max()[axis] += added(seen.max()[axis] - box.max()[axis]);
  }
  if (coarsest.box().contains(box)) return;
  for (int i = 0; i < levels(); ++i) levels_[i].growTo(scaled(box, 1 << (levels() - 1 - i)));
}

std::size_t MultiMap::bytes() const {
  return std::accumulate(levels_.begin(), levels_.end(), std::size_t{0},
                         [](std::size_t sum, const GridMap& level) { return sum + level.bytes(); });
}

}  // namespace intensity_hector_slam
