// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <vector>

namespace mapping_simulation {

/// Tree of axis-aligned boxes around items, split at the median along the longest axis.
class Bvh {
 public:
  using Box = Eigen::AlignedBox3d;

  Bvh() = default;
  explicit Bvh(const std::vector<Box>& boxes) : items_(boxes.size()) {
    std::iota(items_.begin(), items_.end(), 0);
    if (!boxes.empty()) build(boxes, 0, static_cast<int>(boxes.size()));
  }

  /// Calls `visit(item, range)` for items whose box the ray enters before `range`, nearer boxes first;
  /// `visit` shortens `range` to what it found.
  template <typename Visit>
  void traverse(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double& range,
                Visit visit) const {
    if (nodes_.empty()) return;
    // A huge value in place of infinity, for 0 times it is 0.
    const Eigen::Array3d inverse =
        direction.unaryExpr([](double d) { return d == 0.0 ? 1e300 : 1.0 / d; }).array();
    const auto entry = [&](int node) {
      const Eigen::Array3d a = (nodes_[node].box.min() - origin).array() * inverse;
      const Eigen::Array3d b = (nodes_[node].box.max() - origin).array() * inverse;
      const double in = std::max(a.min(b).maxCoeff(), 0.0);
      return in <= a.max(b).minCoeff() ? in : std::numeric_limits<double>::infinity();
    };
    struct Pending {
      int node;
      double entry;
    };
    std::array<Pending, 64> stack;
    int depth = 0;
    stack[depth++] = {0, entry(0)};
    while (depth > 0) {
      const Pending next = stack[--depth];
      if (!(next.entry < range)) continue;
      const Node& node = nodes_[next.node];
      for (int i = node.first; i < node.last; ++i) visit(items_[i], range);
      if (node.first < node.last) continue;
      Pending near{next.node + 1, entry(next.node + 1)}, far{node.right, entry(node.right)};
      if (far.entry < near.entry) std::swap(near, far);
      stack[depth++] = far;
      stack[depth++] = near;
    }
  }

 private:
  struct Node {
    Box box;
    int first = 0, last = 0;  // items of a leaf; an inner node has none, and its left child follows it
    int right = 0;
  };

  int build(const std::vector<Box>& boxes, int first, int last) {
    const int index = static_cast<int>(nodes_.size());
    nodes_.emplace_back();
    Box box;
    for (int i = first; i < last; ++i) box.extend(boxes[items_[i]]);
    nodes_[index].box = box;
    if (last - first <= 2) {
      nodes_[index].first = first;
      nodes_[index].last = last;
    } else {
      int axis;
      box.sizes().maxCoeff(&axis);
      const int middle = (first + last) / 2;
      std::nth_element(items_.begin() + first, items_.begin() + middle, items_.begin() + last,
                       [&](int a, int b) { return boxes[a].center()[axis] < boxes[b].center()[axis]; });
      build(boxes, first, middle);
      const int right = build(boxes, middle, last);
      nodes_[index].right = right;
    }
    return index;
  }

  std::vector<Node> nodes_;
  std::vector<int> items_;
};

}  // namespace mapping_simulation
