// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/map_image.h"

namespace intensity_hector_slam {

Eigen::AlignedBox2i shownCells(const GridMap& map) {
  const Eigen::AlignedBox2i known = map.knownCells();
  return known.isEmpty() ? Eigen::AlignedBox2i(Eigen::Vector2i(0, 0), Eigen::Vector2i(0, 0)) : known;
}

mapping_common::MapImage imageOf(const GridMap& map) {
  using mapping_common::MapImage;
  const Eigen::AlignedBox2i box = shownCells(map);
  const Eigen::Vector2d origin = map.resolution() * box.min().cast<double>();
  MapImage image;
  image.width = box.sizes().x() + 1;
  image.height = box.sizes().y() + 1;
  image.resolution = map.resolution();
  image.origin_x = origin.x();
  image.origin_y = origin.y();
  for (int y = box.max().y(); y >= box.min().y(); --y) {
    for (int x = box.min().x(); x <= box.max().x(); ++x) {
      const GridMap::Cell& cell = map.cell(x, y);
      image.pixels.push_back(!GridMap::isKnown(cell)     ? MapImage::kUnknown
                             : GridMap::isOccupied(cell) ? MapImage::kOccupied
                                                         : MapImage::kFree);
    }
  }
  return image;
}

}  // namespace intensity_hector_slam
