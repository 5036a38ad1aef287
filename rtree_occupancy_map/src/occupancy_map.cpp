// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/occupancy_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <sstream>
#include <stdexcept>

#include "color_layer.h"
#include "insertion.h"
#include "log_odds.h"
#include "machine_options.h"
#include "rolling_window.h"
#include "row_kernels.h"
#include "scan_raster.h"

namespace rtree_occupancy_map {
namespace {

// In voxels: 0.6 m / 0.1 m isn't 6.
constexpr double kRounding = 1e-6;

constexpr const char* kNoColorsInWindow =
    "color is true, allowed is false: a rolling window, and a store, has no colours";

using VoxelBatch = std::array<Voxel, 256>;

bool isInside(const Voxel& v) {
  return v[0] != kMaxVoxel && v[1] != kMaxVoxel && v[2] != kMaxVoxel;
}

Options complete(Options options) {
  mapping_common::validate(options);
  options.tree.occupied_log_odds = logOdds(options.occupancy_threshold);
  options.tree.store_reflectivity = options.reflectivity;
  return options;
}

}  // namespace

OccupancyMap::OccupancyMap(const Options& options)
    : options_(complete(options)), tree_(options_.tree), insertion_(new Insertion(options_)) {}

OccupancyMap::OccupancyMap(OccupancyMap&&) noexcept = default;

void OccupancyMap::setRange(double min_range, double max_range) {
  Options changed = options_;
  changed.min_range = min_range;
  changed.max_range = max_range;
  options_ = mapping_common::validate(changed);
}

void OccupancyMap::clear() {
  if (window_) window_->clear();
  tree_.clear();
  insertion_->working_set.clear();
  insertion_->decay.clear();
  if (insertion_->colors) insertion_->colors->clear();
}

const RTree& OccupancyMap::tree() const {
  if (window_) window_->bringInAll(tree_);
  return treeWithin(VoxelBox::all());
}

const RTree& OccupancyMap::treeWithin(const VoxelBox& region) const {
  return treeWhere([&region](const VoxelBox& block) { return region.overlaps(block); });
}

const RTree& OccupancyMap::treeIn(const std::vector<Block>& blocks) const {
  return treeWhere([&blocks](const VoxelBox& b) {
    return std::binary_search(blocks.begin(), blocks.end(), blockOf({b.min[0], b.min[1], b.min[2]}));
  });
}

const RTree& OccupancyMap::treeWhere(const std::function<bool(const VoxelBox&)>& asked_for) const {
  insertion_->working_set.writeBack(asked_for, tree_);
  return tree_;
}

// ---- insertion ----------------------------------------------------------------------------------

// Section 2.5.1: which voxels the scan occupies and which it frees, and for 2.5.2 which cells may expand.
void OccupancyMap::rasterize(const Scan& scan, InsertReport& report) {
  Insertion& in = *insertion_;
  in.raster.start();
  in.raster.setOrigin(scan.origin);
  in.reflectivity.clear();
  in.selected.clear();
  in.colored.clear();
  const bool beams = options_.sensor_model == SensorModel::kBeam;
  const bool expands = options_.fusion_strategy == FusionStrategy::kExpansion;
  const double inverse = 1.0 / options_.resolution;
  Eigen::Vector3f origin = scan.origin;
  const auto startAt = [&](const Eigen::Vector3f& start) {
    if (start == origin) return;
    origin = start;
    in.raster.setOrigin(start);
  };
  // Cells at random places along a beam, in proportion to its length (2.5.2, "Cell Selection").
  std::uniform_real_distribution<float> uniform(0.0F, 1.0F);
  const auto select = [&](const Voxel& v) {
    in.selected.push_back({in.raster.slotOf(blockOf(v)), indexInBlock(v), 0.0F});
  };
  const auto addBeam = [&](const Voxel& end_voxel, const Eigen::Vector3f& end) {
    in.raster.addBeam(end_voxel, end);
    if (!expands) return;
    const Eigen::Vector3f beam = end - origin;
    const int samples = static_cast<int>(beam.norm() * options_.samples_per_metre + uniform(in.random));
    Voxel voxel;
    for (int k = 0; k < samples; ++k) {
      if (toVoxel(origin + uniform(in.random) * beam, inverse, voxel)) select(voxel);
    }
  };
  // A beam that only clears, cut at max_range.
  const auto clear = [&](Eigen::Vector3f end) {
    const Eigen::Vector3f beam = end - origin;
    if (lengthOf(beam) > options_.max_range) {
      end = origin + unitVector(beam) * static_cast<float>(options_.max_range);
    }
    Voxel voxel;
    if (!toVoxel(end, inverse, voxel)) return false;
    if (beams) addBeam(voxel, end);
    return true;
  };

  const bool reflects = options_.reflectivity && !scan.reflectivity.empty(),
             colors = in.colors != nullptr && !scan.colors.empty(), is_more_than_a_point = reflects || colors;
  const bool limited = std::isfinite(options_.max_range);
  Voxel last_voxel{kMaxVoxel, 0, 0};
  VoxelBatch batch;
  const RowKernels& kernels = rowKernels();
  constexpr std::uint32_t kNoSlot = ~0u;
  std::uint32_t slot = kNoSlot;  // of the block of the last return with more than a point
  Block slot_block{};
  for (std::size_t i = 0; i < scan.hits.size(); ++i) {
    const Eigen::Vector3f& point = scan.hits[i];
    if (!scan.hit_origins.empty()) startAt(scan.hit_origins[i]);
    if (i % batch.size() == 0) {
      const std::size_t count = std::min(batch.size(), scan.hits.size() - i);
      kernels.to_voxels(point.data(), 3 * count, inverse, batch[0].data());
    }
    const Voxel& voxel = batch[i % batch.size()];
    if (!isInside(voxel)) {
      if (!point.allFinite()) {
        ++report.non_finite;
      } else if (lengthOf(point - origin) > options_.max_range && clear(point)) {
        ++report.beyond_range;
      } else {
        ++report.outside;
      }
      continue;
    }
    if (options_.min_range > 0.0 && (point - origin).norm() < options_.min_range) {
      ++report.too_near;
      continue;
    }
    const auto center = [&] {
      Eigen::Vector3f c;
      for (int k = 0; k < 3; ++k) c[k] = static_cast<float>((voxel[k] + 0.5) * options_.resolution);
      return c;
    };
    if (limited && lengthOf(center() - origin) > options_.max_range) {
      ++report.beyond_range;
      clear(center());
      continue;
    }
    ++report.hits;
    if (!isSame(voxel, last_voxel) && in.raster.markHit(voxel)) {
      if (beams) addBeam(voxel, center());
      if (expands) select(voxel);
    }
    last_voxel = voxel;
    if (!is_more_than_a_point) continue;
    if (const Block block = blockOf(voxel); slot == kNoSlot || !isSame(block, slot_block)) {
      slot = in.raster.slotOf(block);
      slot_block = block;
    }
    if (reflects && std::isfinite(scan.reflectivity[i]))
      in.reflectivity.push_back({slot, indexInBlock(voxel), scan.reflectivity[i]});
    if (colors) in.colored.push_back({slot, indexInBlock(voxel), scan.colors[i]});
  }
  for (std::size_t i = 0; i < scan.misses.size(); ++i) {
    const Eigen::Vector3f& end = scan.misses[i];
    startAt(scan.miss_origins.empty() ? scan.origin : scan.miss_origins[i]);
    if (!end.allFinite()) {
      ++report.non_finite;
    } else if (!clear(end)) {
      ++report.outside;
    }
  }
  in.raster.finish();
}

void OccupancyMap::check(const Scan& scan) const {
  const auto checkOrigin = [this](const Eigen::Vector3f& origin) {
    Voxel voxel;
    if (toVoxel(origin, 1.0 / options_.resolution, voxel)) return;
    std::ostringstream text;
    text << "the scan's origin is (" << origin.transpose() << ") m, allowed is +-"
         << -kMinVoxel * options_.resolution << " m along each axis with a resolution of "
         << options_.resolution << " m: for UTM and other coordinates of the earth, map in a frame near by";
    throw std::invalid_argument(text.str());
  };
  const auto checkSize = [](std::size_t size, const char* what, std::size_t expected, const char* of) {
    if (size == 0 || size == expected) return;
    throw std::invalid_argument("the scan has " + std::to_string(size) + what + std::to_string(expected) +
                                of);
  };
  checkOrigin(scan.origin);
  checkSize(scan.reflectivity.size(), " reflectivities for ", scan.hits.size(), " hits");
  checkSize(scan.colors.size(), " colours for ", scan.hits.size(), " hits");
  checkSize(scan.hit_origins.size(), " origins for ", scan.hits.size(), " hits");
  checkSize(scan.miss_origins.size(), " origins for ", scan.misses.size(), " misses");
  for (const Eigen::Vector3f& origin : scan.hit_origins) checkOrigin(origin);
  for (const Eigen::Vector3f& origin : scan.miss_origins) checkOrigin(origin);
}

InsertReport OccupancyMap::insertScan(const Scan& scan) {
  check(scan);
  InsertReport report;
  rasterize(scan, report);
  Insertion& in = *insertion_;
  if (window_) {
    std::vector<Block> touched;
    for (std::size_t slot = 0; slot < in.raster.size(); ++slot) touched.push_back(in.raster.block(slot));
    window_->startScan();
    window_->bringIn(touched, tree_);
  }
  Insertion::sortBySlot(in.reflectivity);
  Insertion::sortBySlot(in.selected);
  in.working_set.startScan();
  report.changed_blocks = in.forget(scan.time, tree_, window_.get());

  std::vector<WorkingSet::Entry*> entries(in.raster.size());
  for (std::size_t slot = 0; slot < entries.size(); ++slot) {
    const Block& block = in.raster.block(slot);
    entries[slot] = &in.working_set.at(block);
    if (in.decay.isOn() && in.raster.endsIn(slot)) in.decay.add(block);
  }
  std::vector<char> changed(entries.size());
  in.pool.run(entries.size(), kBlocksWorthSharing, [&](std::size_t slot, int worker) {
    changed[slot] = in.update(static_cast<std::uint32_t>(slot), *entries[slot], tree_, *in.buffers[worker]);
  });
  for (std::size_t slot = 0; slot < entries.size(); ++slot) {
    if (!changed[slot]) continue;
    in.working_set.setChanged(*entries[slot]);
    if (window_) window_->setChanged(entries[slot]->block);
    report.changed_blocks.push_back(entries[slot]->block);
  }
  std::vector<Block>& blocks = report.changed_blocks;
  if (in.colors) {
    const std::vector<Block> recolored = in.recolor(entries, changed);
    blocks.insert(blocks.end(), recolored.begin(), recolored.end());
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  in.working_set.trim(tree_);
  if (window_) {
    try {
      window_->trim(scan.origin.cast<double>(), in.working_set, tree_);
    } catch (const std::runtime_error& e) {
      report.window_error = e.what();
    }
  }
  return report;
}

bool OccupancyMap::Insertion::update(std::uint32_t slot, WorkingSet::Entry& entry, const RTree& tree,
                                     Buffer& buffer) const {
  if (!entry.loaded) working_set.load(entry, tree, buffer.dense);
  raster.gather(slot, buffer.mask);
  if (decay.isOn()) decay.see(entry.block, buffer.mask);
  const bool changed = entry.voxels.update(buffer.mask, model, settle, buffer.dense);
  std::vector<std::pair<int, float>> returns;
  for (auto [r, end] = marksOf(slot, reflectivity); r != end; ++r) returns.emplace_back(r->voxel, r->value);
  if (!returns.empty()) entry.voxels.addReflectivity(returns, buffer.dense);
  for (auto [s, end] = marksOf(slot, selected); s != end; ++s) entry.selected.push_back(s->voxel);
  return changed || !returns.empty() || !entry.selected.empty();
}

std::vector<Block> OccupancyMap::Insertion::recolor(const std::vector<WorkingSet::Entry*>& entries,
                                                    const std::vector<char>& changed) {
  // The returns, slot by slot.
  std::vector<std::uint32_t> begin(entries.size() + 1);
  for (const ColorMark& mark : colored) ++begin[mark.slot + 1];
  for (std::size_t slot = 0; slot < entries.size(); ++slot) begin[slot + 1] += begin[slot];
  struct Return {
    BlockColors::Index voxel;
    Color color;
  };
  std::vector<Return> returns(colored.size());
  std::vector<std::uint32_t> next(begin.begin(), begin.end() - 1);
  for (const ColorMark& mark : colored)
    returns[next[mark.slot]++] = {static_cast<BlockColors::Index>(mark.voxel), mark.color};

  struct Task {
    std::size_t slot;
    BlockColors* block;
    bool changed;
  };
  std::vector<Task> tasks;
  for (std::size_t slot = 0; slot < entries.size(); ++slot) {
    const Block& block = entries[slot]->block;
    if (begin[slot] != begin[slot + 1] || (changed[slot] != 0 && colors->find(block) != nullptr))
      tasks.push_back({slot, &colors->at(block), false});
  }
  pool.run(tasks.size(), kBlocksWorthSharing, [&](std::size_t i, int worker) {
    Task& task = tasks[i];
    std::vector<ColorSum>& sums = buffers[worker]->colors;  // by voxel, of those in `rows`
    sums.resize(kBlockRows * kBlockSize);
    BlockRows rows{};
    for (std::uint32_t k = begin[task.slot]; k < begin[task.slot + 1]; ++k) {
      const BlockColors::Index voxel = returns[k].voxel;
      std::uint32_t& row = rows[voxel / kBlockSize];
      const std::uint32_t bit = 1u << voxel % kBlockSize;
      if ((row & bit) == 0) sums[voxel] = {};
      row |= bit;
      sums[voxel].add(returns[k].color);
    }
    std::vector<BlockColors::Entry> seen;
    for (int row = 0; row < kBlockRows; ++row) {
      forEachBit(rows[row], [&](int z) {
        const int voxel = row * kBlockSize + z;
        seen.push_back({static_cast<BlockColors::Index>(voxel), sums[static_cast<std::size_t>(voxel)]});
      });
    }
    task.changed = task.block->update(seen, entries[task.slot]->voxels.occupied(model));
  });
  std::vector<Block> recolored;
  for (const Task& task : tasks) {
    const Block& block = entries[task.slot]->block;
    if (task.changed) recolored.push_back(block);
    colors->forgetEmpty(block);
  }
  return recolored;
}

std::vector<Block> OccupancyMap::Insertion::forget(double time, RTree& tree, RollingWindow* window) {
  std::vector<Block> changed;
  if (!decay.isOn()) return changed;
  const std::vector<Decay::Due> all_due = decay.advance(time);
  if (window != nullptr) {
    std::vector<Block> blocks;
    for (const Decay::Due& due : all_due) blocks.push_back(due.block);
    window->bringIn(blocks, tree);
  }
  DenseBlock& dense = buffers[0]->dense;
  for (const Decay::Due& due : all_due) {
    WorkingSet::Entry& entry = working_set.at(due.block);
    if (!entry.loaded) working_set.load(entry, tree, dense);
    bool any = entry.voxels.decay(due.seen.get(), model, dense);
    for (int step = 1; step < due.steps && entry.voxels.decay(nullptr, model, dense); ++step) any = true;
    if (!entry.voxels.anyOccupied(model)) decay.remove(due.block);
    if (!any) continue;
    keepColors(entry);
    working_set.setChanged(entry);
    if (window != nullptr) window->setChanged(due.block);
    changed.push_back(due.block);
  }
  return changed;
}

void OccupancyMap::startDecay() {
  if (!insertion_->decay.isOn()) return;
  const auto add = [this](const Cell& cell) {
    insertion_->decay.add(blockOf({cell.box.min[0], cell.box.min[1], cell.box.min[2]}));
    return true;
  };
  tree_.visitOccupied(add);
  if (window_) window_->outside().visitOccupied(add);
}

std::vector<Block> OccupancyMap::clearBox(const Eigen::Vector3d& min, const Eigen::Vector3d& max) {
  const VoxelBox box = boxOf(min, max);
  std::vector<Block> touched, changed;
  visitBox(box, [&](const Cell& cell) {
    touched.push_back(blockOf({cell.box.min[0], cell.box.min[1], cell.box.min[2]}));
    return true;
  });
  std::sort(touched.begin(), touched.end());
  touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
  if (window_) window_->bringIn(touched, tree_);
  Insertion& in = *insertion_;
  for (const Block& block : touched) {
    WorkingSet::Entry& entry = in.working_set.at(block);
    if (!entry.loaded) in.working_set.load(entry, tree_, in.buffers[0]->dense);
    if (!entry.voxels.setFree(localBox(intersect(box, boxOf(block)), boxOf(block)))) continue;
    in.keepColors(entry);
    in.working_set.setChanged(entry);
    if (window_) window_->setChanged(block);
    changed.push_back(block);
  }
  in.working_set.trim(tree_);
  return changed;
}

// ---- queries ------------------------------------------------------------------------------------

std::optional<Cell> OccupancyMap::cellAt(const Voxel& voxel) const {
  std::optional<Cell> found;
  visitBox(VoxelBox::unit(voxel), [&found](const Cell& cell) {
    found = cell;
    return false;
  });
  return found;
}

Voxel OccupancyMap::voxelAt(const Eigen::Vector3d& point) const {
  Voxel voxel;
  for (int i = 0; i < 3; ++i) {
    const double c = std::floor(point[i] / options_.resolution);
    voxel[i] = c >= kMinVoxel && c < kMaxVoxel ? static_cast<int>(c) : kMaxVoxel;
  }
  return voxel;
}

std::optional<Cell> OccupancyMap::cellAt(const Eigen::Vector3d& point) const {
  const Voxel voxel = voxelAt(point);
  if (!isInside(voxel)) return std::nullopt;
  return cellAt(voxel);
}

VoxelState OccupancyMap::stateAt(const Eigen::Vector3d& point) const {
  const std::optional<Cell> cell = cellAt(point);
  return !cell ? VoxelState::kUnknown : isOccupied(*cell) ? VoxelState::kOccupied : VoxelState::kFree;
}

std::vector<Cell> OccupancyMap::nearestOccupied(const Eigen::Vector3d& point, std::size_t k) const {
  std::vector<Cell> nearest;
  if (k == 0 || !point.allFinite()) return nearest;
  const auto squaredDistance = [&](const VoxelBox& box) {
    const Eigen::Vector3d outside = (minCorner(box) - point).cwiseMax(point - maxCorner(box)).cwiseMax(0.0);
    return outside.squaredNorm();
  };
  treeWithin(VoxelBox::all()).visitByDistance(true, squaredDistance, [&](const Cell& cell, double) {
    nearest.push_back(cell);
    return nearest.size() < k;
  });
  if (!window_) return nearest;
  const auto nearer = [&](const Cell& a, const Cell& b) {
    return squaredDistance(a.box) < squaredDistance(b.box);
  };
  window_->outside().visitByDistance(true, squaredDistance, [&](const Cell& block, double distance) {
    if (nearest.size() == k && distance >= squaredDistance(nearest.back().box)) return false;
    const Block at = blockOf(Voxel{block.box.min[0], block.box.min[1], block.box.min[2]});
    const RollingWindow::Cells cells = window_->cellsOf(at);
    std::copy_if(cells->begin(), cells->end(), std::back_inserter(nearest),
                 [this](const Cell& cell) { return isOccupied(cell); });
    std::stable_sort(nearest.begin(), nearest.end(), nearer);
    if (nearest.size() > k) nearest.resize(k);
    return true;
  });
  return nearest;
}

bool OccupancyMap::visitOutside(const VoxelBox& box, bool occupied_only,
                                const std::function<bool(const Cell&)>& visit) const {
  return window_->visit(box, occupied_only, visit);
}

std::size_t OccupancyMap::size() const {
  return treeWithin(VoxelBox::all()).size() + (window_ ? window_->totals().cells : 0);
}

VoxelBox OccupancyMap::bounds() const {
  const VoxelBox inside = treeWithin(VoxelBox::all()).bounds();
  return window_ ? unite(inside, window_->outside().bounds()) : inside;
}

std::vector<Block> OccupancyMap::blocks() const {
  std::vector<Block> blocks;
  treeWithin(VoxelBox::all()).visitAll([&blocks](const Cell& cell) {
    const Block block = blockOf(Voxel{cell.box.min[0], cell.box.min[1], cell.box.min[2]});
    if (blocks.empty() || blocks.back() != block) blocks.push_back(block);
    return true;
  });
  if (window_) window_->addBlocks(blocks);
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

std::size_t OccupancyMap::memoryUsage() const {
  return tree_.memoryUsage() + insertion_->working_set.memoryUsage() + insertion_->decay.memoryUsage() +
         (insertion_->colors ? insertion_->colors->memoryUsage() : 0) +
         (window_ ? window_->memoryUsage() : 0);
}

Statistics OccupancyMap::statistics() const {
  Statistics s;
  std::int64_t occupied = 0, free = 0;
  treeWithin(VoxelBox::all()).visitAll([&](const Cell& cell) {
    const bool is_occupied = isOccupied(cell);
    ++(is_occupied ? s.occupied_cells : s.free_cells);
    (is_occupied ? occupied : free) += cell.box.volume();
    return true;
  });
  const double voxel = std::pow(options_.resolution, 3);
  s.cells = tree_.size();
  s.occupied_volume = static_cast<double>(occupied) * voxel;
  s.free_volume = static_cast<double>(free) * voxel;
  if (window_) {
    const Statistics& outside = window_->totals();
    s.cells += outside.cells;
    s.occupied_cells += outside.occupied_cells;
    s.free_cells += outside.free_cells;
    s.occupied_volume += outside.occupied_volume;
    s.free_volume += outside.free_volume;
  }
  s.nodes = tree_.numNodes();
  s.height = tree_.height();
  s.memory_bytes = memoryUsage();
  return s;
}

// ---- colours ------------------------------------------------------------------------------------

void OccupancyMap::setColor(bool color) {
  if (color && window_) throw std::invalid_argument(kNoColorsInWindow);
  if (color == options_.color) return;
  options_.color = color;
  insertion_->colors = color ? std::make_unique<ColorLayer>() : nullptr;
}

const BlockColors* OccupancyMap::colorsIn(const Block& block) const {
  return insertion_->colors ? insertion_->colors->find(block) : nullptr;
}

std::optional<Color> OccupancyMap::colorOf(const Cell& cell) const {
  const Block block = blockOf(Voxel{cell.box.min[0], cell.box.min[1], cell.box.min[2]});
  const BlockColors* colors = colorsIn(block);
  if (colors == nullptr) return std::nullopt;
  return colors->meanIn(localBox(cell.box, boxOf(block)));
}

std::optional<Color> OccupancyMap::colorAt(const Eigen::Vector3d& point) const {
  const Voxel voxel = voxelAt(point);
  if (!isInside(voxel)) return std::nullopt;
  Cell cell;
  cell.box = VoxelBox::unit(voxel);
  return colorOf(cell);
}

std::vector<ColoredVoxel> OccupancyMap::coloredVoxels() const {
  std::vector<ColoredVoxel> all;
  if (!insertion_->colors) return all;
  for (const auto& [block, colors] : insertion_->colors->blocks()) {
    for (std::size_t i = 0; i < colors.size(); ++i)
      all.push_back({voxelIn(block, colors.voxel(i)), colors.color(i)});
  }
  return all;
}

void OccupancyMap::addColors(const std::vector<ColoredVoxel>& colors) {
  if (!insertion_->colors) return;
  std::map<Block, std::vector<BlockColors::Entry>> by_block;
  for (const ColoredVoxel& c : colors)
    by_block[blockOf(c.voxel)].push_back({static_cast<BlockColors::Index>(indexInBlock(c.voxel)), c.color});
  for (auto& [block, seen] : by_block) {
    std::stable_sort(seen.begin(), seen.end(),
                     [](const auto& a, const auto& b) { return a.voxel < b.voxel; });
    const VoxelBox box = boxOf(block);
    BlockRows occupied{};
    visitOccupied(box, [&](const Cell& cell) {
      const VoxelBox local = localBox(cell.box, box);
      for (int y = local.min[1]; y < local.max[1]; ++y)
        for (int x = local.min[0]; x < local.max[0]; ++x)
          occupied[y * kBlockSize + x] |= bits(local.min[2], local.max[2]);
      return true;
    });
    insertion_->colors->at(block).update(seen, occupied);
    insertion_->colors->forgetEmpty(block);
  }
}

// ---- rolling window -----------------------------------------------------------------------------

OccupancyMap& OccupancyMap::operator=(OccupancyMap&& other) noexcept {
  if (this == &other) return *this;
  flushQuietly();
  options_ = std::move(other.options_);
  tree_ = std::move(other.tree_);
  insertion_ = std::move(other.insertion_);
  window_ = std::move(other.window_);
  return *this;
}

OccupancyMap::~OccupancyMap() {
  flushQuietly();
}

void OccupancyMap::flushQuietly() noexcept {
  try {
    if (insertion_) flush();
  } catch (const std::exception&) {
  }
}

void OccupancyMap::flush() {
  if (window_) window_->flush(insertion_->working_set, tree_);
}

OccupancyMap OccupancyMap::openStore(const WindowOptions& window, const Options& machine, bool writes) {
  using Access = BlockStore::Access;
  const Options options = withMachine(BlockStore::open(window.file, Access::kRead)->options(), machine);
  OccupancyMap map(options);
  map.window_.reset(new RollingWindow(window, options, writes ? Access::kWrite : Access::kRead));
  map.startDecay();
  return map;
}

OccupancyMap OccupancyMap::open(const WindowOptions& window, const Options& machine) {
  return openStore(window, machine, true);
}

void OccupancyMap::keepIn(const WindowOptions& window) {
  mapping_common::validate(window);
  if (options_.color) throw std::invalid_argument(kNoColorsInWindow);
  if (window_ && window_->isIn(window.file))
    throw std::invalid_argument(window.file + " is the map's store already");
  BlockStore::create(window.file, *this);
  std::unique_ptr<RollingWindow> kept(new RollingWindow(window, options_, BlockStore::Access::kWrite));
  tree_.clear();
  insertion_->working_set.clear();
  window_ = std::move(kept);
}

// ---- conversions --------------------------------------------------------------------------------

double OccupancyMap::probability(float log_odds) {
  return 1.0 / (1.0 + std::exp(-static_cast<double>(log_odds)));
}

Eigen::Vector3d OccupancyMap::minCorner(const VoxelBox& b) const {
  return options_.resolution * Eigen::Vector3d(b.min[0], b.min[1], b.min[2]);
}

Eigen::Vector3d OccupancyMap::maxCorner(const VoxelBox& b) const {
  return options_.resolution * Eigen::Vector3d(b.max[0], b.max[1], b.max[2]);
}

VoxelBox voxelsWithin(const Eigen::Vector3d& min, const Eigen::Vector3d& max, double resolution) {
  VoxelBox box;
  if (!(min.array() <= max.array()).all()) return VoxelBox::empty();  // NaN as well
  const auto cut = [](double c) {
    return static_cast<std::int16_t>(std::clamp<double>(c, kMinVoxel, kMaxVoxel));
  };
  for (int i = 0; i < 3; ++i) {
    box.min[i] = cut(std::floor(min[i] / resolution + kRounding));
    box.max[i] = cut(std::ceil(max[i] / resolution - kRounding));
  }
  return box;
}

VoxelBox OccupancyMap::boxOf(const Block& block) {
  VoxelBox box;
  for (int i = 0; i < 3; ++i) {
    if (block[i] < kMinVoxel / kBlockSize || block[i] >= kMaxVoxel / kBlockSize) return VoxelBox::empty();
    box.min[i] = static_cast<std::int16_t>(block[i] * kBlockSize);
    box.max[i] = static_cast<std::int16_t>(box.min[i] + kBlockSize);
  }
  return box;
}

}  // namespace rtree_occupancy_map
