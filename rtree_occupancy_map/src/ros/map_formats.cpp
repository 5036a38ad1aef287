// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/map_formats.h"

#include <mapping_common/map_image.h>
#include <rtree_occupancy_map/map_transform.h>
#include <rtree_occupancy_map/octomap_file.h>
#include <rtree_occupancy_map/pcd_file.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace rtree_occupancy_map {
namespace {

constexpr std::pair<const char*, MapFormat> kEndings[] = {
    {"", MapFormat::kRTree},          {".map", MapFormat::kRTree},
    {".db", MapFormat::kRTree},       {".bt", MapFormat::kOctomapBinary},
    {".ot", MapFormat::kOctomapFull}, {".pcd", MapFormat::kPcd},
    {".pgm", MapFormat::kMapServer},  {".yaml", MapFormat::kMapServer}};

std::string endingOf(const std::string& path) {
  return std::filesystem::path(path).extension().string();
}

mapping_common::MapImage imageOf(const nav_msgs::OccupancyGrid& grid) {
  using mapping_common::MapImage;
  MapImage image;
  image.width = static_cast<int>(grid.info.width);
  image.height = static_cast<int>(grid.info.height);
  image.resolution = static_cast<double>(grid.info.resolution);
  image.origin_x = grid.info.origin.position.x;
  image.origin_y = grid.info.origin.position.y;
  image.pixels.reserve(grid.data.size());
  for (int y = image.height - 1; y >= 0; --y) {
    const auto row = grid.data.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
    std::transform(row, row + image.width, std::back_inserter(image.pixels), [](std::int8_t value) {
      return value < 0 ? MapImage::kUnknown : value > 50 ? MapImage::kOccupied : MapImage::kFree;
    });
  }
  return image;
}

std::string writeProjection(const OccupancyMap& map, const std::string& path, const DisplayOptions& options) {
  ProjectedMap projection;
  projection.rebuild(map, options.occupancy_min_z, options.occupancy_max_z, options.occupancy_max_size, {});
  mapping_common::MapImage image = imageOf(projection.grid());
  image.resolution = map.options().resolution;
  mapping_common::writeMapImage(path, image);
  std::ostringstream text;
  text << image.width << " x " << image.height << " pixels";
  if (projection.leavesOut()) {
    text << ", which are " << image.width * image.resolution << " m x " << image.height * image.resolution
         << " m of " << projection.wholeSize().x() << " m x " << projection.wholeSize().y() << " m,";
  }
  return text.str();
}

// Of a map that is to be read. @throws std::runtime_error of one that can't be
bool isOctomap(const std::string& path) {
  const std::string ending = endingOf(path);
  if (ending == ".pcd" || ending == ".pgm" || ending == ".yaml") {
    throw std::runtime_error(path +
                             " was not loaded: such files don't tell what is free in three dimensions; "
                             "allowed are those of the R-tree map, and .bt and .ot of OctoMap");
  }
  return ending == ".bt" || ending == ".ot";
}

}  // namespace

MapFormat formatOf(const std::string& path) {
  const std::string ending = endingOf(path);
  for (const auto& [known, format] : kEndings)
    if (ending == known) return format;
  throw std::invalid_argument("path is '" + path +
                              "', allowed endings are .map or none (the R-tree map), .db (the same as a "
                              "store), .bt and .ot (OctoMap), .pcd "
                              "(occupied voxels), .pgm and .yaml (seen from above, for map_server)");
}

std::string writeMap(const OccupancyMap& map, const std::string& path, const DisplayOptions& projection) {
  std::string what = std::to_string(map.size()) + " cells";
  switch (formatOf(path)) {
    case MapFormat::kRTree:
      map.save(path);
      break;
    case MapFormat::kOctomapBinary:
      writeOctomap(map, path, OctomapFormat::kBinary);
      break;
    case MapFormat::kOctomapFull:
      writeOctomap(map, path, OctomapFormat::kFull);
      break;
    case MapFormat::kPcd:
      what = std::to_string(writePcd(map, path)) + " points";
      break;
    case MapFormat::kMapServer:
      what = writeProjection(map, path, projection);
      break;
  }
  return "Wrote " + what + " to " + path;
}

OccupancyMap readMap(const std::string& path) {
  return isOctomap(path) ? readOctomap(path) : OccupancyMap::load(path);
}

OccupancyMap readMap(const std::string& path, const Options& options, OtherResolution other) {
  OccupancyMap map = isOctomap(path) ? readOctomap(path, options) : OccupancyMap::load(path, options);
  const double resolution = map.options().resolution;
  if (other == OtherResolution::kAdopt || std::abs(resolution - options.resolution) < 1e-6 * resolution)
    return map;
  if (other == OtherResolution::kRefuse) {
    std::ostringstream text;
    text << path << " was not loaded: its voxels are of " << resolution << " m, resolution is "
         << options.resolution
         << " m. other_resolution says whether such a map is converted, or its resolution adopted";
    throw std::runtime_error(text.str());
  }
  Options converted = map.options();
  converted.resolution = options.resolution;
  return transformed(map, Eigen::Isometry3d::Identity(), converted);
}

}  // namespace rtree_occupancy_map
