// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/beams.h"

#include <algorithm>
#include <cmath>

namespace intensity_hector_slam {

void Beams::reset(std::size_t n) {
  count = n;
  for (auto* values : {&x, &y, &reflectivity, &known, &valid}) {
    values->assign((n + kLanes - 1) / kLanes * kLanes, 0.0f);
  }
}

void Beams::assign(const Scan& scan) {
  const std::size_t n = scan.points.size();
  reset(n);
  double sum = 0.0;
  std::size_t all_known = 0;
  for (std::size_t i = 0; i < n; ++i) {
    x[i] = scan.points[i].x();
    y[i] = scan.points[i].y();
    valid[i] = 1.0f;
    if (!scan.reflectivities.empty() && std::isfinite(scan.reflectivities[i])) {
      reflectivity[i] = scan.reflectivities[i];
      known[i] = 1.0f;
      ++all_known;
    }
    sum += scan.points[i].norm();
  }
  mean_range = n > 0 ? std::max(0.1, sum / n) : 1.0;
  share_known = n > 0 ? static_cast<double>(all_known) / n : 0.0;
}

void Beams::assignSparse(const Beams& all, std::size_t most) {
  const std::size_t groups = all.x.size() / kLanes, step = std::max<std::size_t>(1, all.x.size() / most);
  reset((groups + step - 1) / step * kLanes);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t from = i / kLanes * step * kLanes + i % kLanes;
    x[i] = all.x[from];
    y[i] = all.y[from];
    reflectivity[i] = all.reflectivity[from];
    known[i] = all.known[from];
    valid[i] = all.valid[from];
  }
}

void Beams::assignThinned(const Beams& all, double spacing, int levels, std::size_t least) {
  const float square = static_cast<float>(spacing * spacing);
  begins_.clear();
  for (std::size_t i = 0; i < all.count; ++i) {
    const std::size_t first = begins_.empty() ? i : begins_.back();
    const float dx = all.x[i] - all.x[first], dy = all.y[i] - all.y[first];
    if (i == first || dx * dx + dy * dy >= square) begins_.push_back(i);
  }
  const std::size_t n = begins_.size(), used = std::max(n / 2, std::min(n, least));
  begins_.push_back(all.count);
  reset(n);
  std::size_t next = 0;
  const auto add = [&](std::size_t group) {
    const std::size_t begin = begins_[group], end = begins_[group + 1];
    float sum_x = 0.0f, sum_y = 0.0f, sum_reflectivity = 0.0f, sum_known = 0.0f;
    for (std::size_t i = begin; i < end; ++i) {
      sum_x += all.x[i];
      sum_y += all.y[i];
      sum_reflectivity += all.reflectivity[i];
      sum_known += all.known[i];
    }
    x[next] = sum_x / (end - begin);
    y[next] = sum_y / (end - begin);
    reflectivity[next] = sum_reflectivity / std::max(sum_known, 1.0f);
    known[next] = std::min(sum_known, 1.0f);
    valid[next] = 1.0f;
    ++next;
  };
  std::size_t step = std::size_t{1} << (levels - 1);
  for (std::size_t i = 0; i < n; i += step) add(i);
  for (; step > 1; step /= 2) {
    for (std::size_t i = step / 2; i < n && next < used; i += step) add(i);
  }
}

}  // namespace intensity_hector_slam
