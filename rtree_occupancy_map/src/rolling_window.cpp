// SPDX-License-Identifier: BSD-3-Clause
#include "rolling_window.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <tuple>
#include <utility>

#include "block_index.h"
#include "log_odds.h"

namespace rtree_occupancy_map {
namespace {

// The share of the memory that blocks may take which queries have read.
constexpr double kShareOfQueries = 0.25;

RTreeOptions indexOptions() {
  RTreeOptions options;
  options.occupied_log_odds = 0.5F;
  return options;
}

Cell indexCell(const BlockSummary& summary) {
  Cell cell;
  cell.box = summary.box;
  cell.log_odds = summary.occupied_cells > 0 ? 1.0F : 0.0F;
  return cell;
}

Block blockOf(const VoxelBox& box) {
  return OccupancyMap::blockOf({box.min[0], box.min[1], box.min[2]});
}

double bytesOf(double mebibytes) {
  return mebibytes * (1 << 20);
}

}  // namespace

RollingWindow::RollingWindow(const WindowOptions& options, const Options& map, BlockStore::Access access)
    : options_(mapping_common::validate(options)),
      resolution_(map.resolution),
      occupied_log_odds_(logOdds(map.occupancy_threshold)),
      store_(BlockStore::open(options.file, access)),
      index_(indexOptions()) {
  std::vector<Cell> boxes;
  store_->visitSummaries([&](const Block& block, const BlockSummary& summary) {
    outside_.emplace(keyOf(block), summary);
    count(summary, 1);
    boxes.push_back(indexCell(summary));
  });
  index_.bulkLoad(std::move(boxes));
}

bool RollingWindow::isIn(const std::string& path) const {
  std::error_code none;
  return std::filesystem::equivalent(path, options_.file, none);
}

void RollingWindow::count(const BlockSummary& s, int sign) {
  const auto add = [sign](std::size_t& sum, std::size_t n) { sum = sign > 0 ? sum + n : sum - n; };
  const double voxel = sign * std::pow(resolution_, 3);
  add(totals_.cells, s.cells);
  add(totals_.occupied_cells, s.occupied_cells);
  add(totals_.free_cells, s.cells - s.occupied_cells);
  totals_.occupied_volume += voxel * s.occupied_volume;
  totals_.free_volume += voxel * s.free_volume;
}

void RollingWindow::bringIn(const std::vector<Block>& blocks, RTree& tree) {
  for (const Block& block : blocks) {
    const std::uint64_t key = keyOf(block);
    Inside& inside = inside_[key];
    inside.block = block;
    inside.last_scan = scan_;
    const auto found = outside_.find(key);
    if (found == outside_.end()) continue;
    const Cells known = cellsOf(block);
    tree.replace(OccupancyMap::boxOf(block), *known);
    inside.summary = found->second;
    count(inside.summary, -1);
    index_.erase(inside.summary.box);
    outside_.erase(found);
    read_bytes_ -= known->size() * sizeof(Cell);
    read_.erase(key);
  }
}

void RollingWindow::bringInAll(RTree& tree) {
  std::vector<Block> blocks;
  addBlocks(blocks);
  bringIn(blocks, tree);
}

void RollingWindow::setChanged(const Block& block) {
  inside_.at(keyOf(block)).changed = true;
}

double RollingWindow::distance(const Block& block, const Eigen::Vector3d& position) const {
  const double edge = kBlockSize * resolution_;
  const Eigen::Vector3d min = edge * Eigen::Vector3d(block[0], block[1], block[2]);
  return (min - position).cwiseMax(position - min - Eigen::Vector3d::Constant(edge)).cwiseMax(0.0).norm();
}

void RollingWindow::trim(const Eigen::Vector3d& position, WorkingSet& working_set, RTree& tree) {
  struct Candidate {
    std::uint64_t last_scan;
    double nearness;  // -m
    Inside* inside;
    bool operator<(const Candidate& o) const {
      return std::tie(last_scan, nearness, inside->block) <
             std::tie(o.last_scan, o.nearness, o.inside->block);
    }
  };
  std::vector<Inside*> leaving;
  std::vector<Candidate> others;
  for (auto& [key, inside] : inside_) {
    if (inside.last_scan == scan_ || (inside.changed && !store_->writes())) continue;
    const double away = distance(inside.block, position);
    if (away > options_.distance && !working_set.contains(inside.block)) {
      leaving.push_back(&inside);
    } else {
      others.push_back({inside.last_scan, -away, &inside});
    }
  }
  const double each =
      static_cast<double>(tree.usedMemory()) / static_cast<double>(std::max<std::size_t>(1, inside_.size()));
  const double excess = static_cast<double>(tree.usedMemory()) - each * static_cast<double>(leaving.size()) -
                        bytesOf(options_.memory);
  if (excess > 0.0) {
    const std::size_t more = std::min(others.size(), static_cast<std::size_t>(std::ceil(excess / each)));
    std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(more), others.end());
    for (std::size_t i = 0; i < more; ++i) leaving.push_back(others[i].inside);
  }
  if (!leaving.empty()) letGo(leaving, working_set, tree);
}

void RollingWindow::write(const std::vector<Inside*>& blocks, const RTree& tree) {
  std::vector<Inside*> changed;
  std::copy_if(blocks.begin(), blocks.end(), std::back_inserter(changed),
               [](const Inside* i) { return i->changed; });
  if (changed.empty()) return;
  std::vector<BlockSummary> summaries;
  std::vector<Cell> cells;
  store_->transaction([&] {
    for (const Inside* inside : changed) {
      cells.clear();
      tree.visitContained(OccupancyMap::boxOf(inside->block), [&cells](const Cell& cell) {
        cells.push_back(cell);
        return true;
      });
      summaries.push_back(store_->write(inside->block, cells));
    }
  });
  for (std::size_t i = 0; i < changed.size(); ++i) {
    changed[i]->summary = summaries[i];
    changed[i]->changed = false;
  }
}

void RollingWindow::letGo(const std::vector<Inside*>& leaving, WorkingSet& working_set, RTree& tree) {
  std::vector<Block> blocks;
  for (const Inside* inside : leaving) blocks.push_back(inside->block);
  working_set.release(blocks, tree);
  write(leaving, tree);
  for (const Inside* inside : leaving) {
    const std::uint64_t key = keyOf(inside->block);
    tree.replace(OccupancyMap::boxOf(inside->block), {});
    if (inside->summary.cells > 0) {
      count(inside->summary, 1);
      index_.insert(indexCell(inside->summary));
      outside_.emplace(key, inside->summary);
    }
    inside_.erase(key);
  }
  tree.shrink();
}

void RollingWindow::flush(WorkingSet& working_set, RTree& tree) {
  if (!store_->writes()) return;
  working_set.writeBack([](const VoxelBox&) { return true; }, tree);
  std::vector<Inside*> all;
  for (auto& [key, inside] : inside_) all.push_back(&inside);
  write(all, tree);
}

void RollingWindow::clear() {
  if (store_->writes()) store_->clear();
  inside_.clear();
  outside_.clear();
  index_.clear();
  totals_ = {};
  read_.clear();
  read_bytes_ = 0;
}

RollingWindow::Cells RollingWindow::cellsOf(const Block& block) const {
  const std::uint64_t key = keyOf(block);
  const auto found = read_.find(key);
  if (found != read_.end()) return found->second;
  const Cells cells = std::make_shared<const std::vector<Cell>>(store_->read(block));
  const std::size_t bytes = cells->size() * sizeof(Cell);
  if (static_cast<double>(read_bytes_ + bytes) > kShareOfQueries * bytesOf(options_.memory)) {
    read_.clear();
    read_bytes_ = 0;
  }
  read_.emplace(key, cells);
  read_bytes_ += bytes;
  return cells;
}

bool RollingWindow::visit(const VoxelBox& box, bool occupied_only,
                          const std::function<bool(const Cell&)>& visit) const {
  const auto enter = [&box](const VoxelBox& b) { return box.overlaps(b); };
  const auto visitBlock = [&](const Cell& block) {
    const Cells cells = cellsOf(blockOf(block.box));
    return std::all_of(cells->begin(), cells->end(), [&](const Cell& cell) {
      return !box.overlaps(cell.box) || (occupied_only && cell.log_odds < occupied_log_odds_) || visit(cell);
    });
  };
  return occupied_only ? index_.visitOccupiedIf(enter, visitBlock) : index_.visitIf(enter, visitBlock);
}

void RollingWindow::addBlocks(std::vector<Block>& blocks) const {
  for (const auto& [key, summary] : outside_) blocks.push_back(blockOf(summary.box));
}

std::size_t RollingWindow::memoryUsage() const {
  const auto table = [](const auto& map) {
    return map.bucket_count() * sizeof(void*) + map.size() * (sizeof(*map.begin()) + 2 * sizeof(void*));
  };
  return table(inside_) + table(outside_) + table(read_) + read_bytes_ + index_.memoryUsage();
}

}  // namespace rtree_occupancy_map
