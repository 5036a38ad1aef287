// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "intensity_hector_slam/grid_map.h"

namespace intensity_hector_slam {

/// Section 3.4.1 with the weights that the derivatives there imply: (x - x_i) / (x_j - x_i) belongs to g_j
/// and g_l.
/// @param i the cell g_i, followed by g_j; k the cell g_k above it, followed by g_l
/// @param fx, fy where the point is between the centres of the cells, 0 to 1
/// @return derivatives per cell width
inline GridMap::Interpolation interpolateCells(const GridMap::Cell* i, const GridMap::Cell* k, float fx,
                                               float fy) {
  using Row = Eigen::Map<const Eigen::Array4f>;  // P and R of the left cell, P and R of the right cell
  const Eigen::Array4f lower = Row(&i->occupancy), upper = Row(&k->occupancy);
  const Eigen::Array4f dy = upper - lower;
  const Eigen::Array4f value = lower + fy * dy;
  GridMap::Interpolation result;
  result.dx = value.tail<2>() - value.head<2>();
  result.value = value.head<2>() + fx * result.dx;
  result.dy = dy.head<2>() + fx * (dy.tail<2>() - dy.head<2>());
  return result;
}

}  // namespace intensity_hector_slam
