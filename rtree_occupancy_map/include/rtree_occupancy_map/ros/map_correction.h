// SPDX-License-Identifier: BSD-3-Clause
//
// How scans that went into a map go into one that was made anew along a corrected trajectory.
#pragma once

#include <mapping_common/corrected_maps.h>
#include <mapping_common/recent.h>
#include <rtree_occupancy_map/occupancy_map.h>

#include <Eigen/Geometry>
#include <memory>
#include <vector>

namespace rtree_occupancy_map {

struct InsertedScan {
  std::shared_ptr<const Scan> scan;                         ///< as it went into the map of then
  Eigen::Isometry3d moved = Eigen::Isometry3d::Identity();  ///< from there to the map of now
};
using RecentScans = mapping_common::Recent<InsertedScan>;

/// Keeps a scan, by its time.
void keep(Scan&& scan, RecentScans& recent);

/// @param options that the map must be like
/// @throws std::exception that says what is wrong with it
OccupancyMap readCorrected(const mapping_common::CorrectedMaps::Map& corrected, const Options& options);

/// Puts scans where they are in the corrected map.
void insertAll(const std::vector<RecentScans::Entry>& scans,
               const mapping_common::CorrectedMaps::Map& corrected, OccupancyMap& map);
/// From now on the map is the corrected one.
void correctAll(const mapping_common::CorrectedMaps::Map& corrected, RecentScans& recent);

}  // namespace rtree_occupancy_map
