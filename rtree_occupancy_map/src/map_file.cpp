// SPDX-License-Identifier: BSD-3-Clause
//
// Map files are archives (mapping_common/archive.h) of the options, the number of cells (uint64) and the
// cells: min and max corner as 6 int16, log odds as float32, with reflectivity its mean as float32 and its
// hits as uint32. A new option needs no new version where its default does what maps did before it.
// With colours there follow the number of blocks that have some (uint64) and of each its coordinates (int32)
// and the number of its coloured voxels (uint32), and of each voxel of these, in ascending order, its index
// in the block (uint16), the sums of red, green and blue and the number of returns (uint32).
#include <mapping_common/archive.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <optional>
#include <stdexcept>

#include "block_store.h"
#include "color_layer.h"
#include "insertion.h"
#include "log_odds.h"
#include "machine_options.h"
#include "rolling_window.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::ArchiveReader;
using mapping_common::ArchiveWriter;

constexpr mapping_common::ArchiveFormat kFormat = {"RTREEMAP", "an R-tree occupancy map", 1, 2, 1};

// Version 1 has enums and splits as numbers, and all options in this order.
template <class Enum>
void readEnum(ArchiveReader& read, Enum& value) {
  const auto number = static_cast<Enum>(read.next<std::int32_t>());
  if (mapping_common::nameOf(number).empty()) throw std::runtime_error("its options are out of range");
  value = number;
}

void readOptions1(ArchiveReader& read, Options& o) {
  for (double* value : {&o.resolution, &o.prob_hit, &o.prob_miss, &o.clamping_min, &o.clamping_max, &o.prior,
                        &o.occupancy_threshold, &o.min_range, &o.max_range})
    read(*value);
  readEnum(read, o.sensor_model);
  readEnum(read, o.fusion_rule);
  readEnum(read, o.fusion_strategy);
  read(o.search_order);
  read(o.samples_per_metre);
  read(o.seed);
  read(o.dynamic);
  read(o.reflectivity);
  read(o.tree.min_entries);
  read(o.tree.max_entries);
  constexpr const char* kSplits[] = {"quadratic", "linear", "rstar"};
  const auto split = read.next<std::uint32_t>();
  if (split >= std::size(kSplits)) throw std::runtime_error("its options are out of range");
  o.tree.split = kSplits[split];
}

Options readOptions(ArchiveReader& read) {
  Options options;
  if (read.version() == 1) {
    readOptions1(read, options);
  } else {
    read(mapping_common::optionsOf(options));
  }
  return mapping_common::validate(options);
}

Cell readCell(ArchiveReader& read, const Options& options, const LogOddsModel& model) {
  Cell cell;
  read(cell.box);
  read(cell.log_odds);
  if (options.reflectivity) read(cell.reflectivity);
  for (int i = 0; i < 3; ++i) {
    const bool one_block = cell.box.min[i] >> kBlockBits == (cell.box.max[i] - 1) >> kBlockBits;
    if (cell.box.width(i) <= 0 || !one_block || cell.box.min[i] < kMinVoxel || cell.box.max[i] > kMaxVoxel) {
      throw std::runtime_error("it holds a cell that isn't a cuboid within a block");
    }
  }
  if (cell.reflectivity.hits > 0 && !std::isfinite(cell.reflectivity.mean)) {
    throw std::runtime_error("it holds a reflectivity that isn't finite");
  }
  if (!(cell.log_odds >= model.min && cell.log_odds <= model.max)) {
    throw std::runtime_error("it holds log odds beyond the clamping thresholds");
  }
  return cell;
}

void writeColors(const ColorLayer& layer, ArchiveWriter& write) {
  write(static_cast<std::uint64_t>(layer.blocks().size()));
  for (const auto& [block, colors] : layer.blocks()) {
    for (const int coordinate : block) write(static_cast<std::int32_t>(coordinate));
    write(static_cast<std::uint32_t>(colors.size()));
    for (std::size_t i = 0; i < colors.size(); ++i) {
      write(colors.voxel(i));
      write(colors.color(i).sum);
      write(colors.color(i).returns);
    }
  }
}

std::vector<ColoredVoxel> readColors(ArchiveReader& read) {
  std::vector<ColoredVoxel> all;
  std::optional<Block> last_block;
  constexpr std::size_t kBlockHead = 4 * sizeof(std::uint32_t);
  for (std::size_t blocks = read.count(kBlockHead); blocks > 0; --blocks) {
    Block block;
    for (int& coordinate : block) coordinate = read.next<std::int32_t>();
    if (OccupancyMap::boxOf(block).isEmpty() || (last_block && !(*last_block < block)))
      throw std::runtime_error("it holds colours out of order");
    last_block = block;
    int last_voxel = -1;
    for (auto voxels = read.next<std::uint32_t>(); voxels > 0; --voxels) {
      const auto voxel = read.next<BlockColors::Index>();
      ColorSum color;
      read(color.sum);
      read(color.returns);
      if (voxel <= last_voxel || voxel >= kBlockRows * kBlockSize || !color.isSound())
        throw std::runtime_error("it holds colours out of order or range");
      last_voxel = voxel;
      all.push_back({voxelIn(block, voxel), color});
    }
  }
  return all;
}

bool isStore(const std::string& path) {
  return std::filesystem::path(path).extension() == ".db";
}

}  // namespace

void OccupancyMap::write(ArchiveWriter& write) const {
  Options options = withMachine(options_, Options());
  const std::vector<mapping_common::Option> in_files = optionsInFiles(options);
  write(static_cast<std::uint32_t>(in_files.size()));
  for (const mapping_common::Option& option : in_files) {
    write(option.name());
    write(option.word());
  }
  write(static_cast<std::uint64_t>(size()));
  visitAll([&](const Cell& cell) {
    write(cell.box);
    write(cell.log_odds);
    if (options_.reflectivity) write(cell.reflectivity);
    return true;
  });
  if (insertion_->colors) writeColors(*insertion_->colors, write);
}

OccupancyMap OccupancyMap::read(ArchiveReader& read, const Options& machine) {
  const Options options = withMachine(readOptions(read), machine);
  const auto count = read.next<std::uint64_t>();
  const std::size_t cell_size =
      sizeof(VoxelBox) + sizeof(float) + (options.reflectivity ? sizeof(Reflectivity) : 0);
  const bool fits = options.color ? count <= read.left() / cell_size
                                  : read.left() / cell_size == count && read.left() % cell_size == 0;
  if (!fits) {
    throw std::runtime_error("its number of cells and its size don't agree");
  }
  const LogOddsModel model(options);
  std::vector<Cell> cells;
  cells.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) cells.push_back(readCell(read, options, model));
  OccupancyMap map = restore(options, std::move(cells));
  if (options.color) {
    const std::vector<ColoredVoxel> colors = readColors(read);
    map.addColors(colors);
    std::size_t taken = 0;
    for (const auto& [block, some] : map.insertion_->colors->blocks()) taken += some.size();
    if (taken != colors.size()) throw std::runtime_error("it holds colours of what isn't occupied");
  }
  return map;
}

void OccupancyMap::save(const std::string& path) const {
  if (isStore(path)) {
    if (window_ && window_->isIn(path))
      throw std::runtime_error(path + " is the map's own store, which it is in");
    return BlockStore::create(path, *this);
  }
  mapping_common::writeArchive(path, kFormat, [this](ArchiveWriter& to) { write(to); });
}

std::string OccupancyMap::toBytes() const {
  return mapping_common::toArchive(kFormat, [this](ArchiveWriter& to) { write(to); });
}

OccupancyMap OccupancyMap::load(const std::string& path, const Options& machine) {
  if (isStore(path)) {
    WindowOptions window;
    window.file = path;
    return openStore(window, machine, false);
  }
  OccupancyMap map;
  mapping_common::readArchive(path, kFormat, [&](ArchiveReader& from) { map = read(from, machine); });
  return map;
}

OccupancyMap OccupancyMap::fromBytes(const char* begin, const char* end, const std::string& name,
                                     const Options& machine) {
  OccupancyMap map;
  mapping_common::readArchive(begin, end, name, kFormat,
                              [&](ArchiveReader& from) { map = read(from, machine); });
  return map;
}

OccupancyMap OccupancyMap::restore(const Options& options, std::vector<Cell> cells) {
  OccupancyMap map(options);
  const LogOddsModel& model = map.insertion_->model;
  DenseBlock& dense = map.insertion_->buffers[0]->dense;
  BlockVoxels voxels;
  const auto block = [](const Cell& c) { return blockOf(Voxel{c.box.min[0], c.box.min[1], c.box.min[2]}); };
  std::stable_sort(cells.begin(), cells.end(),
                   [&block](const Cell& a, const Cell& b) { return block(a) < block(b); });
  for (auto first = cells.begin(); first != cells.end();) {
    const Block here = block(*first);
    voxels.start();
    std::int64_t volume = 0;
    for (; first != cells.end() && block(*first) == here; ++first) {
      voxels.add(localBox(first->box, boxOf(here)), first->log_odds, first->reflectivity, model, dense);
      volume += first->box.volume();
    }
    if (voxels.knownVoxels() != volume) throw std::runtime_error("it holds cells that overlap");
  }
  map.tree_.bulkLoad(std::move(cells));
  map.startDecay();
  return map;
}

}  // namespace rtree_occupancy_map
