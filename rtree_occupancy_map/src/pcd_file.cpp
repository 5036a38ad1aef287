// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/pcd_file.h"

#include <mapping_common/files.h>

#include <cstdint>
#include <ostream>
#include <string>

namespace rtree_occupancy_map {

std::size_t writePcd(const OccupancyMap& map, const std::string& path) {
  const bool intensity = map.options().reflectivity, color = map.options().color;
  const auto fields = [&](const char* of_three, const char* of_one, const char* of_color) {
    return std::string(of_three) + (intensity ? of_one : "") + (color ? of_color : "");
  };
  std::size_t points = 0;
  map.visitOccupied([&points](const Cell& cell) {
    points += static_cast<std::size_t>(cell.box.volume());
    return true;
  });
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS "
        << fields("x y z", " intensity", " rgb") << "\nSIZE " << fields("4 4 4", " 4", " 4") << "\nTYPE "
        << fields("F F F", " F", " F") << "\nCOUNT " << fields("1 1 1", " 1", " 1") << "\nWIDTH " << points
        << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << points << "\nDATA binary\n";
    map.visitOccupied([&](const Cell& cell) {
      const VoxelBox& b = cell.box;
      Cell voxel = cell;
      for (int x = b.min[0]; x < b.max[0]; ++x) {
        for (int y = b.min[1]; y < b.max[1]; ++y) {
          for (int z = b.min[2]; z < b.max[2]; ++z) {
            voxel.box = VoxelBox::unit({x, y, z});
            const Eigen::Vector3f center = map.center(voxel.box).cast<float>();
            const float values[] = {center.x(), center.y(), center.z(), cell.reflectivity.mean};
            out.write(reinterpret_cast<const char*>(values), intensity ? 16 : 12);
            if (!color) continue;
            const std::uint32_t packed = packedColor(map.colorOf(voxel).value_or(kNoColor));
            out.write(reinterpret_cast<const char*>(&packed), sizeof(packed));
          }
        }
      }
      return true;
    });
  });
  return points;
}

}  // namespace rtree_occupancy_map
