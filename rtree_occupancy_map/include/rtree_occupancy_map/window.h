// SPDX-License-Identifier: BSD-3-Clause
//
// A rolling window: what is near the robot is in memory, all of the map in a file.
#pragma once

#include <mapping_common/options.h>

#include <string>

namespace rtree_occupancy_map {

/// See describe() for what each is, and OccupancyMap::open and keepIn.
struct WindowOptions {
  std::string file;
  double distance = 100.0, memory = 512.0;

  void describe(mapping_common::OptionList& o) {
    o("file", file, "",
      "path of an SQLite file (.db) for what is beyond the window; it holds the whole map at the end, and "
      "the "
      "next run goes on with it. Empty: all is kept in memory");
    o("distance", distance, "m",
      "blocks of 32^3 voxels that are farther from the sensor, and not in the last scans, leave the memory")
        .atLeast(0.0);
    o("memory", memory, "MiB", "what the cells in memory take at most; those used longest ago leave it first")
        .within(0.0, 1e6);
  }
};

}  // namespace rtree_occupancy_map
