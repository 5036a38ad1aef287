// SPDX-License-Identifier: BSD-3-Clause
//
// Maps made anew of what a session has kept, along the poses of a graph.
#pragma once

#include <intensity_hector_slam/slam.h>
#include <rtree_occupancy_map/occupancy_map.h>

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "pose_graph/graph.h"
#include "pose_graph/session.h"

namespace pose_graph {

// Scans and clouds as a session keeps them (KeyData::data), in the frame that KeyData::sensor is the pose of.

/// Kind, format and data, and the stamp to 1 us; the rest is up to the caller. Of a scan in the frame of the
/// body that was taken at the key pose, `sensor` is the identity.
KeyData toKeyData(const intensity_hector_slam::Scan& scan);
KeyData toKeyData(const rtree_occupancy_map::Scan& cloud);
/// @throws std::runtime_error where the data are of another kind or format, or damaged
intensity_hector_slam::Scan toScan(const KeyData& data);
rtree_occupancy_map::Scan toCloud(const KeyData& data);

/// The pose of the data's frame in the map. @return none where the graph hasn't got the key pose
std::optional<Pose> poseOf(const KeyData& data, const Graph& graph);

/// What maps are made with.
struct MapBuildOptions {
  intensity_hector_slam::SlamOptions slam;
  rtree_occupancy_map::Options occupancy;
};
/// Keeps what differs from the defaults in a session's settings, by the options' names after "slam/" and
/// "occupancy/".
void keepOptions(const MapBuildOptions& options, SessionWriter& writer);
/// What was kept.
/// @throws std::runtime_error that names the file and the setting that won't do
MapBuildOptions mapOptions(const Session& session);

/// Is told the share that is done, 0 to 1, after each scan or cloud; false ends the work.
using MapProgress = std::function<bool(double share)>;

template <class Map>
struct BuiltMap {
  Map map;
  std::size_t inserted = 0;     ///< scans or clouds
  std::int64_t last_stamp = 0;  ///< of these, ns
};

/// The 2D map of all key scans at the graph's poses, in the order of their stamps. Each goes in.
/// @param options of the map and of how scans go into it, as SLAM has them
/// @return none where it was ended
/// @throws std::runtime_error that says which data are damaged
std::optional<BuiltMap<intensity_hector_slam::MultiMap>> buildGridMap(
    const Session& session, const Graph& graph, const intensity_hector_slam::SlamOptions& options,
    const MapProgress& progress = {});

/// The R-tree map of all key clouds, the same way; without any, of all key scans.
std::optional<BuiltMap<rtree_occupancy_map::OccupancyMap>> buildOccupancyMap(
    const Session& session, const Graph& graph, const rtree_occupancy_map::Options& options,
    const MapProgress& progress = {});

struct CloudPoint {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();  ///< m, map frame
  float intensity = 0.0F;                              ///< reflectivity; NaN: unknown
};
/// The returns of all key clouds; without any, of all key scans.
/// @param voxel m, of each cube with this edge the mean of all points in it; 0: all points
/// @return none where it was ended
std::optional<std::vector<CloudPoint>> buildCloud(const Session& session, const Graph& graph,
                                                  double voxel = 0.0, const MapProgress& progress = {});
/// A binary PCD file of PCL with x y z intensity. @throws std::runtime_error that names the file
void writePcd(const std::string& path, const std::vector<CloudPoint>& points);

}  // namespace pose_graph
