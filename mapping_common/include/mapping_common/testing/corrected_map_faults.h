// SPDX-License-Identifier: BSD-3-Clause
//
// For tests of who takes corrected maps.
#pragma once

#include <mapping_msgs/CorrectedMap.h>

#include <cmath>
#include <functional>
#include <vector>

namespace mapping_common {

/// Copies of a good message, each with another fault for which a corrected map has to be refused.
inline std::vector<mapping_msgs::CorrectedMap> faultyCopies(const mapping_msgs::CorrectedMap& good) {
  using Map = mapping_msgs::CorrectedMap;
  const std::vector<std::function<void(Map&)>> faults = {
      [](Map& map) { map.header.frame_id = "elsewhere"; },
      [](Map& map) { map.header.stamp = ros::Time(4294967295U, 999999999U); },
      [](Map& map) { map.corrected_from = ros::Time(4294967295U, 0); },
      [](Map& map) { map.correction.orientation.w = 3.0; },
      [](Map& map) { map.correction.position.x = NAN; },
      [](Map& map) { map.correction.position.y = 1e300; },
      [](Map& map) { map.data.resize(map.data.size() / 2); },
      [](Map& map) { map.data.clear(); },
      [](Map& map) { map.data.assign(1000, 'x'); },
  };
  std::vector<Map> copies(faults.size(), good);
  for (std::size_t i = 0; i < faults.size(); ++i) faults[i](copies[i]);
  return copies;
}

}  // namespace mapping_common
