// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/robot_body.h"

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace rtree_occupancy_map {

std::vector<BodyBox> parseRobotBody(const std::string& text) {
  std::vector<BodyBox> boxes;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ';');) {
    std::istringstream words(part);
    BodyBox box;
    if (!(words >> box.frame)) continue;  // blank
    double edges[6] = {};
    bool good = true;
    for (double& edge : edges) good = words >> edge && std::isfinite(edge) && good;
    std::string more;
    box.box = {Eigen::Vector3d(edges[0], edges[1], edges[2]), Eigen::Vector3d(edges[3], edges[4], edges[5])};
    if (!good || words >> more || box.box.isEmpty()) {
      throw std::invalid_argument("robot_body has '" + part +
                                  "', expected is FRAME MIN_X MIN_Y MIN_Z MAX_X MAX_Y MAX_Z");
    }
    boxes.push_back(box);
  }
  return boxes;
}

std::size_t removeHitsIn(const Eigen::AlignedBox3d& box, const Eigen::Isometry3d& box_in_map, Scan& scan) {
  const Eigen::Isometry3f to_box = box_in_map.inverse().cast<float>();
  const Eigen::AlignedBox3f inside = box.cast<float>();
  return removeHits([&](const Eigen::Vector3f& hit) { return inside.contains(to_box * hit); }, scan);
}

}  // namespace rtree_occupancy_map
