// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "block_rows.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

/// Which obstacles haven't been seen for a while (Options::decay_time). Time goes in steps, for each block
/// from a moment of its own, so that the blocks of a map don't come all at once. At the end of a step, what
/// is occupied and was not touched by a scan in it takes a miss (Eq. 2.7).
class Decay {
 public:
  explicit Decay(const Options& options);

  bool isOn() const { return step_ > 0.0; }
  /// s, so that what is at the upper clamping threshold is no longer occupied after decay_time.
  double step() const { return step_; }

  struct Due {
    Block block;
    int steps;                              ///< that have ended
    std::unique_ptr<const BlockRows> seen;  ///< in the first of them; null: nothing
  };
  /// Time goes on to `time` (s); one that is earlier by more than decay_time begins anew.
  /// @return the blocks with occupied voxels of which steps have ended, in order
  std::vector<Due> advance(double time);

  /// There may be occupied voxels in a block.
  void add(const Block& block) { blocks_[block]; }
  /// There are none any more, for all that is known.
  void remove(const Block& block) { blocks_.erase(block); }
  /// A scan's voxels of a block are seen. For several blocks at a time, each once.
  void see(const Block& block, const ScanMask& mask) const;

  void clear();
  std::size_t memoryUsage() const;  ///< bytes

 private:
  double step_ = 0.0, time_ = 0.0, decay_time_;
  bool started_ = false;
  // Those that may have occupied voxels, with what was seen in the step that goes on.
  mutable std::map<Block, std::unique_ptr<BlockRows>> blocks_;
};

}  // namespace rtree_occupancy_map
