// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "intensity_hector_slam/grid_map.h"

namespace mapping_common {
class ArchiveReader;
class ArchiveWriter;
}  // namespace mapping_common

namespace intensity_hector_slam {

/// The same world in grids of several resolutions, each updated by itself (as in Hector SLAM, to escape local
/// minima).
class MultiMap {
 public:
  explicit MultiMap(const MapOptions& options = {});

  const MapOptions& options() const { return options_; }
  /// 0 is the finest.
  const GridMap& level(int i) const { return levels_[i]; }
  int levels() const { return static_cast<int>(levels_.size()); }
  /// @throws std::invalid_argument where another map's options have another resolution or number of levels;
  /// it names both
  void requireLike(const MapOptions& options) const;
  /// Of all levels' cells.
  std::size_t bytes() const;
  /// Counts the updates.
  std::size_t updates() const { return updates_; }

  /// What appears where space was surely free (MapOptions::sure_free) weighs as little as a beam that crosses
  /// it: what moves doesn't get into the map, what stays does.
  void update(const Scan& scan, const Pose& pose);
  /// Forgets all cells. The borders stay.
  void clear();
  /// Whether the same is known on all levels.
  friend bool operator==(const MultiMap& a, const MultiMap& b) { return a.levels_ == b.levels_; }

  /// Writes all levels to a file: see map_file.cpp.
  /// @throws std::runtime_error that names the file
  void save(const std::string& path) const;
  /// @param options all but the resolution, the levels and the borders, which are the file's
  /// @throws std::runtime_error that names the file and what is wrong with it
  static MultiMap load(const std::string& path, const MapOptions& options = {});
  /// What is in such a file, and the map of it.
  std::string toBytes() const;
  static MultiMap fromBytes(const char* begin, const char* end, const std::string& name,
                            const MapOptions& options = {});

 private:
  void growTo(const Scan& scan, const Pose& pose);
  void write(mapping_common::ArchiveWriter& write) const;
  void read(mapping_common::ArchiveReader& read);

  MapOptions options_;
  std::vector<GridMap> levels_;
  std::size_t updates_ = 0;
  std::vector<bool> appeared_;  // for each point of the scan
};

}  // namespace intensity_hector_slam
