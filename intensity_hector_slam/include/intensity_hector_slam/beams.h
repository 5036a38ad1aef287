// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "intensity_hector_slam/scan.h"

namespace intensity_hector_slam {

constexpr int kLanes = 4;  ///< beams at a time

/// A scan for the matcher's inner loop, which takes kLanes beams at a time: arrays of all their members,
/// whose length is the next multiple of kLanes. What fills them up isn't valid, and counts for nothing.
struct Beams {
  std::vector<float> x, y;          ///< m, ends of the beams, frame of the body
  std::vector<float> reflectivity;  ///< 0 where it isn't known
  std::vector<float> known;         ///< 1 where it is, else 0
  std::vector<float> valid;         ///< 1, 0 for those that fill up
  std::size_t count = 0;
  double mean_range = 1.0;   ///< m, 0.1 at least
  double share_known = 0.0;  ///< of the reflectivities

  void assign(const Scan& scan);

  /// Neighbouring beams of `all` that end within `spacing` (m) of the first of them become one, their mean. A
  /// person near by has as many beams as a wall far away, on a tenth of its length, and would hold the pose
  /// as firmly.
  ///
  /// They are in the order in which the levels need them. Level k uses the first count / 2^k, which have to
  /// be evenly spread over the scan: every 2^(levels - 1)th along the scan comes first, then those in the
  /// middle between these, and so on.
  /// @param least so many are kept, or half of them if that is more; the last in this order are left out
  void assignThinned(const Beams& all, double spacing, int levels, std::size_t least);

  /// Every k-th kLanes beams of `all`, about `most` of them or all if they are fewer.
  void assignSparse(const Beams& all, std::size_t most);

 private:
  void reset(std::size_t n);  // to zeros

  std::vector<std::size_t> begins_;  // of the beams that become one
};

}  // namespace intensity_hector_slam
