// SPDX-License-Identifier: BSD-3-Clause
//
// What divides a full node. Each split is a function and a row of the table at the end.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "rtree_occupancy_map/rtree.h"

namespace rtree_occupancy_map {
namespace {

constexpr std::uint8_t kUnassigned = 2;

std::int64_t expansion(const VoxelBox& box, const VoxelBox& by) {
  return unite(box, by).volume() - box.volume();
}

// Two growing groups; the one that needs all that is left to reach the minimum gets it.
class Groups {
 public:
  Groups(const std::vector<VoxelBox>& boxes, int min_entries, int seed0, int seed1)
      : boxes_(boxes),
        most_(static_cast<int>(boxes.size()) - min_entries),
        bounds_{boxes[seed0], boxes[seed1]},
        group_(boxes.size(), kUnassigned) {
    group_[seed0] = 0;
    group_[seed1] = 1;
  }

  bool unassigned(int i) const { return group_[i] == kUnassigned; }
  std::int64_t expansionOf(int group, int i) const { return expansion(bounds_[group], boxes_[i]); }

  // Least expansion, then the smaller volume, then the fewer entries.
  void assign(int i) {
    const auto cost = [&](int g) {
      return std::make_tuple(expansionOf(g, i), bounds_[g].volume(), count_[g]);
    };
    int g = cost(1) < cost(0) ? 1 : 0;
    if (count_[g] == most_) g = 1 - g;
    group_[i] = static_cast<std::uint8_t>(g);
    bounds_[g] = unite(bounds_[g], boxes_[i]);
    ++count_[g];
  }

  std::vector<std::uint8_t> take() { return std::move(group_); }

 private:
  const std::vector<VoxelBox>& boxes_;
  const int most_;
  VoxelBox bounds_[2];
  int count_[2] = {1, 1};
  std::vector<std::uint8_t> group_;
};

// Section 2.4.1, "Quadratic Splitting": the seeds waste the most volume together (metric J); then always the
// box that prefers one group over the other the most.
std::vector<std::uint8_t> splitQuadratic(const std::vector<VoxelBox>& boxes, int min_entries) {
  const int n = static_cast<int>(boxes.size());
  int seed0 = 0, seed1 = 1;
  std::int64_t most_waste = std::numeric_limits<std::int64_t>::min();
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j) {
      const std::int64_t waste = unite(boxes[i], boxes[j]).volume() - boxes[i].volume() - boxes[j].volume();
      if (waste > most_waste) {
        most_waste = waste;
        seed0 = i;
        seed1 = j;
      }
    }
  }
  Groups groups(boxes, min_entries, seed0, seed1);
  for (int left = n - 2; left > 0; --left) {
    int next = -1;
    std::int64_t most_preference = -1;
    for (int i = 0; i < n; ++i) {
      if (!groups.unassigned(i)) continue;
      const std::int64_t preference = std::abs(groups.expansionOf(0, i) - groups.expansionOf(1, i));
      if (preference > most_preference) {
        most_preference = preference;
        next = i;
      }
    }
    groups.assign(next);
  }
  return groups.take();
}

// Guttman's LinearPickSeeds: along each axis the two boxes that are furthest apart, as a share of the whole
// width.
std::vector<std::uint8_t> splitLinear(const std::vector<VoxelBox>& boxes, int min_entries) {
  const int n = static_cast<int>(boxes.size());
  const VoxelBox all = std::accumulate(boxes.begin(), boxes.end(), VoxelBox::empty(), unite);
  int seed0 = 0, seed1 = 1;
  double best = -std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    int high_min = 0, low_max = 0;
    for (int i = 1; i < n; ++i) {
      if (boxes[i].min[axis] > boxes[high_min].min[axis]) high_min = i;
    }
    if (high_min == 0) low_max = 1;
    for (int i = 0; i < n; ++i) {
      if (i != high_min && boxes[i].max[axis] < boxes[low_max].max[axis]) low_max = i;
    }
    const double separation =
        static_cast<double>(boxes[high_min].min[axis] - boxes[low_max].max[axis]) / all.width(axis);
    if (separation > best) {
      best = separation;
      seed0 = low_max;
      seed1 = high_min;
    }
  }
  Groups groups(boxes, min_entries, seed0, seed1);
  for (int i = 0; i < n; ++i) {
    if (groups.unassigned(i)) groups.assign(i);
  }
  return groups.take();
}

// Beckmann et al., section 4.2: the axis with the least sum of margins over all distributions of the sorted
// boxes, on it the distribution with the least overlap, then the least volume.
std::vector<std::uint8_t> splitRStar(const std::vector<VoxelBox>& boxes, int min_entries) {
  const int n = static_cast<int>(boxes.size());
  std::vector<int> order(n), best_order;
  std::vector<VoxelBox> head(n), tail(n);
  int best_count = 0;
  std::int64_t least_margin = std::numeric_limits<std::int64_t>::max();
  for (int axis = 0; axis < 3; ++axis) {
    std::int64_t margin = 0;
    auto least =
        std::make_tuple(std::numeric_limits<std::int64_t>::max(), std::numeric_limits<std::int64_t>::max());
    std::vector<int> axis_order;
    int axis_count = 0;
    for (const bool by_max : {false, true}) {
      std::iota(order.begin(), order.end(), 0);
      std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return by_max ? std::tie(boxes[a].max[axis], boxes[a].min[axis]) <
                            std::tie(boxes[b].max[axis], boxes[b].min[axis])
                      : std::tie(boxes[a].min[axis], boxes[a].max[axis]) <
                            std::tie(boxes[b].min[axis], boxes[b].max[axis]);
      });
      for (int i = 0; i < n; ++i) head[i] = i ? unite(head[i - 1], boxes[order[i]]) : boxes[order[i]];
      for (int i = n - 1; i >= 0; --i)
        tail[i] = i < n - 1 ? unite(tail[i + 1], boxes[order[i]]) : boxes[order[i]];
      for (int count = min_entries; count <= n - min_entries; ++count) {
        const VoxelBox &a = head[count - 1], &b = tail[count];
        margin += a.margin() + b.margin();
        const VoxelBox common = intersect(a, b);
        const auto cost = std::make_tuple(common.isEmpty() ? 0 : common.volume(), a.volume() + b.volume());
        if (cost < least) {
          least = cost;
          axis_order = order;
          axis_count = count;
        }
      }
    }
    if (margin < least_margin) {
      least_margin = margin;
      best_order = std::move(axis_order);
      best_count = axis_count;
    }
  }
  std::vector<std::uint8_t> group(n, 1);
  for (int i = 0; i < best_count; ++i) group[best_order[i]] = 0;
  return group;
}

}  // namespace

const mapping_common::Table<Split>& splits() {
  static const mapping_common::Table<Split> table{
      {"quadratic", splitQuadratic, "Guttman's, the thesis's choice"},
      {"linear", splitLinear, "Guttman's, faster"},
      {"rstar", splitRStar, "the R*-tree's (Beckmann et al. 1990), without its forced re-insertion"}};
  return table;
}

}  // namespace rtree_occupancy_map
