// SPDX-License-Identifier: BSD-3-Clause
//
// Map files are archives (mapping_common/archive.h) of the number of levels (uint32), then of each level the
// resolution (float64), the first and the last cell of its box (4 int32), the number of tiles (uint64), and
// of each the cell at its corner (2 int32) and GridMap::Tile, compressed (mapping_common/compression.h).
// Version 2 has, after the resolution, the corner (2 float64), the size and the box of its known cells,
// counted from the corner (6 int32), and of these cells occupancy and reflectivity (float32) and count
// (uint16), row by row. Version 1 has another checksum.
#include <mapping_common/archive.h>
#include <mapping_common/compression.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "intensity_hector_slam/multi_map.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::ArchiveReader;
using mapping_common::ArchiveWriter;

constexpr mapping_common::ArchiveFormat kFormat = {"RFLSLAM1", "a reflectivity SLAM map", 1, 3, 1};

void writeLevel(ArchiveWriter& write, const GridMap& map) {
  write(map.resolution());
  for (const Eigen::Vector2i& cell : {map.box().min(), map.box().max()}) {
    for (const int value : cell) write(static_cast<std::int32_t>(value));
  }
  std::uint64_t tiles = 0;
  map.forTiles([&](const auto&, const auto&) { ++tiles; });
  write(tiles);
  map.forTiles([&](const GridMap::Tile& tile, const Eigen::AlignedBox2i& box) {
    for (const int value : box.min()) write(static_cast<std::int32_t>(value));
    write(mapping_common::compress({reinterpret_cast<const char*>(&tile), sizeof(tile)}));
  });
}

std::array<int, 2> readPair(ArchiveReader& read) {
  const auto first = read.next<std::int32_t>();
  return {first, read.next<std::int32_t>()};
}

void checkCell(const GridMap::Cell& cell) {
  if (!(cell.occupancy > 0.0f && cell.occupancy < 1.0f) || !std::isfinite(cell.reflectivity))
    throw std::runtime_error("it holds a cell that is no probability or no reflectivity");
}

void readTiles(ArchiveReader& read, GridMap& map) {
  for (auto tiles = read.next<std::uint64_t>(); tiles > 0; --tiles) {
    const auto [x, y] = readPair(read);
    std::string compressed;
    read(compressed);
    const std::string bytes = mapping_common::decompress(compressed, sizeof(GridMap::Tile));
    GridMap::Tile tile;
    std::memcpy(&tile, bytes.data(), sizeof(tile));
    for (const GridMap::Cell& cell : tile.cells) checkCell(cell);
    if (!map.add(x, y, tile))
      throw std::runtime_error("it holds a tile twice, or one that isn't in its grid");
  }
}

void readCells(ArchiveReader& read, GridMap& map) {
  std::array<int, 2> min = readPair(read), max = readPair(read);
  for (int i = 0; i < 2; ++i) {
    const std::int64_t size = map.box().sizes()[i];
    if (!(min[i] >= 0 && max[i] <= size && max[i] >= min[i] - 1))
      throw std::runtime_error("it holds a grid with impossible bounds");
    min[i] += map.box().min()[i];
    max[i] += map.box().min()[i];
  }
  const std::size_t cells = static_cast<std::size_t>(max[0] - min[0] + 1) * (max[1] - min[1] + 1);
  if (read.left() / 10 < cells) throw std::runtime_error("it is truncated");
  for (int y = min[1]; y <= max[1]; ++y) {
    for (int x = min[0]; x <= max[0]; ++x) {
      GridMap::Cell cell;
      cell.occupancy = read.next<float>();
      cell.reflectivity = read.next<float>();
      checkCell(cell);
      map.set(x, y, cell, read.next<std::uint16_t>());
    }
  }
}

GridMap readLevel(ArchiveReader& read, const MapOptions& options) {
  const auto resolution = read.next<double>();
  bool valid = resolution > 0.0 && std::isfinite(resolution);
  std::array<std::int64_t, 2> min{}, max{};
  if (read.version() < 3) {
    for (auto& value : min) {
      const double cells = read.next<double>() / resolution;
      valid = valid && std::abs(cells) < 1e9 && std::abs(cells - std::round(cells)) < 1e-3;
      if (valid) value = std::llround(cells);
    }
    const auto size = readPair(read);
    for (int i = 0; i < 2; ++i) max[i] = min[i] + size[i] - 1;
  } else {
    for (auto* cell : {&min, &max}) {
      const auto values = readPair(read);
      std::copy(values.begin(), values.end(), cell->begin());
    }
  }
  const double longest = std::max(options.max_size / resolution, static_cast<double>(options.size)) + 1.0;
  for (int i = 0; i < 2; ++i) {
    valid = valid && std::max(std::abs(min[i]), std::abs(max[i])) < 1000000000 && max[i] > min[i];
    if (valid && max[i] - min[i] + 1 > longest) throw std::runtime_error("it is larger than max_size");
  }
  if (!valid) throw std::runtime_error("it holds a grid with impossible bounds");
  GridMap map(resolution, {Eigen::Vector2i(min[0], min[1]), Eigen::Vector2i(max[0], max[1])});
  read.version() < 3 ? readCells(read, map) : readTiles(read, map);
  return map;
}

}  // namespace

void MultiMap::write(ArchiveWriter& write) const {
  write(static_cast<std::uint32_t>(levels_.size()));
  for (const GridMap& level : levels_) writeLevel(write, level);
}

void MultiMap::read(ArchiveReader& read) {
  const auto levels = read.next<std::uint32_t>();
  options_.levels = levels > 100 ? 0 : static_cast<int>(levels);
  levels_.clear();
  for (std::uint32_t i = 0; i < levels && levels <= 100; ++i) levels_.push_back(readLevel(read, options_));
  if (levels_.empty()) throw std::runtime_error("it has no or too many levels");
  const GridMap& finest = levels_.front();
  const auto corners = [](const GridMap& map) {
    using Cell = Eigen::Matrix<std::int64_t, 2, 1>;
    Eigen::Matrix<std::int64_t, 2, 2> corners;
    corners << map.box().min().cast<std::int64_t>(), map.box().max().cast<std::int64_t>() + Cell::Ones();
    return corners;
  };
  options_.resolution = finest.resolution();
  options_.size = std::min(std::max(finest.width(), finest.height()), 32768);
  for (int i = 0; i < this->levels(); ++i) {
    const GridMap& level = levels_[i];
    if (std::abs(level.resolution() - (1 << i) * finest.resolution()) > 1e-9 * (1 << i) ||
        corners(finest) != corners(level) * (1 << i)) {
      throw std::runtime_error("its levels don't agree");
    }
  }
  mapping_common::validate(options_);
  updates_ = 1;
}

void MultiMap::save(const std::string& path) const {
  mapping_common::writeArchive(path, kFormat, [this](ArchiveWriter& to) { write(to); });
}

std::string MultiMap::toBytes() const {
  return mapping_common::toArchive(kFormat, [this](ArchiveWriter& to) { write(to); });
}

MultiMap MultiMap::load(const std::string& path, const MapOptions& options) {
  MultiMap map(options);
  mapping_common::readArchive(path, kFormat, [&map](ArchiveReader& from) { map.read(from); });
  return map;
}

MultiMap MultiMap::fromBytes(const char* begin, const char* end, const std::string& name,
                             const MapOptions& options) {
  MultiMap map(options);
  mapping_common::readArchive(begin, end, name, kFormat, [&map](ArchiveReader& from) { map.read(from); });
  return map;
}

}  // namespace intensity_hector_slam
