// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/clock_line.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace hokuyo_sick_drivers {
namespace {

// What a half-plane leaves of a convex polygon.
// @param inside of a corner: its distance to the edge, in any unit; linear, at least zero if it stays
template <class Corner, class Distance>
void cut(std::vector<Corner>& polygon, Distance inside) {
  if (std::all_of(polygon.begin(), polygon.end(),
                  [&](const Corner& corner) { return inside(corner) >= 0.0; }))
    return;
  std::vector<Corner> rest;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Corner &from = polygon[i], &to = polygon[(i + 1) % polygon.size()];
    const double a = inside(from), b = inside(to);
    if (a >= 0.0) rest.push_back(from);
    if ((a >= 0.0) != (b >= 0.0)) {
      const double part = a / (a - b);
      rest.push_back(
          {from.offset + part * (to.offset - from.offset), from.drift + part * (to.drift - from.drift)});
    }
  }
  polygon = std::move(rest);
}

}  // namespace

Nanoseconds ClockLine::offsetAt(Nanoseconds time) const {
  return point.offset + std::llround(drift * static_cast<double>(time - point.time));
}

// The edge of the lower convex hull that spans the mean of the abscissae.
ClockLine lineBelow(const std::deque<ClockOffset>& points, double min_drift, double max_drift) {
  const ClockOffset& first = points.front();
  std::vector<ClockOffset> hull;
  double mean = 0.0;
  for (const ClockOffset& point : points) {
    const auto isAbove = [&](const ClockOffset& from, const ClockOffset& middle) {
      return static_cast<double>(middle.time - from.time) * (point.offset - from.offset) <=
             static_cast<double>(middle.offset - from.offset) * (point.time - from.time);
    };
    while (hull.size() > 1 && isAbove(hull[hull.size() - 2], hull.back())) hull.pop_back();
    hull.push_back(point);
    mean += static_cast<double>(point.time - first.time) / points.size();
  }
  ClockLine line;
  if (hull.size() > 1) {
    std::size_t end = 1;
    while (end + 1 < hull.size() && hull[end].time - first.time < mean) ++end;
    const ClockOffset &from = hull[end - 1], &to = hull[end];
    line.drift = static_cast<double>(to.offset - from.offset) / (to.time - from.time);
  }
  line.drift = std::clamp(line.drift, min_drift, max_drift);
  const auto height = [&](const ClockOffset& point) {
    return point.offset - first.offset - line.drift * (point.time - first.time);
  };
  line.point = *std::min_element(hull.begin(), hull.end(), [&](const ClockOffset& a, const ClockOffset& b) {
    return height(a) < height(b);
  });
  return line;
}

// Of the polygon of the lines that are possible, by offset at the first strip and by drift, each strip cuts
// off what doesn't pass through it at both ends.
LineSet::LineSet(const std::deque<ClockOffset>& points, Nanoseconds below, Nanoseconds above,
                 double max_drift, Nanoseconds tolerance)
    : origin_(points.front()) {
  for (double slack = tolerance; corners_.empty(); slack *= 2.0) {
    const double least = -slack - below, greatest = above + slack;
    corners_ = {{least, -max_drift}, {greatest, -max_drift}, {greatest, max_drift}, {least, max_drift}};
    for (const ClockOffset& point : points) {
      const double age = point.time - origin_.time, offset = point.offset - origin_.offset;
      cut(corners_, [&](const Line& line) { return offset + greatest - line.offsetAt(age); });
      cut(corners_, [&](const Line& line) { return line.offsetAt(age) - (offset + least); });
    }
  }
}

Interval LineSet::offsetsAt(Nanoseconds time) const {
  const double age = time - origin_.time;
  Interval offsets{INFINITY, -INFINITY};
  for (const Line& line : corners_) offsets.include(origin_.offset + line.offsetAt(age));
  return offsets;
}

Interval LineSet::drifts() const {
  Interval drifts{INFINITY, -INFINITY};
  for (const Line& line : corners_) drifts.include(line.drift);
  return drifts;
}

}  // namespace hokuyo_sick_drivers
