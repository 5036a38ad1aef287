// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/pcd_file.h"

#include <mapping_common/files.h>

#include <ostream>

namespace rtree_occupancy_map {

std::size_t writePcd(const OccupancyMap& map, const std::string& path) {
  const bool intensity = map.options().reflectivity;
  std::size_t points = 0;
  map.visitOccupied([&points](const Cell& cell) {
    points += static_cast<std::size_t>(cell.box.volume());
    return true;
  });
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z"
        << (intensity ? " intensity" : "") << "\nSIZE 4 4 4" << (intensity ? " 4" : "") << "\nTYPE F F F"
        << (intensity ? " F" : "") << "\nCOUNT 1 1 1" << (intensity ? " 1" : "") << "\nWIDTH " << points
        << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << points << "\nDATA binary\n";
    map.visitOccupied([&](const Cell& cell) {
      const VoxelBox& b = cell.box;
      for (int x = b.min[0]; x < b.max[0]; ++x) {
        for (int y = b.min[1]; y < b.max[1]; ++y) {
          for (int z = b.min[2]; z < b.max[2]; ++z) {
            const Eigen::Vector3f center = map.center(VoxelBox::unit({x, y, z})).cast<float>();
            const float values[] = {center.x(), center.y(), center.z(), cell.reflectivity.mean};
            out.write(reinterpret_cast<const char*>(values), intensity ? 16 : 12);
          }
        }
      }
      return true;
    });
  });
  return points;
}

}  // namespace rtree_occupancy_map
