// SPDX-License-Identifier: BSD-3-Clause
//
// The ground around the sensor in rings and directions: how high what stands there is (the idea of Scan
// Context, Kim and Kim 2018), and how light it is. Seen from above, little changes where the sensor is some
// metres beside.
#include <algorithm>
#include <cmath>

#include "directions.h"
#include "intensity_place_recognition/global_description.h"

namespace intensity_place_recognition {
namespace {

constexpr float kHighest = 6.0f, kLowest = -3.0f;  // m from the sensor
constexpr int kFewest = 2;                         // points of a cell whose intensity counts

class Polar : public GlobalDescription {
 public:
  explicit Polar(const DescriptionOptions& options) : options_(options) {}

 private:
  std::vector<cv::Mat1f> matrices(const Scene& scene) const override {
    const int rings = options_.rings, directions = options_.directions;
    cv::Mat1f result(2 * rings, directions, 0.0f);
    cv::Mat1f height = result.rowRange(0, rings), light = result.rowRange(rings, 2 * rings);
    cv::Mat1i count(rings, directions, 0);
    const float per_ring = static_cast<float>(rings / options_.radius);
    forEachDirection(
        scene.cloud.points.data(), scene.cloud.size(),
        [&](const pcl::PointXYZI& p, const Directions& at, int i) {
          const float distance = at.flat[i];
          if (!(distance * per_ring < static_cast<float>(rings)) || !std::isfinite(p.z) || p.z > kHighest ||
              distance < scene.min_range)
            return;
          const int ring = static_cast<int>(distance * per_ring);
          const int direction =
              std::min(static_cast<int>((M_PI - at.azimuth[i]) / (2.0 * M_PI) * directions), directions - 1);
          height(ring, direction) = std::max(height(ring, direction), std::max(p.z - kLowest, 0.0f));
          light(ring, direction) += p.intensity;
          ++count(ring, direction);
        });
    // Each ring's intensities around their mean: how light things look depends on the distance.
    for (int r = 0; r < rings; ++r) {
      double sum = 0.0, squares = 0.0;
      int cells = 0;
      for (int d = 0; d < directions; ++d) {
        if (count(r, d) < kFewest) {
          count(r, d) = 0;
          continue;
        }
        light(r, d) /= static_cast<float>(count(r, d));
        sum += light(r, d);
        squares += light(r, d) * light(r, d);
        ++cells;
      }
      const double mean = sum / std::max(1, cells);
      const double deviation = std::sqrt(std::max(0.0, squares / std::max(1, cells) - mean * mean));
      for (int d = 0; d < directions; ++d) {
        light(r, d) = count(r, d) == 0 || deviation < 1e-9
                          ? 0.0f
                          : static_cast<float>(std::clamp((light(r, d) - mean) / deviation, -2.0, 2.0));
      }
    }
    return {result};
  }
  DescriptionOptions options_;
};

}  // namespace

std::unique_ptr<SceneDescription> makePolar(const DescriptionOptions& options) {
  return std::make_unique<Polar>(options);
}

}  // namespace intensity_place_recognition
