// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "e57_fields.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

/// What the XML part of an E57 file says of a scan.
struct E57Scan {
  std::string name;
  std::vector<E57Field> fields;   ///< in the order of the streams
  std::uint64_t file_offset = 0;  ///< physical, of the points' section
  std::uint64_t records = 0;
  std::optional<Limits> rows, columns;  ///< indexBounds
  std::optional<Limits> intensity;
  std::array<std::optional<Limits>, 3> colour;  ///< red, green, blue
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  bool has_pose = false;
};

/// @param warnings gets what could be helped
/// @throws std::runtime_error
std::vector<E57Scan> parseE57Xml(const std::string& xml, std::vector<std::string>& warnings);

}  // namespace hokuyo_sick_drivers
