// SPDX-License-Identifier: BSD-3-Clause
#include "working_set.h"

#include <algorithm>
#include <iterator>
#include <mutex>
#include <utility>

#include "block_index.h"

namespace rtree_occupancy_map {
namespace {

// A block that so many scans have not touched has most probably been left behind.
constexpr std::uint64_t kIdleScans = 5;

}  // namespace

WorkingSet::WorkingSet(const Options& options, WorkerPool& pool)
    : options_(options), model_(options), pool_(pool) {
  for (int i = 0; i < pool.size(); ++i) grids_.emplace_back(new BlockGrid(options));
}

WorkingSet::Entry& WorkingSet::at(const Block& block) {
  std::unique_ptr<Entry>& entry = entries_[keyOf(block)];
  if (!entry) {
    entry.reset(new Entry);
    entry->block = block;
  }
  entry->last_scan = scan_;
  return *entry;
}

void WorkingSet::load(Entry& entry, const RTree& tree, DenseBlock& buffer) const {
  entry.voxels.start();
  const VoxelBox block = OccupancyMap::boxOf(entry.block);
  tree.visitLeaves(block, [&](const RTree::Leaf& leaf) {
    for (int i = 0; i < leaf.size(); ++i) {
      if (!block.contains(leaf.box(i))) continue;
      entry.voxels.add(localBox(leaf.box(i), block), leaf.logOdds(i), leaf.reflectivity(i), model_, buffer);
    }
  });
  entry.voxels.pack(buffer);
  entry.loaded = true;
}

void WorkingSet::setChanged(Entry& entry) {
  if (!entry.changed) changed_.push_back(&entry);
  entry.changed = true;
}

void WorkingSet::fuse(Entry& entry, const RTree& tree, BlockGrid& grid, std::vector<Cell>& cells) const {
  std::vector<VoxelBox> boxes;
  if (options_.fusion_strategy == FusionStrategy::kExpansion) {
    tree.visitContained(OccupancyMap::boxOf(entry.block), [&boxes](const Cell& cell) {
      boxes.push_back(cell.box);
      return true;
    });
  }
  grid.fuse(entry.block, entry.voxels, boxes, entry.selected, cells);
  entry.selected.clear();
  entry.changed = false;
  entry.loaded = !options_.reflectivity;  // its voxels have their cells' means from now on
}

// Blocks are divided side by side, but enter the tree one after the other in their order, so that the tree
// doesn't depend on who was faster.
void WorkingSet::writeBack(const std::vector<Entry*>& entries, RTree& tree) {
  if (dependsOnCells()) {
    std::vector<Cell> cells;
    for (Entry* entry : entries) {
      fuse(*entry, tree, *grids_[0], cells);
      tree.replace(OccupancyMap::boxOf(entry->block), cells);
    }
    return;
  }
  std::vector<std::unique_ptr<std::vector<Cell>>> ready(entries.size()), spare;
  std::mutex mutex;
  std::size_t next = 0;
  bool replacing = false;
  pool_.run(entries.size(), kBlocksWorthSharing, [&](std::size_t i, int worker) {
    std::unique_ptr<std::vector<Cell>> cells;
    std::unique_lock<std::mutex> lock(mutex);
    if (!spare.empty()) {
      cells = std::move(spare.back());
      spare.pop_back();
    }
    lock.unlock();
    if (!cells) cells = std::make_unique<std::vector<Cell>>();
    fuse(*entries[i], tree, *grids_[worker], *cells);
    lock.lock();
    ready[i] = std::move(cells);
    if (replacing) return;  // somebody will find it
    replacing = true;
    for (; next < ready.size() && ready[next]; ++next) {
      lock.unlock();
      tree.replace(OccupancyMap::boxOf(entries[next]->block), *ready[next]);
      lock.lock();
      spare.push_back(std::move(ready[next]));
    }
    replacing = false;
  });
}

void WorkingSet::writeBack(const std::function<bool(const VoxelBox&)>& asked_for, RTree& tree) {
  if (changed_.empty()) return;
  const auto first = std::partition(changed_.begin(), changed_.end(), [&asked_for](const Entry* e) {
    return !asked_for(OccupancyMap::boxOf(e->block));
  });
  std::sort(first, changed_.end(), [](const Entry* a, const Entry* b) { return a->block < b->block; });
  const std::vector<Entry*> entries(first, changed_.end());
  changed_.erase(first, changed_.end());
  writeBack(entries, tree);
}

void WorkingSet::trim(RTree& tree) {
  if (dependsOnCells()) writeBack([](const VoxelBox&) { return true; }, tree);

  std::vector<Entry*> by_use;
  for (const auto& entry : entries_) by_use.push_back(entry.second.get());
  std::sort(by_use.begin(), by_use.end(), [](const Entry* a, const Entry* b) {
    return std::make_pair(a->last_scan, a->block) < std::make_pair(b->last_scan, b->block);
  });
  std::size_t memory = memoryUsage(), leaving = 0;
  for (; leaving < by_use.size(); ++leaving) {
    const Entry& entry = *by_use[leaving];
    if (entry.last_scan + kIdleScans > scan_ &&
        static_cast<double>(memory) <= options_.working_set_memory * (1 << 20))
      break;
    memory -= std::min(memory, sizeof(Entry) - sizeof(BlockVoxels) + entry.voxels.memoryUsage());
  }
  by_use.resize(leaving);
  letGo(by_use, tree);
}

void WorkingSet::letGo(const std::vector<Entry*>& entries, RTree& tree) {
  std::vector<Entry*> out_of_date;
  std::copy_if(entries.begin(), entries.end(), std::back_inserter(out_of_date),
               [](const Entry* e) { return e->changed; });
  writeBack(out_of_date, tree);
  const auto is_current = [](const Entry* e) { return !e->changed; };
  changed_.erase(std::remove_if(changed_.begin(), changed_.end(), is_current), changed_.end());
  for (const Entry* entry : entries) entries_.erase(keyOf(entry->block));
}

void WorkingSet::release(const std::vector<Block>& blocks, RTree& tree) {
  std::vector<Entry*> entries;
  for (const Block& block : blocks) {
    const auto found = entries_.find(keyOf(block));
    if (found != entries_.end()) entries.push_back(found->second.get());
  }
  letGo(entries, tree);
}

bool WorkingSet::contains(const Block& block) const {
  return entries_.count(keyOf(block)) > 0;
}

void WorkingSet::clear() {
  entries_.clear();
  changed_.clear();
}

std::size_t WorkingSet::memoryUsage() const {
  std::size_t bytes = entries_.bucket_count() * sizeof(void*) + changed_.capacity() * sizeof(Entry*);
  for (const auto& entry : entries_) {
    bytes += sizeof(Entry) - sizeof(BlockVoxels) + entry.second->voxels.memoryUsage() + 4 * sizeof(void*);
  }
  return bytes;
}

}  // namespace rtree_occupancy_map
