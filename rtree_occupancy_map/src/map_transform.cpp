// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/map_transform.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "log_odds.h"

namespace rtree_occupancy_map {
namespace {

// Voxels of a source that are unpacked at a time, at most about.
constexpr double kMostUnpacked = 4e6;

// A box of voxels, unpacked.
class DenseBox {
 public:
  struct Value {
    float log_odds = std::numeric_limits<float>::quiet_NaN();  // unknown
    Reflectivity reflectivity;
    bool isKnown() const { return !std::isnan(log_odds); }
  };

  explicit DenseBox(const VoxelBox& box)
      : box_(box), values_(box.isEmpty() ? 0 : static_cast<std::size_t>(box.volume())) {}

  const VoxelBox& box() const { return box_; }
  Value& operator()(int x, int y, int z) {
    const int at[3] = {x - box_.min[0], y - box_.min[1], z - box_.min[2]};
    return values_[(static_cast<std::size_t>(at[0]) * box_.width(1) + at[1]) * box_.width(2) + at[2]];
  }
  /// What is unknown where the box doesn't reach.
  Value at(const Voxel& v) { return box_.contains(v) ? (*this)(v[0], v[1], v[2]) : Value(); }

  template <class Use>
  static void forEach(const VoxelBox& box, const Use& use) {
    for (int x = box.min[0]; x < box.max[0]; ++x)
      for (int y = box.min[1]; y < box.max[1]; ++y)
        for (int z = box.min[2]; z < box.max[2]; ++z) use(x, y, z);
  }

  /// @return whether the map knows any of it
  bool read(const OccupancyMap& map) {
    bool any = false;
    map.visitBox(box_, [&](const Cell& cell) {
      any = true;
      forEach(intersect(cell.box, box_), [&](int x, int y, int z) {
        (*this)(x, y, z) = {cell.log_odds, cell.reflectivity};
      });
      return true;
    });
    return any;
  }

  /// What is known, equal neighbours along z in one cell.
  void appendTo(std::vector<Cell>& cells) {
    for (int x = box_.min[0]; x < box_.max[0]; ++x) {
      for (int y = box_.min[1]; y < box_.max[1]; ++y) {
        for (int z = box_.min[2], end = z; z < box_.max[2]; z = end) {
          const Value& value = (*this)(x, y, z);
          for (end = z + 1; end < box_.max[2] && value.isKnown() && same(value, (*this)(x, y, end)); ++end) {
          }
          if (!value.isKnown()) continue;
          Cell cell;
          cell.box = VoxelBox::unit({x, y, z});
          cell.box.max[2] = static_cast<std::int16_t>(end);
          cell.log_odds = value.log_odds;
          cell.reflectivity = value.reflectivity;
          cells.push_back(cell);
        }
      }
    }
  }

 private:
  static bool same(const Value& a, const Value& b) {
    return a.log_odds == b.log_odds && a.reflectivity.hits == b.reflectivity.hits &&
           (a.reflectivity.hits == 0 || a.reflectivity.mean == b.reflectivity.mean);
  }

  VoxelBox box_;
  std::vector<Value> values_;
};

Eigen::Vector3d centerOf(int x, int y, int z, double resolution) {
  return resolution * Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5);
}

Voxel voxelOf(const Eigen::Vector3d& point, double resolution) {
  Voxel v;
  for (int i = 0; i < 3; ++i)
    v[i] = static_cast<int>(std::floor(std::clamp(point[i] / resolution, -1e9, 1e9)));
  return v;
}

// The box around a box (m) in another frame.
Eigen::AlignedBox3d around(const Eigen::AlignedBox3d& box, const Eigen::Isometry3d& transform) {
  Eigen::AlignedBox3d out;
  for (int i = 0; i < 8; ++i) {
    const auto corner = static_cast<Eigen::AlignedBox3d::CornerType>(i);
    out.extend(transform * box.corner(corner));
  }
  return out;
}

// The new map's blocks that the old one's may reach.
std::set<Block> reachedBlocks(const OccupancyMap& map, const Eigen::Isometry3d& transform,
                              double resolution) {
  std::set<Block> reached;
  for (const Block& block : map.blocks()) {
    const VoxelBox box = OccupancyMap::boxOf(block);
    const Eigen::AlignedBox3d there = around({map.minCorner(box), map.maxCorner(box)}, transform);
    const Block min = OccupancyMap::blockOf(voxelOf(there.min(), resolution)),
                max = OccupancyMap::blockOf(voxelOf(there.max(), resolution));
    for (int i = 0; i < 3; ++i) {
      if (min[i] * kBlockSize < kMinVoxel || (max[i] + 1) * kBlockSize > kMaxVoxel) {
        throw std::invalid_argument("the map would reach farther than " +
                                    std::to_string(kMaxVoxel * resolution) +
                                    " m from the origin, which is as far as a map of that resolution goes");
      }
    }
    for (int x = min[0]; x <= max[0]; ++x)
      for (int y = min[1]; y <= max[1]; ++y)
        for (int z = min[2]; z <= max[2]; ++z) reached.insert({x, y, z});
  }
  return reached;
}

// One box of the new map.
void transformInto(const VoxelBox& box, double resolution, const OccupancyMap& map,
                   const Eigen::Isometry3d& transform, std::vector<Cell>& cells) {
  const double from = map.options().resolution;
  const Eigen::Vector3d min = resolution * Eigen::Vector3d(box.min[0], box.min[1], box.min[2]),
                        max = resolution * Eigen::Vector3d(box.max[0], box.max[1], box.max[2]);
  const Eigen::AlignedBox3d there = around({min, max}, transform.inverse());
  const VoxelBox known = intersect(map.boxOf(there.min(), there.max()), map.bounds());
  if (known.isEmpty() || map.visitBox(known, [](const Cell&) { return false; })) return;
  DenseBox source(known);
  source.read(map);
  DenseBox target(box);
  const auto take = [](DenseBox::Value& value, const DenseBox::Value& other) {
    if (other.isKnown() && !(value.log_odds >= other.log_odds)) value = other;
  };
  const Eigen::Isometry3d inverse = transform.inverse();
  DenseBox::forEach(box, [&](int x, int y, int z) {
    take(target(x, y, z), source.at(voxelOf(inverse * centerOf(x, y, z, resolution), from)));
  });
  DenseBox::forEach(source.box(), [&](int x, int y, int z) {
    const DenseBox::Value& value = source(x, y, z);
    if (!value.isKnown()) return;
    const Voxel to = voxelOf(transform * centerOf(x, y, z, from), resolution);
    if (box.contains(to)) take(target(to[0], to[1], to[2]), value);
  });
  target.appendTo(cells);
}

// A voxel has the colours of the source's voxels whose centres are in it, or else of the one that its centre
// is in.
std::vector<ColoredVoxel> transformedColors(const OccupancyMap& map, const Eigen::Isometry3d& transform,
                                            double resolution) {
  const std::vector<ColoredVoxel> source = map.coloredVoxels();
  const double from = map.options().resolution;
  std::vector<ColoredVoxel> colors;
  std::vector<Voxel> taken;
  for (const ColoredVoxel& s : source) {
    const Voxel to = voxelOf(transform * centerOf(s.voxel[0], s.voxel[1], s.voxel[2], from), resolution);
    colors.push_back({to, s.color});
    taken.push_back(to);
  }
  std::sort(taken.begin(), taken.end());
  const Eigen::Isometry3d inverse = transform.inverse();
  for (const ColoredVoxel& s : source) {
    const Eigen::Vector3d min = from * Eigen::Vector3d(s.voxel[0], s.voxel[1], s.voxel[2]);
    const Eigen::AlignedBox3d there = around({min, min + Eigen::Vector3d::Constant(from)}, transform);
    const Voxel low = voxelOf(there.min(), resolution), high = voxelOf(there.max(), resolution);
    for (int x = low[0]; x <= high[0]; ++x) {
      for (int y = low[1]; y <= high[1]; ++y) {
        for (int z = low[2]; z <= high[2]; ++z) {
          const Voxel to = {x, y, z};
          if (voxelOf(inverse * centerOf(x, y, z, resolution), from) == s.voxel &&
              !std::binary_search(taken.begin(), taken.end(), to))
            colors.push_back({to, s.color});
        }
      }
    }
  }
  return colors;
}

}  // namespace

OccupancyMap transformed(const OccupancyMap& map, const Eigen::Isometry3d& transform,
                         const Options& options) {
  mapping_common::validate(options);
  const double resolution = options.resolution;
  // Parts of blocks, where a block would have too many of the source's voxels in it.
  int edge = kBlockSize;
  while (edge > 1 && std::pow(edge * resolution / map.options().resolution, 3) > kMostUnpacked) edge /= 2;
  std::vector<Cell> cells;
  for (const Block& block : reachedBlocks(map, transform, resolution)) {
    const VoxelBox whole = OccupancyMap::boxOf(block);
    for (int x = whole.min[0]; x < whole.max[0]; x += edge) {
      for (int y = whole.min[1]; y < whole.max[1]; y += edge) {
        for (int z = whole.min[2]; z < whole.max[2]; z += edge) {
          VoxelBox part = VoxelBox::unit({x, y, z});
          for (int i = 0; i < 3; ++i) part.max[i] = static_cast<std::int16_t>(part.min[i] + edge);
          transformInto(part, resolution, map, transform, cells);
        }
      }
    }
  }
  OccupancyMap target = OccupancyMap::fromCells(options, cells);
  if (options.color) target.addColors(transformedColors(map, transform, resolution));
  return target;
}

OccupancyMap merged(const OccupancyMap& a, const OccupancyMap& b) {
  if (a.options().resolution != b.options().resolution)
    throw std::invalid_argument("maps to be merged need the same resolution");
  const float prior = logOdds(a.options().prior);
  const std::vector<Block> of_a = a.blocks(), of_b = b.blocks();
  std::set<Block> blocks(of_a.begin(), of_a.end());
  blocks.insert(of_b.begin(), of_b.end());
  std::vector<Cell> cells;
  for (const Block& block : blocks) {
    DenseBox into(OccupancyMap::boxOf(block)), other(into.box());
    into.read(a);
    if (other.read(b)) {
      DenseBox::forEach(into.box(), [&](int x, int y, int z) {
        DenseBox::Value& value = into(x, y, z);
        const DenseBox::Value& more = other(x, y, z);
        if (!more.isKnown()) return;
        if (!value.isKnown()) {
          value = more;
          return;
        }
        value.log_odds += more.log_odds - prior;
        Reflectivity& r = value.reflectivity;
        const std::uint32_t hits = r.hits + more.reflectivity.hits;
        if (more.reflectivity.hits > 0) {
          const double sum = (r.hits > 0 ? static_cast<double>(r.mean) * r.hits : 0.0) +
                             static_cast<double>(more.reflectivity.mean) * more.reflectivity.hits;
          r = {static_cast<float>(sum / hits), hits};
        }
      });
    }
    into.appendTo(cells);
  }
  OccupancyMap both = OccupancyMap::fromCells(a.options(), cells);
  both.addColors(a.coloredVoxels());
  both.addColors(b.coloredVoxels());
  return both;
}

}  // namespace rtree_occupancy_map
