// SPDX-License-Identifier: BSD-3-Clause
//
// R-tree of order (d, M) over grid cells (section 2.4; Guttman 1984). Besides Guttman's insertion and
// deletion it can replace all cells of a box at once, which is how a scan enters: the leaves of the box are
// packed anew and only leaves, not cells, climb the hierarchy.
#pragma once

#include <mapping_common/options.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "rtree_occupancy_map/cell.h"
#include "rtree_occupancy_map/ray.h"

namespace rtree_occupancy_map {

/// Divides the boxes of an overfull node in two groups of at least `min_entries` each.
/// @return the group, 0 or 1, of each box
using Split = std::vector<std::uint8_t> (*)(const std::vector<VoxelBox>& boxes, int min_entries);
/// All there are, by the names that RTreeOptions::split and map files have for them.
const mapping_common::Table<Split>& splits();

struct RTreeOptions {
  int min_entries = 6, max_entries = 16;  ///< d, M
  std::string split = "quadratic";        ///< a name of splits()
  float occupied_log_odds = 0.0F;         ///< cells from here up count as occupied: see visitOccupied
  bool store_reflectivity =
      false;  ///< otherwise the cells' reflectivity is dropped, which saves 8 bytes a cell

  void describe(mapping_common::OptionList& o) {
    o("min_entries", min_entries, "", "d: least number of entries of a node that isn't the root, up to M / 2")
        .within(1, 128);
    o("max_entries", max_entries, "", "M: greatest number of entries of a node").within(2, 256);
    o("split", split, "", "of a full node").oneOf(splits());
    o.require(min_entries <= max_entries / 2, "min_entries", "1 to half of max_entries");
  }
};

class RTree {
 public:
  /// @throws std::invalid_argument where the options won't do
  explicit RTree(const RTreeOptions& options = {});
  RTree(RTree&&) noexcept;
  RTree& operator=(RTree&&) noexcept;
  ~RTree();

  const RTreeOptions& options() const { return options_; }

  /// Least expansion on the way down, ties by the smaller volume; a full node is split.
  void insert(const Cell& cell);

  /// Removes the cell with exactly this box; nodes that fall below d dissolve and their entries are inserted
  /// again.
  /// @return false where there is none
  bool erase(const VoxelBox& box);

  /// Puts `cells` in the place of all cells that are contained in `region`. Cells that merely overlap it
  /// stay. Neighbours in `cells` share leaves: order them by place.
  void replace(const VoxelBox& region, const std::vector<Cell>& cells);

  /// Replaces the whole content, packed along a Z-order curve.
  void bulkLoad(std::vector<Cell> cells);

  void clear();

  std::size_t size() const { return num_cells_; }        ///< cells
  std::size_t numNodes() const { return num_nodes_; }    ///< nodes of all levels, leaves and root included
  int height() const { return node(root_)->level + 1; }  ///< 1: the root is a leaf
  std::size_t memoryUsage() const;                       ///< bytes
  std::size_t usedMemory() const { return num_nodes_ * stride_; }  ///< bytes of nodes that aren't spare
  /// Gives spare nodes back, where they are more than the others.
  void shrink();
  VoxelBox bounds() const;  ///< tight; VoxelBox::empty() without cells

  /// Depth first over the nodes and cells whose boxes pass `enter(box)`; `visit(cell)` returns false to stop.
  /// @return false if it was stopped
  template <class Enter, class Visit>
  bool visitIf(Enter&& enter, Visit&& visit) const {
    return visitNode<false>(root_, enter, visit);
  }

  /// The same over occupied cells alone: a subtree without any is not entered.
  template <class Enter, class Visit>
  bool visitOccupiedIf(Enter&& enter, Visit&& visit) const {
    return visitNode<true>(root_, enter, visit);
  }

  template <class Visit>
  bool visitAll(Visit&& visit) const {
    return visitIf([](const VoxelBox&) { return true; }, visit);
  }
  template <class Visit>
  bool visitOccupied(Visit&& visit) const {
    return visitOccupiedIf([](const VoxelBox&) { return true; }, visit);
  }
  template <class Visit>
  bool visitOverlapping(const VoxelBox& query, Visit&& visit) const {
    return visitIf([&query](const VoxelBox& b) { return query.overlaps(b); }, visit);
  }
  /// Cells that lie in the query box as a whole.
  template <class Visit>
  bool visitContained(const VoxelBox& query, Visit&& visit) const {
    return visitOverlapping(query, [&](const Cell& c) { return query.contains(c.box) ? visit(c) : true; });
  }
  /// Cells that the query box lies in as a whole.
  template <class Visit>
  bool visitContaining(const VoxelBox& query, Visit&& visit) const {
    return visitIf([&query](const VoxelBox& b) { return b.contains(query); }, visit);
  }

  /// Leaf by leaf, for loops that count: `visit(leaf)` for each leaf that overlaps the query box.
  template <class Visit>
  void visitLeaves(const VoxelBox& query, Visit&& visit) const {
    visitLeavesBelow(root_, query, visit);
  }

  /// Best first: cells by increasing `distance(box)`, a lower bound that must not decrease from a box to a
  /// part of it; infinity leaves a subtree out. `visit(cell, distance)` returns false to stop.
  template <class Distance, class Visit>
  void visitByDistance(bool occupied_only, Distance&& distance, Visit&& visit) const;

  /// Cells that the ray runs through, by the distance (voxels) at which it enters them; `visit` as above.
  template <class Visit>
  void visitAlong(const Ray& ray, bool occupied_only, Visit&& visit) const;

  /// The cells of one leaf.
  class Leaf {
   public:
    int size() const { return size_; }
    const VoxelBox& box(int i) const { return boxes_[i]; }
    float logOdds(int i) const { return payloads_[i].log_odds; }
    Reflectivity reflectivity(int i) const { return reflectivities_ ? reflectivities_[i] : Reflectivity(); }

   private:
    friend class RTree;
    union Payload {
      float log_odds;       // of a leaf's entry
      std::uint32_t child;  // of an inner node's entry: node id | kOccupiedBit
    };
    int size_;
    const VoxelBox* boxes_;
    const Payload* payloads_;
    const Reflectivity* reflectivities_;
  };

  /// One line for each broken invariant (fill, height, tight boxes, parents, flags, counts); empty if all
  /// hold.
  std::string checkInvariants() const;

 private:
  using NodeId = std::uint32_t;
  static constexpr NodeId kNone = 0x7fffffff;
  static constexpr NodeId kOccupiedBit = 0x80000000;  // in a child reference: some cell below is occupied

  struct Node {
    NodeId parent;
    std::uint16_t count;
    std::uint16_t level;  // 0: leaf
  };
  using Payload = Leaf::Payload;
  // An entry outside of a node, on its way from one to another.
  struct Entry {
    VoxelBox box;
    Payload payload;
    Reflectivity reflectivity;
  };

  // A node is one block of the pool: Node, then M boxes, M payloads and, if stored, M reflectivities.
  Node* node(NodeId id) const {
    return reinterpret_cast<Node*>(chunks_[id >> kChunkBits].get() + (id & (kChunk - 1)) * stride_);
  }
  VoxelBox* boxes(Node* n) const { return reinterpret_cast<VoxelBox*>(n + 1); }
  Payload* payloads(Node* n) const {
    return reinterpret_cast<Payload*>(reinterpret_cast<char*>(n + 1) +
                                      sizeof(VoxelBox) * options_.max_entries);
  }
  Reflectivity* reflectivities(Node* n) const {
    return reinterpret_cast<Reflectivity*>(reinterpret_cast<char*>(n + 1) +
                                           (sizeof(VoxelBox) + sizeof(Payload)) * options_.max_entries);
  }
  static constexpr int kChunkBits = 8;
  static constexpr NodeId kChunk = 1u << kChunkBits;

  Cell cellAt(Node* n, int i) const {
    return {boxes(n)[i], payloads(n)[i].log_odds,
            options_.store_reflectivity ? reflectivities(n)[i] : Reflectivity()};
  }
  bool isOccupied(float log_odds) const { return log_odds >= options_.occupied_log_odds; }

  template <bool kOccupiedOnly, class Enter, class Visit>
  bool visitNode(NodeId id, Enter& enter, Visit& visit) const {
    Node* n = node(id);
    const VoxelBox* box = boxes(n);
    const Payload* payload = payloads(n);
    for (int i = 0; i < n->count; ++i) {
      if (n->level == 0) {
        if (kOccupiedOnly && !isOccupied(payload[i].log_odds)) continue;
        if (enter(box[i]) && !visit(cellAt(n, i))) return false;
      } else {
        if (kOccupiedOnly && !(payload[i].child & kOccupiedBit)) continue;
        if (enter(box[i]) && !visitNode<kOccupiedOnly>(payload[i].child & ~kOccupiedBit, enter, visit))
          return false;
      }
    }
    return true;
  }

  template <class Visit>
  void visitLeavesBelow(NodeId id, const VoxelBox& query, Visit& visit) const {
    Node* n = node(id);
    if (n->level == 0) {
      Leaf leaf;
      leaf.size_ = n->count;
      leaf.boxes_ = boxes(n);
      leaf.payloads_ = payloads(n);
      leaf.reflectivities_ = options_.store_reflectivity ? reflectivities(n) : nullptr;
      visit(leaf);
      return;
    }
    for (int i = 0; i < n->count; ++i) {
      if (query.overlaps(boxes(n)[i])) visitLeavesBelow(payloads(n)[i].child & ~kOccupiedBit, query, visit);
    }
  }

  NodeId allocateNode(int level);
  void freeNode(NodeId id);
  Entry entryAt(Node* n, int i) const;
  void setEntry(Node* n, int i, const Entry& e);
  void append(NodeId id, const Entry& e);
  void removeEntry(Node* n, int i);
  int slotInParent(NodeId id) const;
  Entry summary(NodeId id) const;  // the entry that the parent should hold for this node
  static Entry cellEntry(const Cell& cell);

  void insertEntry(const Entry& entry, int level);
  void split(NodeId id, const Entry& extra);
  bool updateInParent(NodeId id);
  void refit(NodeId id);  // brings the boxes and flags above up to date, as far as they change
  void refitAll(std::vector<NodeId>& nodes);  // the same for nodes of one level
  void condense(NodeId id);                   // after a removal: refit, or dissolve what has fallen below d
  void shortenRoot();
  void collectReplaced(NodeId id, const VoxelBox& region);
  void fillLeaf(NodeId id, const Cell* cells, std::size_t count);
  void pack(const Cell* cells, std::size_t count);
  void rebuild(const std::vector<Cell>& cells);

  RTreeOptions options_;
  Split split_ = nullptr;
  std::size_t stride_ = 0;
  std::vector<std::unique_ptr<char[]>> chunks_;
  std::vector<NodeId> free_;
  NodeId next_ = 0;
  NodeId root_ = kNone;
  std::size_t num_cells_ = 0;
  std::size_t num_nodes_ = 0;
  // Buffers of replace(), kept to save allocations.
  std::vector<NodeId> leaves_;
  std::vector<Cell> rest_;
  std::vector<NodeId> refilled_;
};

}  // namespace rtree_occupancy_map

#include "rtree_occupancy_map/rtree_best_first.h"  // visitByDistance, visitAlong
