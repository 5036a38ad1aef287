// SPDX-License-Identifier: BSD-3-Clause
//
// What a run leaves behind. Each file is whole or isn't there; all throw std::runtime_error that names the
// file.
#pragma once

#include <intensity_hector_slam/ros/bag_runner.h>

#include <string>

namespace intensity_hector_slam {

/// "stamp x y z qx qy qz qw" of each scan that was matched.
void writeTum(const std::string& path, const BagResult& result);
/// Vertices and edges (SE2) of the key poses.
void writeG2o(const std::string& path, const std::vector<Edge>& edges);
/// DIRECTORY/map.pgm and map.yaml, as map_server reads them.
void writeOccupancy(const std::string& directory, const GridMap& map);
/// Colours from blue (reflectivity 0) to red (1), black where nothing was hit. The known part of the map,
/// north up.
void writeReflectivity(const std::string& path, const GridMap& map);
/// Times and counts (JSON).
void writeTiming(const std::string& path, const BagResult& result);

}  // namespace intensity_hector_slam
