// SPDX-License-Identifier: BSD-3-Clause
//
// Part of rtree.h: best-first traversal (Hjaltason and Samet 1999), for k nearest neighbours and rays.
#pragma once

#include <limits>
#include <queue>

namespace rtree_occupancy_map {

template <class Distance, class Visit>
void RTree::visitByDistance(bool occupied_only, Distance&& distance, Visit&& visit) const {
  struct Item {
    double distance;
    NodeId id;
    int slot;  // -1: a node, otherwise the slot of a cell in leaf `id`
    bool operator<(const Item& o) const { return distance > o.distance; }
  };
  std::priority_queue<Item> queue;
  queue.push({0.0, root_, -1});
  while (!queue.empty()) {
    const Item item = queue.top();
    queue.pop();
    Node* n = node(item.id);
    if (item.slot >= 0) {
      if (!visit(cellAt(n, item.slot), item.distance)) return;
      continue;
    }
    for (int i = 0; i < n->count; ++i) {
      const Payload p = payloads(n)[i];
      const bool leaf = n->level == 0;
      if (occupied_only && !(leaf ? isOccupied(p.log_odds) : (p.child & kOccupiedBit) != 0)) continue;
      const double d = distance(boxes(n)[i]);
      if (d == std::numeric_limits<double>::infinity()) continue;
      queue.push({d, leaf ? item.id : p.child & ~kOccupiedBit, leaf ? i : -1});
    }
  }
}

template <class Visit>
void RTree::visitAlong(const Ray& ray, bool occupied_only, Visit&& visit) const {
  const auto enter = [&ray](const VoxelBox& box) {
    const Ray::Interval t = ray.inside(box);
    return t.empty() ? std::numeric_limits<double>::infinity() : t.enter;
  };
  visitByDistance(occupied_only, enter, visit);
}

}  // namespace rtree_occupancy_map
