// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>

#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

/// Reads all scans of a file to clouds, with their grids and as voxels. Whatever is in the file, it is read
/// or refused with a std::runtime_error.
inline void readScanFile(const char* bytes, std::size_t size, const std::string& name, ReadOptions options) {
  options.verify_checksums = false;
  options.intensity = IntensityScale::kNormalised;
  CloudOptions grid, voxels;
  grid.sparse_cells = 10000;
  voxels.voxel = 0.1;
  voxels.apply_pose = true;
  try {
    const auto reader = openScanFile(openMemory(bytes, size), name, options);
    for (std::size_t i = 0; i < reader->scans().size(); ++i) {
      try {
        CloudBuilder organised(reader->scans()[i], grid), means(reader->scans()[i], voxels);
        reader->read(i, [&](const std::vector<ScanPoint>& points, double) {
          organised.add(points);
          means.add(points);
          return true;
        });
        organised.finish();
        means.finish();
      } catch (const std::runtime_error&) {
      }
    }
    reader->warnings();
  } catch (const std::runtime_error&) {
  }
}

}  // namespace hokuyo_sick_drivers
