// SPDX-License-Identifier: BSD-3-Clause
//
// Map files, little endian: magic, version, options, number of cells, cells (min and max corner as 6 int16,
// log odds as float32, with reflectivity its mean as float32 and its hits as uint32), CRC-32 of everything
// before it.
#include <unistd.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <type_traits>

#include "insertion.h"
#include "log_odds.h"
#include "rtree_occupancy_map/occupancy_map.h"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              "map files are little endian, and written as they are in memory");

namespace rtree_occupancy_map {
namespace {

constexpr char kMagic[8] = {'R', 'T', 'R', 'E', 'E', 'M', 'A', 'P'};
constexpr std::uint32_t kVersion = 1;

class Writer {
 public:
  explicit Writer(std::ostream& out) : out_(out) {}
  void bytes(const void* data, std::size_t size) {
    crc_.process_bytes(data, size);
    out_.write(static_cast<const char*>(data), static_cast<std::streamsize>(size));
  }
  template <class T>
  void operator()(const T& value) {
    static_assert(std::is_trivially_copyable<T>::value, "");
    bytes(&value, sizeof(T));
  }
  void operator()(const std::string& text) {
    (*this)(static_cast<std::uint32_t>(text.size()));
    bytes(text.data(), text.size());
  }
  std::uint32_t crc() const { return crc_.checksum(); }

 private:
  std::ostream& out_;
  boost::crc_32_type crc_;
};

class Reader {
 public:
  Reader(const char* begin, const char* end) : at_(begin), end_(end) {}
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }
  void bytes(void* data, std::size_t size) {
    if (left() < size) throw std::runtime_error("it is truncated");
    std::memcpy(data, at_, size);
    at_ += size;
  }
  template <class T>
  void operator()(T& value) {
    static_assert(std::is_trivially_copyable<T>::value, "");
    bytes(&value, sizeof(T));
  }
  void operator()(bool& value) {
    std::uint8_t byte = 0;
    (*this)(byte);
    value = byte != 0;
  }
  void operator()(std::string& text) {
    std::uint32_t size = 0;
    (*this)(size);
    if (left() < size) throw std::runtime_error("it is truncated");
    text.assign(at_, size);
    at_ += size;
  }

 private:
  const char *at_, *end_;
};

// The same list for reading and writing. An enum's range is checked by the reader.
template <class Archive, class O>
void visitOptions(Archive& archive, O& o) {
  archive(o.resolution);
  archive(o.prob_hit);
  archive(o.prob_miss);
  archive(o.clamping_min);
  archive(o.clamping_max);
  archive(o.prior);
  archive(o.occupancy_threshold);
  archive(o.min_range);
  archive(o.max_range);
  archive(o.sensor_model);
  archive(o.fusion_rule);
  archive(o.fusion_strategy);
  archive(o.search_order);
  archive(o.samples_per_metre);
  archive(o.seed);
  archive(o.dynamic);
  archive(o.reflectivity);
  archive(o.tree.min_entries);
  archive(o.tree.max_entries);
  archive(o.tree.split);
}

template <class Enum>
bool isOneOf(Enum value, Enum last) {
  return static_cast<int>(value) >= 0 && static_cast<int>(value) <= static_cast<int>(last);
}

std::vector<char> readFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = in ? static_cast<std::streamoff>(in.tellg()) : -1;
  if (size < 0 || size == std::numeric_limits<std::streamoff>::max())
    throw std::runtime_error("it can't be opened");
  std::vector<char> bytes(static_cast<std::size_t>(size));
  in.seekg(0);
  in.read(bytes.data(), size);
  if (!in) throw std::runtime_error("it can't be read");
  return bytes;
}

Options readOptions(Reader& read) {
  Options options;
  visitOptions(read, options);
  if (!isOneOf(options.sensor_model, SensorModel::kEndPoint) ||
      !isOneOf(options.fusion_rule, FusionRule::kEqualValue) ||
      !isOneOf(options.fusion_strategy, FusionStrategy::kNone) ||
      !isOneOf(options.tree.split, SplitMethod::kRStar)) {
    throw std::runtime_error("its options are out of range");
  }
  options.validate();
  return options;
}

Cell readCell(Reader& read, const Options& options) {
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
  const LogOddsModel model(options);
  if (!(cell.log_odds >= model.min && cell.log_odds <= model.max)) {
    throw std::runtime_error("it holds log odds beyond the clamping thresholds");
  }
  return cell;
}

}  // namespace

void OccupancyMap::save(const std::string& path) const {
  const std::string temporary = path + ".tmp" + std::to_string(getpid());
  const auto fail = [&temporary, &path](const char* what) {
    const std::string reason = std::strerror(errno);
    std::remove(temporary.c_str());
    throw std::runtime_error(path + ": " + what + ": " + reason);
  };
  std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
  if (!out) fail("can't be written");
  Writer write(out);
  write(kMagic);
  write(kVersion);
  visitOptions(write, options_);
  write(static_cast<std::uint64_t>(tree_.size()));
  tree_.visitAll([&](const Cell& cell) {
    write(cell.box);
    write(cell.log_odds);
    if (options_.reflectivity) write(cell.reflectivity);
    return true;
  });
  const std::uint32_t crc = write.crc();
  write(crc);
  out.close();
  if (!out) fail("can't be written");
  if (std::rename(temporary.c_str(), path.c_str()) != 0) fail("can't be renamed");
}

OccupancyMap OccupancyMap::load(const std::string& path) {
  try {
    const std::vector<char> bytes = readFile(path);
    std::uint32_t version = 0, crc = 0;
    if (bytes.size() < sizeof(kMagic) || std::memcmp(bytes.data(), kMagic, sizeof(kMagic)) != 0) {
      throw std::runtime_error("it isn't an R-tree occupancy map");
    }
    if (bytes.size() < sizeof(kMagic) + sizeof(version) + sizeof(crc))
      throw std::runtime_error("it is truncated");
    const char* end = bytes.data() + bytes.size() - sizeof(crc);
    Reader read(bytes.data() + sizeof(kMagic), end);
    read(version);
    if (version != kVersion) {
      throw std::runtime_error("it has format version " + std::to_string(version) + ", this program reads " +
                               std::to_string(kVersion));
    }
    std::memcpy(&crc, end, sizeof(crc));
    boost::crc_32_type checksum;
    checksum.process_block(bytes.data(), end);
    if (checksum.checksum() != crc)
      throw std::runtime_error("it is truncated or corrupted: its checksum is wrong");

    const Options options = readOptions(read);
    std::uint64_t count = 0;
    read(count);
    const std::size_t cell_size =
        sizeof(VoxelBox) + sizeof(float) + (options.reflectivity ? sizeof(Reflectivity) : 0);
    if (read.left() / cell_size != count || read.left() % cell_size != 0) {
      throw std::runtime_error("its number of cells and its size don't agree");
    }
    std::vector<Cell> cells;
    cells.reserve(count);
    for (std::uint64_t i = 0; i < count; ++i) cells.push_back(readCell(read, options));
    return fromCells(options, std::move(cells));
  } catch (const std::exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

OccupancyMap OccupancyMap::fromCells(const Options& options, std::vector<Cell> cells) {
  OccupancyMap map(options);
  const auto block = [](const Cell& c) { return blockOf(Voxel{c.box.min[0], c.box.min[1], c.box.min[2]}); };
  std::stable_sort(cells.begin(), cells.end(),
                   [&block](const Cell& a, const Cell& b) { return block(a) < block(b); });
  for (auto first = cells.begin(); first != cells.end();) {
    const Block here = block(*first);
    map.insertion_->grid.start(here);
    std::int64_t volume = 0;
    for (; first != cells.end() && block(*first) == here; ++first) {
      map.insertion_->grid.add(first->box, first->log_odds, first->reflectivity);
      volume += first->box.volume();
    }
    if (map.insertion_->grid.knownVoxels() != volume) throw std::runtime_error("it holds cells that overlap");
    map.indexBlock(here);
  }
  map.tree_.bulkLoad(std::move(cells));
  return map;
}

}  // namespace rtree_occupancy_map
