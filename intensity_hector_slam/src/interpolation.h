// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace intensity_hector_slam {

/// Section 3.4.1 with the weights that the derivatives there imply: (x - x_i) / (x_j - x_i) belongs to g_j
/// and g_l. Coefficient by coefficient: both channels of a point, or one of several points.
template <class Array>
struct Bilinear {
  Bilinear() = default;
  /// @param i, j, k, l the cell g_i, g_j right of it, g_k above it, g_l above g_j
  /// @param fx, fy where the point is between the centres of the cells, 0 to 1
  template <class Fraction>
  Bilinear(const Array& i, const Array& j, const Array& k, const Array& l, const Fraction& fx,
           const Fraction& fy) {
    const Array left_dy = k - i, right_dy = l - j;
    const Array left = i + fy * left_dy;
    dx = j + fy * right_dy - left;
    value = left + fx * dx;
    dy = left_dy + fx * (right_dy - left_dy);
  }

  Array value, dx, dy;  ///< derivatives per cell width
};

}  // namespace intensity_hector_slam
