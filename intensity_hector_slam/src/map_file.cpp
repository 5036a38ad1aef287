// SPDX-License-Identifier: BSD-3-Clause
//
// Map files, little endian: magic, version, number of levels, then of each level the resolution (float64),
// the corner (2 float64), the size and the box of its known cells (6 int32), and of these cells occupancy and
// reflectivity (float32) and count (uint16), row by row; at last the CRC-32 of everything before it.
#include <mapping_common/files.h>

#include <boost/crc.hpp>
#include <cmath>
#include <cstring>
#include <ostream>
#include <stdexcept>
#include <type_traits>

#include "intensity_hector_slam/multi_map.h"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "map files are written as they are in memory");

namespace intensity_hector_slam {
namespace {

constexpr char kMagic[8] = {'R', 'F', 'L', 'S', 'L', 'A', 'M', '1'};
constexpr std::uint32_t kVersion = 1;

template <class T>
void append(std::string& bytes, const T& value) {
  static_assert(std::is_trivially_copyable<T>::value, "");
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
}

class Reader {
 public:
  Reader(const char* begin, const char* end) : at_(begin), end_(end) {}
  bool atEnd() const { return at_ == end_; }
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }
  template <class T>
  T next() {
    if (left() < sizeof(T)) throw std::runtime_error("it is truncated");
    T value;
    std::memcpy(&value, at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }

 private:
  const char *at_, *end_;
};

std::uint32_t checksum(const char* data, std::size_t size) {
  boost::crc_32_type crc;
  crc.process_bytes(data, size);
  return crc.checksum();
}

void append(std::string& bytes, const GridMap& map) {
  append(bytes, map.resolution());
  append(bytes, map.origin().x());
  append(bytes, map.origin().y());
  Eigen::AlignedBox2i known = map.knownCells();
  if (known.isEmpty()) known = Eigen::AlignedBox2i(Eigen::Vector2i(0, 0), Eigen::Vector2i(-1, -1));
  for (const int value :
       {map.width(), map.height(), known.min().x(), known.min().y(), known.max().x(), known.max().y()}) {
    append(bytes, static_cast<std::int32_t>(value));
  }
  for (int y = known.min().y(); y <= known.max().y(); ++y) {
    for (int x = known.min().x(); x <= known.max().x(); ++x) {
      append(bytes, map.cell(x, y).occupancy);
      append(bytes, map.cell(x, y).reflectivity);
      append(bytes, map.count(x, y));
    }
  }
}

GridMap readLevel(Reader& read, const MapOptions& options) {
  const double resolution = read.next<double>(), x0 = read.next<double>(), y0 = read.next<double>();
  std::int32_t size[2], min[2], max[2];
  for (auto* values : {size, min, max}) {
    for (int i = 0; i < 2; ++i) values[i] = read.next<std::int32_t>();
  }
  const double longest = options.max_size / resolution + 1.0;
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

void MultiMap::save(const std::string& path) const {
  std::string bytes(kMagic, sizeof(kMagic));
  append(bytes, kVersion);
  append(bytes, static_cast<std::uint32_t>(levels_.size()));
  for (const GridMap& level : levels_) append(bytes, level);
  append(bytes, checksum(bytes.data(), bytes.size()));
  mapping_common::writeFile(path, [&](std::ostream& out) { out.write(bytes.data(), bytes.size()); });
}

MultiMap MultiMap::load(const std::string& path, const MapOptions& options) {
  const std::string bytes = mapping_common::readFile(path);
  try {
    if (bytes.compare(0, sizeof(kMagic), kMagic, sizeof(kMagic)) != 0) {
      throw std::runtime_error("it isn't a reflectivity SLAM map");
    }
    if (bytes.size() < sizeof(kMagic) + 3 * sizeof(std::uint32_t))
      throw std::runtime_error("it is truncated");
    const std::size_t checked = bytes.size() - sizeof(std::uint32_t);
    Reader read(bytes.data() + sizeof(kMagic), bytes.data() + checked);
    const auto version = read.next<std::uint32_t>();
    if (version != kVersion) {
      throw std::runtime_error("it has format version " + std::to_string(version) + ", this program reads " +
                               std::to_string(kVersion));
    }
    Reader tail(bytes.data() + checked, bytes.data() + bytes.size());
    if (checksum(bytes.data(), checked) != tail.next<std::uint32_t>()) {
      throw std::runtime_error("it is truncated or corrupted: its checksum is wrong");
    }
    MultiMap map(options);
    const auto levels = read.next<std::uint32_t>();
    map.options_.levels = levels > 100 ? 0 : static_cast<int>(levels);
    map.levels_.clear();
    for (std::uint32_t i = 0; i < levels && levels <= 100; ++i)
      map.levels_.push_back(readLevel(read, options));
    if (map.levels_.empty()) throw std::runtime_error("it has no or too many levels");
    if (!read.atEnd()) throw std::runtime_error("there is more in it than its levels");
    const GridMap& finest = map.levels_.front();
    map.options_.resolution = finest.resolution();
    map.options_.size_x = finest.width() * finest.resolution();
    map.options_.size_y = finest.height() * finest.resolution();
    for (int i = 0; i < map.levels(); ++i) {
      const GridMap& level = map.levels_[i];
      const int scale = 1 << i;
      if (level.width() * scale != finest.width() || level.height() * scale != finest.height() ||
          std::abs(level.resolution() - scale * finest.resolution()) > 1e-9 * scale ||
          (level.origin() - finest.origin()).norm() > 1e-6) {
        throw std::runtime_error("its levels don't agree");
      }
    }
    map.options_.validate();
    map.updates_ = 1;
    return map;
  } catch (const std::exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

}  // namespace intensity_hector_slam
