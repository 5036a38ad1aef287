// SPDX-License-Identifier: BSD-3-Clause
//
// Map files are archives (mapping_common/archive.h) of the number of levels (uint32), then of each level the
// resolution (float64), the corner (2 float64), the size and the box of its known cells (6 int32), and of
// these cells occupancy and reflectivity (float32) and count (uint16), row by row. Version 1 has another
// checksum.
#include <mapping_common/archive.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "intensity_hector_slam/multi_map.h"

namespace intensity_hector_slam {
namespace {

using mapping_common::ArchiveReader;
using mapping_common::ArchiveWriter;

constexpr mapping_common::ArchiveFormat kFormat = {"RFLSLAM1", "a reflectivity SLAM map", 1, 2, 1};

void writeLevel(ArchiveWriter& write, const GridMap& map) {
  write(map.resolution());
  write(map.origin().x());
  write(map.origin().y());
  Eigen::AlignedBox2i known = map.knownCells();
  if (known.isEmpty()) known = Eigen::AlignedBox2i(Eigen::Vector2i(0, 0), Eigen::Vector2i(-1, -1));
  for (const int value :
       {map.width(), map.height(), known.min().x(), known.min().y(), known.max().x(), known.max().y()}) {
    write(static_cast<std::int32_t>(value));
  }
  for (int y = known.min().y(); y <= known.max().y(); ++y) {
    for (int x = known.min().x(); x <= known.max().x(); ++x) {
      write(map.cell(x, y).occupancy);
      write(map.cell(x, y).reflectivity);
      write(map.count(x, y));
    }
  }
}

GridMap readLevel(ArchiveReader& read, const MapOptions& options) {
  const double resolution = read.next<double>(), x0 = read.next<double>(), y0 = read.next<double>();
  std::int32_t size[2], min[2], max[2];
  for (auto* values : {size, min, max}) {
    for (int i = 0; i < 2; ++i) values[i] = read.next<std::int32_t>();
  }
  const double longest = std::max(options.max_size / resolution, static_cast<double>(options.size)) + 1.0;
  bool valid = resolution > 0.0 && std::isfinite(resolution) && std::isfinite(x0) && std::isfinite(y0);
  for (int i = 0; i < 2; ++i) {
    valid = valid && size[i] >= 2 && min[i] >= 0 && max[i] < size[i] && max[i] >= min[i] - 1;
    if (valid && size[i] > longest) throw std::runtime_error("it is larger than max_size");
  }
  if (!valid) throw std::runtime_error("it holds a grid with impossible bounds");
  const std::size_t cells = static_cast<std::size_t>(max[0] - min[0] + 1) * (max[1] - min[1] + 1);
  if (read.left() / 10 < cells) throw std::runtime_error("it is truncated");
  GridMap map(resolution, {x0, y0}, size[0], size[1]);
  for (int y = min[1]; y <= max[1]; ++y) {
    for (int x = min[0]; x <= max[0]; ++x) {
      GridMap::Cell cell;
      cell.occupancy = read.next<float>();
      cell.reflectivity = read.next<float>();
      if (!(cell.occupancy > 0.0f && cell.occupancy < 1.0f) || !std::isfinite(cell.reflectivity)) {
        throw std::runtime_error("it holds a cell that is no probability or no reflectivity");
      }
      map.set(x, y, cell, read.next<std::uint16_t>());
    }
  }
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
  options_.resolution = finest.resolution();
  options_.size = std::min(std::max(finest.width(), finest.height()), 32768);
  for (int i = 0; i < this->levels(); ++i) {
    const GridMap& level = levels_[i];
    const int scale = 1 << i;
    if (level.width() * scale != finest.width() || level.height() * scale != finest.height() ||
        std::abs(level.resolution() - scale * finest.resolution()) > 1e-9 * scale ||
        (level.origin() - finest.origin()).norm() > 1e-6) {
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
