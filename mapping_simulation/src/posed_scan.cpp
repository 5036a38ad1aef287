// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/posed_scan.h>

#include <cmath>

namespace mapping_simulation {

PosedScan toPosedScan(const SensorConfig& sensor, const Sweep& sweep) {
  PosedScan scan;
  scan.name = sensor.topic;
  scan.stamp = sweep.stamp;
  scan.pose = sweep.pose;
  const int rings = static_cast<int>(sensor.elevations.size());
  scan.cloud = pcl::PointCloud<pcl::PointXYZI>(sensor.columns, rings);
  scan.cloud.is_dense = false;
  scan.cloud.header.frame_id = sensor.frame_id;
  for (int column = 0; column < sensor.columns; ++column) {
    for (int ring = 0; ring < rings; ++ring) {
      const Echo& echo = sweep.echoes[static_cast<std::size_t>(column) * rings + ring];
      pcl::PointXYZI& point = scan.cloud.at(column, ring);
      const double range = std::isfinite(echo.range) ? echo.range : NAN;
      point.getVector3fMap() = (range * sensor.direction(column, ring)).cast<float>();
      point.intensity = static_cast<float>(echo.intensity);
    }
  }
  return scan;
}

}  // namespace mapping_simulation
