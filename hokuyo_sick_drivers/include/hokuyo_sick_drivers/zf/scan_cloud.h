// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

class VoxelGrid;

/// Points as PCL and sensor_msgs/PointCloud2 hold them: row after row, each point x y z [intensity] [rgb],
/// all of them 32 bits (floats, and 0x00rrggbb).
struct ScanCloud {
  std::uint32_t width = 0, height = 1;  ///< columns and rows of the grid; without a grid points and 1
  bool has_intensity = false, has_colour = false;
  std::vector<std::uint8_t> data;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< of the cloud's origin in the registered frame
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  ///< was subtracted from the points; the pose has it

  std::uint64_t points = 0;      ///< that were measured
  std::uint64_t missing = 0;     ///< of the file's points
  std::uint64_t duplicates = 0;  ///< left out: their cell was taken
  std::uint64_t outside = 0;     ///< left out: beyond the grid, or beyond what can be divided into voxels

  bool organised() const { return height > 1; }
  std::uint32_t pointStep() const { return 12 + (has_intensity ? 4 : 0) + (has_colour ? 4 : 0); }
  /// Name and offset of the fields.
  std::vector<std::pair<std::string, std::uint32_t>> fields() const;
};

struct CloudOptions {
  enum class Offset { kNone, kAutomatic, kGiven };

  bool grid = true;
  bool apply_pose = false;
  /// Taken off before points become floats, which are coarser than 1 mm beyond 10 km. kAutomatic: where the
  /// first point is that far, its position rounded to kilometres.
  Offset offset_mode = Offset::kAutomatic;
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  double voxel = 0.0;
  /// A grid has no more cells than 64 times its points and these, lest a small file takes all memory.
  std::uint64_t sparse_cells = 4000000;

  void describe(mapping_common::OptionList& o) {
    o("apply_pose", apply_pose, "",
      "true: points in the registered frame instead; the pose is then that of the offset alone");
    o("voxel", voxel, "m",
      "edge of voxels of which each becomes the mean of its points; takes the grid away. 0: all points")
        .atLeast(0.0);
    o("grid", grid, "",
      "whether to keep the rows and columns of the scan where the file has them, with NaN where nothing was "
      "measured; "
      "false: only what was measured, in the file's order");
  }
};

/// Takes no more memory than the cloud it builds, with voxels some 100 bytes for each.
class CloudBuilder {
 public:
  /// @throws std::runtime_error for a grid too large for its points or for memory
  CloudBuilder(const ScanInfo& info, const CloudOptions& options);
  ~CloudBuilder();

  void add(const std::vector<ScanPoint>& points);
  /// @return the cloud, which leaves the builder
  ScanCloud finish();

 private:
  void chooseOffset(const Eigen::Vector3d& first);
  void write(std::uint8_t* to, const Eigen::Vector3f& position, float intensity, std::uint32_t rgb) const;

  ScanInfo info_;
  CloudOptions options_;
  bool has_offset_ = false, grid_ = false;
  std::unique_ptr<VoxelGrid> voxels_;
  ScanCloud cloud_;
};

/// A binary PCD file, VIEWPOINT is the pose.
void writePcd(std::ostream& out, const ScanCloud& cloud);

}  // namespace hokuyo_sick_drivers
