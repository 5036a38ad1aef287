// SPDX-License-Identifier: BSD-3-Clause
//
// Files of maps, of this package's format and of others'. The path's ending says which.
#pragma once

#include <rtree_occupancy_map/occupancy_map.h>
#include <rtree_occupancy_map/ros/map_publisher.h>

#include <string>

namespace rtree_occupancy_map {

enum class MapFormat { kRTree, kOctomapBinary, kOctomapFull, kPcd, kMapServer };

/// Of a file to be written: .map or no ending, .bt, .ot, .pcd, .pgm or .yaml.
/// @throws std::invalid_argument of another ending; it says which there are
MapFormat formatOf(const std::string& path);

/// @param projection the heights and the size of the projected map (.pgm, .yaml)
/// @return what was written, in a sentence
/// @throws std::invalid_argument as formatOf; std::runtime_error that names the file
std::string writeMap(const OccupancyMap& map, const std::string& path, const DisplayOptions& projection = {});

/// What becomes of a file's map of another resolution than asked for.
enum class OtherResolution { kAdopt, kConvert, kRefuse };
constexpr auto choicesOf(OtherResolution) {
  return mapping_common::choices<OtherResolution>(
      {{"adopt", OtherResolution::kAdopt, "the map has the file's from then on, as with octomap_server"},
       {"convert", OtherResolution::kConvert,
        "the map gets the one below: larger voxels are as occupied as the most occupied part of them"},
       {"refuse", OtherResolution::kRefuse, "it isn't loaded"}});
}

/// Of .bt and .ot, those of OctoMap; of others, that of this package.
/// @param options of which OctoMap's files take all but the resolution, others what a file doesn't settle
/// (without: the defaults, and the colours of a ColorOcTree)
/// @param other what is done if the resolution isn't that of the options
/// @throws std::runtime_error that names the file and says what is wrong with it
OccupancyMap readMap(const std::string& path);
OccupancyMap readMap(const std::string& path, const Options& options,
                     OtherResolution other = OtherResolution::kAdopt);

}  // namespace rtree_occupancy_map
