// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/octomap_file.h"

#include <mapping_common/files.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <vector>

#include "log_odds.h"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "OctoMap writes numbers as they are in memory");

namespace rtree_occupancy_map {
namespace {

constexpr int kDepth = 16;             // of the octree's smallest nodes, the voxels
constexpr int kLowest = -(1 << 15);    // voxel coordinate
constexpr float kMostLogOdds = 20.0F;  // nearer to 0 and 1 probabilities of double precision are too coarse
constexpr const char* kFirstLine[] = {"# Octomap OcTree binary file", "# Octomap OcTree file"};  // .bt, .ot

// Of the children in the two bytes of a node in a .bt file.
enum BinaryChild : unsigned { kUnknownChild = 0, kFreeChild = 1, kOccupiedChild = 2, kInnerChild = 3 };

// ---- writing --------------------------------------------------------------------------------------------

using Node = Octree::Node;
using Kind = Octree::Kind;

// Writes nodes, depth first.
class NodeWriter {
 public:
  NodeWriter(OctomapFormat format, bool colored)
      : binary_(format == OctomapFormat::kBinary),
        value_size_(binary_ ? 0 : sizeof(float) + (colored ? sizeof(Color) : 0)),
        colored_(colored && !binary_) {}

  Node leaf(float value, const Color& color) {
    const Node node = {Kind::kLeaf, value, color};
    ++data_.nodes;
    if (!binary_) {
      const std::size_t at = data_.bytes.size();
      data_.bytes.resize(at + value_size_ + 1);
      writeValue(node, at);
    }
    return node;
  }

  // A node stands before its children, and says of them what is known only once they are written.
  template <class WriteChild>
  Node inner(WriteChild&& writeChild) {
    const std::size_t at = data_.bytes.size(), nodes = data_.nodes;
    const std::size_t children_at = at + value_size_;
    data_.bytes.resize(children_at + (binary_ ? 2 : 1));
    ++data_.nodes;
    float greatest = -std::numeric_limits<float>::infinity(), least = -greatest;
    unsigned leaves = 0, children = 0, colored = 0;
    std::array<unsigned, 3> sum{};
    for (unsigned i = 0; i < 8; ++i) {
      const Node child = writeChild(i);
      if (child.kind == Kind::kUnknown) continue;
      greatest = std::max(greatest, child.value);
      least = std::min(least, child.value);
      leaves += child.kind == Kind::kLeaf;
      if (child.color != kNoColor) {
        ++colored;
        for (int k = 0; k < 3; ++k) sum[k] += child.color[k];
      }
      const unsigned as = child.kind == Kind::kInner ? kInnerChild
                          : child.value > 0.0F       ? kOccupiedChild
                                                     : kFreeChild;
      children |= binary_ ? as << 2 * i : 1U << i;
    }
    Color mean = kNoColor;
    for (int k = 0; k < 3 && colored > 0; ++k) mean[k] = static_cast<std::uint8_t>(sum[k] / colored);
    if (leaves == 8 && least == greatest) {
      data_.bytes.resize(at);
      data_.nodes = nodes;
      return leaf(greatest, mean);
    }
    std::memcpy(&data_.bytes[children_at], &children, binary_ ? 2 : 1);
    const Node node = {Kind::kInner, greatest, mean};
    if (!binary_) writeValue(node, at);
    return node;
  }

  // A node with all below it that was written elsewhere.
  Node append(const Node& node, const OctomapData& data) {
    data_.bytes += data.bytes;
    data_.nodes += data.nodes;
    return node;
  }

  bool isBinary() const { return binary_; }
  bool isColored() const { return colored_; }
  OctomapData take() {
    data_.colored = colored_;
    return std::exchange(data_, {});
  }

 private:
  void writeValue(const Node& node, std::size_t at) {
    std::memcpy(&data_.bytes[at], &node.value, sizeof(float));
    if (colored_) std::memcpy(&data_.bytes[at + sizeof(float)], node.color.data(), sizeof(Color));
  }

  const bool binary_;
  const std::size_t value_size_;  // bytes of a node before its children
  const bool colored_;
  OctomapData data_;
};

class BlockWriter {
 public:
  BlockWriter(OctomapFormat format, bool colored) : write_(format, colored) {}

  Node write(const MapSnapshot& map, const MapSnapshot::BlockCells& block) {
    std::vector<Cell>& cells = cells_[kBlockBits];
    cells = block.cells;
    block_ = &block;
    if (write_.isBinary()) {
      for (Cell& cell : cells) cell.log_odds = map.isOccupied(cell) ? 1.0F : -1.0F;
    }
    return writeCells(kBlockBits, OccupancyMap::boxOf(block.block));
  }
  OctomapData take() { return write_.take(); }

 private:
  // A node within a block, by the cells that overlap it, those in cells_[level].
  Node writeCells(int level, const VoxelBox& cube) {
    const std::vector<Cell>& cells = cells_[level];
    if (cells.empty()) return {};
    if (cells.front().box.contains(cube)) return write_.leaf(cells.front().log_odds, colorOf(cube));
    return write_.inner([&](unsigned child) {
      VoxelBox octant = cube;
      for (int i = 0; i < 3; ++i) {
        const auto middle = static_cast<std::int16_t>(cube.min[i] + cube.width(i) / 2);
        ((child >> i & 1) != 0 ? octant.min : octant.max)[i] = middle;
      }
      std::vector<Cell>& below = cells_[level - 1];
      below.clear();
      std::copy_if(cells.begin(), cells.end(), std::back_inserter(below),
                   [&](const Cell& cell) { return cell.box.overlaps(octant); });
      return writeCells(level - 1, octant);
    });
  }

  // The nearest to white that isn't taken for none.
  Color colorOf(const VoxelBox& cube) const {
    constexpr Color kAlmostWhite = {255, 255, 254};
    const std::optional<Color> color = write_.isColored() ? block_->colorOf(cube) : std::nullopt;
    return !color ? kNoColor : *color == kNoColor ? kAlmostWhite : *color;
  }

  NodeWriter write_;
  const MapSnapshot::BlockCells* block_ = nullptr;
  std::array<std::vector<Cell>, kBlockBits + 1> cells_;  // by level
};

// A node with an edge of 2^level voxels, by the blocks in it, which point to their places and parts.
template <class Iterator>
Node writeBlocks(NodeWriter& write, int level, Iterator first, Iterator last) {
  if (first == last) return {};
  if (level == kBlockBits) return write.append((*first)->second.node, (*first)->second.data);
  return write.inner([&](unsigned child) {
    const Iterator begin = first;
    first = std::partition_point(first, last, [&](const auto* placed) {
      return (placed->first >> 3 * (level - 1 - kBlockBits) & 7) == child;
    });
    return writeBlocks(write, level - 1, begin, first);
  });
}

// A block's place in the order of the octree: three bits a level, from the root on.
std::uint64_t placeOf(const Block& block) {
  std::uint64_t place = 0;
  for (int bit = 0; bit < kDepth - kBlockBits; ++bit) {
    for (int i = 0; i < 3; ++i) {
      const auto key = static_cast<std::uint64_t>(block[i] - kLowest / kBlockSize);
      place |= (key >> bit & 1) << (3 * bit + i);
    }
  }
  return place;
}

// ---- reading ----------------------------------------------------------------------------------------

struct Header {
  OctomapFormat format = OctomapFormat::kBinary;
  std::string id;
  std::size_t nodes = 0;
  double resolution = 0.0;

  bool isColored() const { return id == "ColorOcTree"; }
};

// As OctoMap does: comments, and names with values, up to "data".
Header readHeader(std::istream& in) {
  Header header;
  std::string line, name;
  std::getline(in, line);
  if (line.compare(0, std::strlen(kFirstLine[0]), kFirstLine[0]) == 0) {
    header.format = OctomapFormat::kBinary;
  } else if (line.compare(0, std::strlen(kFirstLine[1]), kFirstLine[1]) == 0) {
    header.format = OctomapFormat::kFull;
  } else {
    throw std::runtime_error("it isn't a map of OctoMap, version 1.0 or later");
  }
  constexpr int kMostLines = 1000;
  for (int number = 0; number < kMostLines && std::getline(in, line); ++number) {
    std::istringstream words(line);
    if (!(words >> name) || name[0] == '#') continue;
    if (name == "data") {
      if (!(header.resolution > 0.0 && std::isfinite(header.resolution)))
        throw std::runtime_error("its header has no resolution (res)");
      if (header.id.empty()) throw std::runtime_error("its header doesn't say what it is (id)");
      return header;
    }
    bool read = true;
    if (name == "id") read = static_cast<bool>(words >> header.id);
    if (name == "size") read = static_cast<bool>(words >> header.nodes);
    if (name == "res") read = static_cast<bool>(words >> header.resolution);
    if (!read) throw std::runtime_error("its header has the line '" + line.substr(0, 80) + '\'');
  }
  throw std::runtime_error("its header has no end");
}

class OctreeReader {
 public:
  OctreeReader(std::istream& in, const Header& header, float low, float high)
      : in_(*in.rdbuf()), header_(header), low_(low), high_(high), colored_(header.isColored()) {
    const bool known = header.id == "OcTree" || header.id == "1" || header.id == "OcTreeStamped" || colored_;
    if (!known) {
      throw std::runtime_error("it is a " + header.id.substr(0, 80) +
                               ", allowed are OcTree, ColorOcTree and OcTreeStamped");
    }
  }

  std::vector<Cell> read() {
    if (header_.nodes > 0) {
      ++nodes_;
      const Cube all = {{kLowest, kLowest, kLowest}, kDepth};
      header_.format == OctomapFormat::kBinary ? readBinary(all) : readFull(all);
    }
    if (nodes_ != header_.nodes) {
      throw std::runtime_error("it is corrupted: it has " + std::to_string(nodes_) +
                               " nodes, and its header says " + std::to_string(header_.nodes));
    }
    if (in_.sgetc() != std::char_traits<char>::eof())
      throw std::runtime_error("it is corrupted: there is more after its last node");
    return std::move(cells_);
  }
  /// Of those cells that have one, by their numbers.
  const std::vector<std::pair<std::size_t, Color>>& colors() const { return colors_; }

 private:
  // Of 2^level voxels.
  struct Cube {
    Voxel min;
    int level;
  };

  Cube childOf(const Cube& cube, unsigned child) {
    if (cube.level == 0) throw std::runtime_error("it is corrupted: a node is below the smallest ones");
    if (++nodes_ > header_.nodes)
      throw std::runtime_error("it is corrupted: it has more nodes than its header says");
    Cube octant = {cube.min, cube.level - 1};
    for (int i = 0; i < 3; ++i) octant.min[i] += static_cast<int>(child >> i & 1) << octant.level;
    return octant;
  }

  void readBinary(const Cube& cube) {
    const auto children = next<std::uint16_t>();
    if (children == 0) throw std::runtime_error("it is corrupted: an inner node has no children");
    for (unsigned i = 0; i < 8; ++i) {
      const unsigned as = children >> 2 * i & 3;
      if (as == kInnerChild) {
        readBinary(childOf(cube, i));
      } else if (as != kUnknownChild) {
        addLeaf(childOf(cube, i), as == kFreeChild ? low_ : high_);
      }
    }
  }

  void readFull(const Cube& cube) {
    const auto log_odds = next<float>();
    const Color color = colored_ ? next<Color>() : kNoColor;
    const auto children = next<std::uint8_t>();
    if (children == 0) {
      addLeaf(cube, log_odds);
      if (color != kNoColor) colors_.emplace_back(cells_.size() - 1, color);
      return;
    }
    for (unsigned i = 0; i < 8; ++i) {
      if ((children >> i & 1) != 0) readFull(childOf(cube, i));
    }
  }

  void addLeaf(const Cube& cube, float log_odds) {
    if (!std::isfinite(log_odds)) throw std::runtime_error("it is corrupted: log odds aren't finite");
    Cell cell;
    cell.log_odds = std::clamp(log_odds, -kMostLogOdds, kMostLogOdds);
    for (int i = 0; i < 3; ++i) {
      const int min = cube.min[i], max = min + (1 << cube.level);
      if (min < kMinVoxel || max > kMaxVoxel) {
        throw std::runtime_error("it has cells farther than " +
                                 std::to_string(kMaxVoxel * header_.resolution) +
                                 " m from the origin, which is as far as a map of that resolution reaches");
      }
      cell.box.min[i] = static_cast<std::int16_t>(min);
      cell.box.max[i] = static_cast<std::int16_t>(max);
    }
    cells_.push_back(cell);
  }

  template <class T>
  T next() {
    T value;
    take(reinterpret_cast<char*>(&value), sizeof(T));
    return value;
  }
  void take(char* to, std::size_t count) {
    if (in_.sgetn(to, static_cast<std::streamsize>(count)) != static_cast<std::streamsize>(count))
      throw std::runtime_error("it is truncated");
  }

  std::streambuf& in_;
  const Header& header_;
  const float low_, high_;  // log odds of .bt
  const bool colored_;
  std::size_t nodes_ = 0;
  std::vector<Cell> cells_;
  std::vector<std::pair<std::size_t, Color>> colors_;
};

// A few bytes of a corrupted file can claim any number of voxels. These are 600 MB.
constexpr std::int64_t kMostColored = std::int64_t{1} << 25;

// Of cells that are occupied. @param colors by the cells' numbers
void addColors(const std::vector<Cell>& cells, const std::vector<std::pair<std::size_t, Color>>& colors,
               OccupancyMap& map) {
  constexpr std::size_t kAtOnce = 1 << 20;
  std::int64_t count = 0;
  for (const auto& [number, color] : colors)
    if (map.isOccupied(cells[number])) count += cells[number].box.volume();
  if (count > kMostColored) throw std::runtime_error("it has colours of too many voxels");
  std::vector<ColoredVoxel> voxels;
  const auto flush = [&] {
    map.addColors(voxels);
    voxels.clear();
  };
  for (const auto& [number, color] : colors) {
    if (!map.isOccupied(cells[number])) continue;
    ColorSum sum;
    sum.add(color);
    const VoxelBox& box = cells[number].box;
    for (int x = box.min[0]; x < box.max[0]; ++x) {
      for (int y = box.min[1]; y < box.max[1]; ++y)
        for (int z = box.min[2]; z < box.max[2]; ++z) voxels.push_back({{x, y, z}, sum});
      if (voxels.size() > kAtOnce) flush();
    }
  }
  flush();
}

// A probability of these very log odds, with as few digits as it takes: 0.97, not 0.96999999.
double probabilityOf(float log_odds) {
  double p = OccupancyMap::probability(log_odds);
  for (int digits = 1; digits <= 17; ++digits) {
    char text[40];
    std::snprintf(text, sizeof(text), "%.*g", digits, p);
    const double rounded = std::strtod(text, nullptr);
    if (logOdds(rounded) == log_odds) return rounded;
  }
  for (int step = 0; step < 1000 && logOdds(p) != log_odds; ++step)
    p = std::nextafter(p, logOdds(p) < log_odds ? 1.0 : 0.0);
  return p;
}

// The clamping thresholds of OctoMap's library, which it gives to what it reads from a .bt file.
constexpr double kClampingMin = 0.1192, kClampingMax = 0.971;

OccupancyMap read(std::istream& in, Options options) {
  const Header header = readHeader(in);
  options.resolution = header.resolution;
  OctreeReader reader(in, header, logOdds(kClampingMin), logOdds(kClampingMax));
  const std::vector<Cell> cells = reader.read();
  float least = logOdds(options.clamping_min), greatest = logOdds(options.clamping_max);
  for (const Cell& cell : cells) {
    least = std::min(least, cell.log_odds);
    greatest = std::max(greatest, cell.log_odds);
  }
  if (least < logOdds(options.clamping_min)) options.clamping_min = probabilityOf(least);
  if (greatest > logOdds(options.clamping_max)) options.clamping_max = probabilityOf(greatest);
  OccupancyMap map = OccupancyMap::fromCells(options, cells);
  if (options.color) addColors(cells, reader.colors(), map);
  return map;
}

// @param use what is done with the file, @return what that returns
template <class Use>
auto withFile(const std::string& path, const Use& use) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(path + " can't be opened: " + std::strerror(errno));
  try {
    return use(in);
  } catch (const std::exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

}  // namespace

void Octree::update(const MapSnapshot& changed) {
  resolution_ = changed.resolution;
  colored_ = changed.colored;
  BlockWriter writer(format_, colored_);
  for (const MapSnapshot::BlockCells& block : changed.blocks) {
    const Node node = writer.write(changed, block);
    if (node.kind == Kind::kUnknown) {
      blocks_.erase(placeOf(block.block));
    } else {
      blocks_[placeOf(block.block)] = {node, writer.take()};
    }
  }
}

OctomapData Octree::data() const {
  NodeWriter writer(format_, colored_);
  std::vector<const std::pair<const std::uint64_t, Part>*> blocks;
  blocks.reserve(blocks_.size());
  for (const auto& block : blocks_) blocks.push_back(&block);
  writeBlocks(writer, kDepth, blocks.begin(), blocks.end());
  return writer.take();
}

OctomapData toOctomap(const OccupancyMap& map, OctomapFormat format) {
  Octree octree(format);
  octree.update(MapSnapshot(map, {}));
  for (const Block& block : knownBlocks(map)) octree.update(MapSnapshot(map, {block}));
  return octree.data();
}

void writeOctomap(const OccupancyMap& map, const std::string& path, OctomapFormat format) {
  const OctomapData data = toOctomap(map, format);
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << kFirstLine[format == OctomapFormat::kBinary ? 0 : 1]
        << "\n# (feel free to add / change comments, but leave the first line as it is!)\n#\nid " << data.id()
        << "\nsize " << data.nodes << "\nres " << mapping_common::toText(map.options().resolution)
        << "\ndata\n";
    out.write(data.bytes.data(), static_cast<std::streamsize>(data.bytes.size()));
  });
}

OccupancyMap readOctomap(const std::string& path, const Options& options) {
  return withFile(path, [&options](std::istream& in) { return read(in, options); });
}

OccupancyMap readOctomap(const std::string& path) {
  Options options;
  options.color = withFile(path, [](std::istream& in) { return readHeader(in).isColored(); });
  return readOctomap(path, options);
}

}  // namespace rtree_occupancy_map
