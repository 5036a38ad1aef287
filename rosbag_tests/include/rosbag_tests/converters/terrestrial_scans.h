// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rosbag_tests/converters/scan_files.h>

#include <memory>
#include <string>
#include <vector>

namespace rosbag_tests {

/// The scans of a terrestrial scanner's files (E57, PTX, PTS, ASC), in the order of the files' names and, of
/// one file, of its scans. They are streamed: memory grows with the voxels that hold points, not with the
/// file. Intensities are the files' own. A file that can't be opened is one faulty scan. Stamps are made up:
/// the scan's number, s.
/// @param paths files, or folders of them @param voxel m, edge of voxels of which each becomes the mean of
///   its points; 0: all points
/// @throws std::runtime_error for a path that isn't there, and for a folder without any such file
std::unique_ptr<ScanSource> openTerrestrialScans(const std::vector<std::string>& paths, double voxel);

}  // namespace rosbag_tests
