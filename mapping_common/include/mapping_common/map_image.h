// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace mapping_common {

/// A 2D occupancy map as map_server and all that read its format take it.
struct MapImage {
  static constexpr std::uint8_t kOccupied = 0, kFree = 254, kUnknown = 205;

  int width = 0, height = 0;              ///< pixels
  double resolution = 0.0;                ///< m, edge of a pixel
  double origin_x = 0.0, origin_y = 0.0;  ///< m, map frame: lower left corner of the lower left pixel
  std::vector<std::uint8_t> pixels;       ///< row by row, the topmost first
};

/// Writes the image (PGM), and beside it the YAML file that map_server is called with: the image's path with
/// another ending.
/// @param path of either, which ends in .pgm or .yaml
/// @throws std::runtime_error that names the file
void writeMapImage(const std::string& path, const MapImage& image);

}  // namespace mapping_common
