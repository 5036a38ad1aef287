// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/scan_check.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "directions.h"

namespace intensity_place_recognition {
namespace {

constexpr float kNarrowest = 0.035f;   // rad of elevation
constexpr double kTransparent = 0.15;  // of the directions; 0.02 to 0.04 in recordings of several lidars
constexpr float kBehind = 1.5f;        // times as far
constexpr int kColumns = 720, kRows = 360;
constexpr std::size_t kFewest = 500;  // points

template <class... Parts>
[[noreturn]] void refuse(const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  throw std::invalid_argument(text.str());
}

}  // namespace

void checkScan(const Cloud& cloud, const PanoramaOptions& options) {
  if (cloud.empty()) refuse("the cloud is empty");
  const auto nearest = static_cast<float>(options.min_range),
             farthest = static_cast<float>(options.max_range);
  std::size_t measured = 0, in_reach = 0;
  float darkest = INFINITY, lightest = -INFINITY, lowest = 1.0f, highest = -1.0f;  // these first as sines
  for (const pcl::PointXYZI& p : cloud) {
    if (!isMeasured(p)) continue;
    ++measured;
    const float range = p.getVector3fMap().norm();
    if (range < nearest || range > farthest) continue;
    ++in_reach;
    darkest = std::min(darkest, p.intensity);
    lightest = std::max(lightest, p.intensity);
    lowest = std::min(lowest, p.z / range);
    highest = std::max(highest, p.z / range);
  }
  lowest = std::asin(lowest);
  highest = std::asin(highest);
  if (measured == 0)
    refuse("none of the cloud's ", cloud.size(),
           " points was measured: they aren't finite, or at the origin");
  if (in_reach < kFewest)
    refuse("only ", in_reach, " of the cloud's ", cloud.size(), " points are ", options.min_range, " to ",
           options.max_range, " m from the sensor, at least ", kFewest, " are needed");
  if (darkest == lightest)
    refuse("all intensities are ", darkest, ": the sensor gives none, or the driver drops them");
  if (highest - lowest < kNarrowest)
    refuse("all points are within ", (highest - lowest) * 180.0 / M_PI,
           " degrees of elevation, in one ring: places are recognised in scans of 3D scanners");
  const double part = transparency(cloud, options);
  if (part > kTransparent)
    refuse("in ", std::lround(100.0 * part),
           " % of the directions there are surfaces one behind the other, as if the "
           "sensor weren't at the cloud's origin: clouds have to be in the sensor's own frame");
}

double transparency(const Cloud& cloud, const PanoramaOptions& options) {
  struct Range {
    float nearest = INFINITY, farthest = 0.0f;  // squared
    int count = 0;
  };
  std::vector<Range> ranges(static_cast<std::size_t>(kColumns) * kRows);
  const auto nearest = static_cast<float>(options.min_range * options.min_range),
             farthest = static_cast<float>(options.max_range * options.max_range);
  const auto per_column = static_cast<float>((kColumns - 1) / (2.0 * M_PI)),
             per_row = static_cast<float>((kRows - 1) / M_PI);
  forEachDirection(cloud.points.data(), cloud.size(), [&](const auto&, const Directions& at, int i) {
    const float squared = at.squared[i];
    if (!(squared > 0.0f && squared >= nearest && squared <= farthest)) return;
    const int x = static_cast<int>(at.azimuth[i] * per_column + 0.5f * (kColumns - 1));
    const int y = static_cast<int>(at.elevation[i] * per_row + 0.5f * (kRows - 1));
    Range& r = ranges[static_cast<std::size_t>(y) * kColumns + x];
    r.nearest = std::min(r.nearest, squared);
    r.farthest = std::max(r.farthest, squared);
    ++r.count;
  });
  std::size_t several = 0, behind = 0;
  for (const Range& r : ranges) {
    several += r.count > 1;
    behind += r.count > 1 && r.farthest > kBehind * kBehind * r.nearest;
  }
  return several > 0 ? static_cast<double>(behind) / static_cast<double>(several) : 0.0;
}

}  // namespace intensity_place_recognition
