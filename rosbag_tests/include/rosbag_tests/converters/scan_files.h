// SPDX-License-Identifier: BSD-3-Clause
//
// Readers of recorded 3D scans with poses: one scan in memory at a time, in metres and ROS axes (x forward, y
// left, z up), whatever the file's own units and axes are. Readers throw std::runtime_error with the file,
// the line or byte offset, and what was expected there.
#pragma once

#include <mapping_simulation/posed_scan.h>

#include <cstddef>
#include <memory>
#include <string>

namespace rosbag_tests {

/// A sequence of scans that is read from front to back.
class ScanSource {
 public:
  virtual ~ScanSource() = default;

  /// Scans in the source; a bag counts those too that next() leaves out.
  virtual std::size_t size() const = 0;

  /// Reads the next scan into `scan`, whose memory is reused; false after the last one. If it throws, `scan`
  /// is unspecified and the next call goes on with the scan after the faulty one.
  virtual bool next(mapping_simulation::PosedScan& scan) = 0;

  /// Back to the first scan.
  virtual void rewind() = 0;
};

/// The frame that the points of a PCD file are in; the format leaves it open.
enum class PcdFrame {
  kMap,     ///< VIEWPOINT says where the sensor stood, points are in the map frame (as in la3dm's data sets)
  kSensor,  ///< VIEWPOINT takes the points from the sensor frame to the map frame (as in PCL's viewer)
};

/// Folder of NNNN.bin or NNNN.bin.xz: little-endian float32 x y z intensity per point (m, sensor frame), as
/// in KITTI. Each line of the pose file is the number of a scan and its 3x4 pose (sensor -> map), row-major;
/// '#' starts a comment. Numbers are compared by value (7, 0007). A scan without a pose is an error, a pose
/// without a scan is not. Without a pose file all poses are the identity. Stamps are made up: number * 0.1 s.
/// Files of a Livox scanner as in HeLiPR (19 bytes a point: float32 x y z, uint8 reflectivity, tag and line,
/// uint32 time) are told from KITTI's by their points; their intensity is reflectivity / 255.
std::unique_ptr<ScanSource> openBinScans(const std::string& folder, const std::string& poses_file);

/// Folder of PCD files in natural order (2 before 10), fields x y z and maybe intensity (0 without), with the
/// pose from the VIEWPOINT line. Without that line PCL takes the identity. Stamps are made up: index * 0.1 s.
std::unique_ptr<ScanSource> openPcdScans(const std::string& folder, PcdFrame frame = PcdFrame::kMap);

/// Folder of scanNNN.3d or scanNNN.3d.xz with scanNNN.pose, the UOS format of 3DTK: text, in cm and degrees,
/// left-handed, x right, y up, z forward. A line is a point `x y z`, maybe with a reflectance (intensity, 0
/// without); other further columns are ignored, and so is a first line that holds no point. The pose is
/// position and Euler angles, p_map = Rx(a) Ry(b) Rz(c) p + t. Stamps are made up: NNN * 0.1 s.
std::unique_ptr<ScanSource> openUosScans(const std::string& folder);

/// OctoMap's binary ScanGraph (.graph): scans in the sensor frame with their 6D poses, no intensities (0).
/// Edges are ignored. Stamps are made up: index * 0.1 s.
std::unique_ptr<ScanSource> openScanGraph(const std::string& file);

/// Opens whichever of these `path` is. `poses` is for .bin scans alone; if empty, it is the one poses*.txt of
/// the folder; where `need_poses` is false, there may be none. `pcd_frame` is for PCD files alone.
std::unique_ptr<ScanSource> openScans(const std::string& path, const std::string& poses = "",
                                      PcdFrame pcd_frame = PcdFrame::kMap, bool need_poses = true);

}  // namespace rosbag_tests
