// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "beam_tracer.h"
#include "block_index.h"
#include "block_rows.h"
#include "worker_pool.h"

namespace rtree_occupancy_map {

/// The voxels that one scan touches, each once, block by block.
class ScanRaster {
 public:
  /// @param resolution m
  ScanRaster(double resolution, WorkerPool& pool);

  /// Begins a new scan.
  void start();
  /// Beams that are added from now on start at `origin` (m), inside of the map's coordinates.
  void setOrigin(const Eigen::Vector3f& origin) { origins_.push_back({origin, beams_.size()}); }

  /// @return true the first time that this scan ends in this voxel
  bool markHit(const Voxel& voxel);

  /// Marks the voxels from the origin's to the one before `end`, which holds the point `end_point` (m), as
  /// crossed: at the latest by finish().
  void addBeam(const Voxel& end, const Eigen::Vector3f& end_point) { beams_.push_back({end, end_point}); }
  void finish();

  std::size_t size() const { return index_.size(); }
  const Block& block(std::size_t slot) const { return index_[slot]; }
  bool endsIn(std::size_t slot) const { return slots_[slot].hit != nullptr; }
  /// The number of a block in this scan, taken up if it is new.
  std::uint32_t slotOf(const Block& block);
  /// What the scan does in a block; after finish().
  void gather(std::size_t slot, ScanMask& mask) const;

 private:
  // Voxels that beams end in. Layers, see ScanMask, are cleared when they are first used.
  struct Hits {
    std::uint32_t layers = 0;
    BlockRows rows;
  };
  struct Slot {
    Hits* hit = nullptr;
    std::uint32_t traced = kNone;  // where traced_ has its first part
  };
  // What one of the tracers has of a block.
  struct Traced {
    std::uint32_t tracer, number;
    std::uint32_t next;  // part of the same block in traced_
  };
  // Where the beams from a number on start.
  struct Origin {
    Eigen::Vector3f point;
    std::size_t first_beam;
  };
  static constexpr std::uint32_t kNone = ~0u;

  void sortBeams();
  void trace(std::size_t begin, std::size_t end, BeamTracer& tracer) const;

  std::vector<Origin> origins_;
  BlockIndex index_;
  std::vector<Slot> slots_;
  std::vector<std::unique_ptr<Hits>> hits_;  // the first used_hits_ are in use by this scan
  std::size_t used_hits_ = 0;
  std::vector<BeamTracer::Beam> beams_, sorted_beams_;
  WorkerPool& pool_;
  std::vector<std::unique_ptr<BeamTracer>> tracers_;  // each has a share of the beams
  std::vector<Traced> traced_;
  Block last_hit_block_{};
  Hits* last_hits_ = nullptr;
};

}  // namespace rtree_occupancy_map
