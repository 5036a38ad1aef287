// SPDX-License-Identifier: BSD-3-Clause
//
// OctoMap's files and messages (octomap.github.io), without its library. A file is lines of text and an
// octree of depth 16 over voxels -32768 to 32767 along each axis, depth first; child i of a node is in its
// upper half along x, y, z where bit 0, 1, 2 of i is set.
//   .bt  two bits for each child: 0 unknown, 1 free, 2 occupied, 3 has children. Log odds are those of
//        OctoMap's clamping thresholds
//   .ot  log odds (float32), of an inner node the greatest of its children, and a byte with a bit for each
//        child that there is. A ColorOcTree has red, green and blue, a byte each, between the two; white is
//        no colour
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "rtree_occupancy_map/map_snapshot.h"
#include "rtree_occupancy_map/occupancy_map.h"

namespace rtree_occupancy_map {

enum class OctomapFormat {
  kBinary,  ///< .bt: what is free and what is occupied
  kFull     ///< .ot: log odds
};

/// The octree, which is also what octomap_msgs/Octomap holds.
struct OctomapData {
  std::string bytes;
  std::size_t nodes = 0;
  bool colored = false;  ///< of a ColorOcTree

  /// What OctoMap calls it.
  const char* id() const { return colored ? "ColorOcTree" : "OcTree"; }
};
/// The octree of a map that changes: only blocks that changed are made anew. It holds what it makes.
class Octree {
 public:
  explicit Octree(OctomapFormat format) : format_(format) {}

  void update(const MapSnapshot& changed);
  OctomapData data() const;
  OctomapFormat format() const { return format_; }
  double resolution() const { return resolution_; }  ///< m, of what was there last
  void clear() { blocks_.clear(); }

  /// A node, by what is said of it above.
  enum class Kind { kUnknown, kLeaf, kInner };
  struct Node {
    Kind kind = Kind::kUnknown;
    float value = 0.0F;      ///< the greatest below
    Color color = kNoColor;  ///< of a leaf that of the voxels in it, of an inner node the children's mean
  };

 private:
  // A block's node, and what is written of it and of those below.
  struct Part {
    Node node;
    OctomapData data;
  };

  OctomapFormat format_;
  double resolution_ = 0.0;
  bool colored_ = false;
  std::map<std::uint64_t, Part> blocks_;  // by the place in the order of the octree
};

/// The map as an octree in which eight children of equal value are one leaf. Reflectivities are left out. Of
/// a map with colours the full format is a ColorOcTree, as OctoMap makes them: where eight leaves become one,
/// it has their mean.
OctomapData toOctomap(const OccupancyMap& map, OctomapFormat format);

/// @throws std::runtime_error that names the file
void writeOctomap(const OccupancyMap& map, const std::string& path, OctomapFormat format);

/// Reads either format, of an OcTree, a ColorOcTree or an OcTreeStamped. Each voxel has the very log odds
/// that OctoMap reads, but for those beyond +-20, which are taken to be that. A leaf's colour is that of each
/// occupied voxel in it, as of one return.
/// @param options of the map, but for its resolution, which the file has; colours are read where they say
///   color. Clamping thresholds, which the file doesn't have, are widened to what it holds
/// @throws std::runtime_error that names the file and says what is wrong with it: foreign, truncated,
/// corrupted
OccupancyMap readOctomap(const std::string& path, const Options& options);
/// By default options, with color where the file is a ColorOcTree.
OccupancyMap readOctomap(const std::string& path);

}  // namespace rtree_occupancy_map
