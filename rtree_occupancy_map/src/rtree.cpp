// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/rtree.h"

#include <algorithm>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <tuple>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace rtree_occupancy_map {
namespace {

constexpr std::size_t kCacheLine = 64;  // bytes

// Spreads the low 16 bits of v so that two zero bits follow each.
std::uint64_t spread(std::uint64_t v) {
  v = (v | (v << 16)) & 0x0000ff0000ffULL;
  v = (v | (v << 8)) & 0x00f00f00f00fULL;
  v = (v | (v << 4)) & 0x0c30c30c30c3ULL;
  return (v | (v << 2)) & 0x249249249249ULL;
}

// Place of a box's centre along a Z-order curve.
std::uint64_t zOrder(const VoxelBox& b) {
  const auto coordinate = [&b](int axis) {
    return spread(static_cast<std::uint16_t>((b.min[axis] + b.max[axis]) / 2 + 32768));
  };
  return coordinate(0) | coordinate(1) << 1 | coordinate(2) << 2;
}

// Four bytes behind the last box have to be readable.
VoxelBox uniteAll(const VoxelBox* box, int count) {
  VoxelBox all = VoxelBox::empty();
#ifdef __SSE2__
  if (count == 0) return all;
  const auto load = [&](int i) { return _mm_loadu_si128(reinterpret_cast<const __m128i*>(box + i)); };
  __m128i min = load(0), max = min;
  for (int i = 1; i < count; ++i) {
    min = _mm_min_epi16(min, load(i));
    max = _mm_max_epi16(max, load(i));
  }
  alignas(16) std::int16_t least[8], greatest[8];
  _mm_store_si128(reinterpret_cast<__m128i*>(least), min);
  _mm_store_si128(reinterpret_cast<__m128i*>(greatest), max);
  std::copy_n(least, 3, all.min.begin());
  std::copy_n(greatest + 3, 3, all.max.begin());
#else
  for (int i = 0; i < count; ++i) all = unite(all, box[i]);
#endif
  return all;
}

// Entry i of n that are shared out evenly among `nodes` nodes begins here.
std::size_t share(std::size_t n, std::size_t nodes, std::size_t i) {
  return n * i / nodes;
}

}  // namespace

RTree::RTree(const RTreeOptions& options)
    : options_(mapping_common::validate(options)), split_(mapping_common::valueOf(splits(), options.split)) {
  const std::size_t entry =
      sizeof(VoxelBox) + sizeof(Payload) + (options_.store_reflectivity ? sizeof(Reflectivity) : 0);
  stride_ = sizeof(Node) + entry * options_.max_entries;
  root_ = allocateNode(0);
}

RTree::RTree(RTree&&) noexcept = default;
RTree& RTree::operator=(RTree&&) noexcept = default;
RTree::~RTree() = default;

// ---- nodes and entries --------------------------------------------------------------------------

RTree::NodeId RTree::allocateNode(int level) {
  NodeId id;
  if (!free_.empty()) {
    id = free_.back();
    free_.pop_back();
  } else {
    if (next_ == kNone) throw std::length_error("R-tree: out of node numbers");
    if (next_ % kChunk == 0) chunks_.emplace_back(new char[kChunk * stride_]);
    id = next_++;
  }
  *node(id) = {kNone, 0, static_cast<std::uint16_t>(level)};
  ++num_nodes_;
  return id;
}

void RTree::freeNode(NodeId id) {
  free_.push_back(id);
  --num_nodes_;
}

RTree::Entry RTree::cellEntry(const Cell& cell) {
  Entry e;
  e.box = cell.box;
  e.payload.log_odds = cell.log_odds;
  e.reflectivity = cell.reflectivity;
  return e;
}

RTree::Entry RTree::entryAt(Node* n, int i) const {
  return {boxes(n)[i], payloads(n)[i],
          n->level == 0 && options_.store_reflectivity ? reflectivities(n)[i] : Reflectivity()};
}

void RTree::setEntry(Node* n, int i, const Entry& e) {
  boxes(n)[i] = e.box;
  payloads(n)[i] = e.payload;
  if (n->level == 0 && options_.store_reflectivity) reflectivities(n)[i] = e.reflectivity;
}

void RTree::removeEntry(Node* n, int i) {
  setEntry(n, i, entryAt(n, --n->count));
}

void RTree::append(NodeId id, const Entry& e) {
  Node* n = node(id);
  setEntry(n, n->count++, e);
  if (n->level > 0) node(e.payload.child & ~kOccupiedBit)->parent = id;
}

int RTree::slotInParent(NodeId id) const {
  const Payload* p = payloads(node(node(id)->parent));
  int i = 0;
  while ((p[i].child & ~kOccupiedBit) != id) ++i;
  return i;
}

RTree::Entry RTree::summary(NodeId id) const {
  Node* n = node(id);
  const VoxelBox* box = boxes(n);
  const Payload* payload = payloads(n);
  Entry e;
  e.box = uniteAll(box, n->count);
  bool occupied = false;
  for (int i = 0; i < n->count; ++i) {
    occupied |= n->level == 0 ? isOccupied(payload[i].log_odds) : (payload[i].child & kOccupiedBit) != 0;
  }
  e.payload.child = id | (occupied ? kOccupiedBit : 0);
  return e;
}

// @return whether that changes the parent's entry
bool RTree::updateInParent(NodeId id) {
  Node* p = node(node(id)->parent);
  const int slot = slotInParent(id);
  const Entry now = summary(id);
  if (boxes(p)[slot] == now.box && payloads(p)[slot].child == now.payload.child) return false;
  setEntry(p, slot, now);
  return true;
}

void RTree::refit(NodeId id) {
  while (id != root_ && updateInParent(id)) id = node(id)->parent;
}

void RTree::refitAll(std::vector<NodeId>& nodes) {
  while (!nodes.empty()) {
    std::size_t parents = 0;
    for (const NodeId id : nodes) {
      if (id == root_) continue;
      const NodeId parent = node(id)->parent;
      if (updateInParent(id) && (parents == 0 || nodes[parents - 1] != parent)) nodes[parents++] = parent;
    }
    nodes.resize(parents);
  }
}

VoxelBox RTree::bounds() const {
  return summary(root_).box;
}

std::size_t RTree::memoryUsage() const {
  return sizeof(*this) + chunks_.size() * (kChunk * stride_ + sizeof(chunks_[0])) +
         free_.capacity() * sizeof(NodeId);
}

void RTree::shrink() {
  if (free_.size() <= num_nodes_ + kChunk) return;
  std::vector<Cell> cells;
  cells.reserve(num_cells_);
  visitAll([&cells](const Cell& cell) {
    cells.push_back(cell);
    return true;
  });
  rebuild(cells);
}

void RTree::clear() {
  chunks_.clear();
  free_.clear();
  next_ = 0;
  num_cells_ = num_nodes_ = 0;
  root_ = allocateNode(0);
}

// ---- insertion and deletion ---------------------------------------------------------------------

void RTree::insert(const Cell& cell) {
  insertEntry(cellEntry(cell), 0);
  ++num_cells_;
}

void RTree::insertEntry(const Entry& entry, int level) {
  NodeId id = root_;
  for (Node* n = node(id); n->level > level; n = node(id)) {
    const VoxelBox* box = boxes(n);
    int best = 0;
    auto least = std::make_tuple(std::numeric_limits<std::int64_t>::max(), std::int64_t{0});
    for (int i = 0; i < n->count; ++i) {
      const std::int64_t volume = box[i].volume();
      const auto cost = std::make_tuple(unite(box[i], entry.box).volume() - volume, volume);
      if (cost < least) {
        least = cost;
        best = i;
      }
    }
    id = payloads(n)[best].child & ~kOccupiedBit;
  }
  Node* n = node(id);
  if (n->count == options_.max_entries) {
    split(id, entry);
    return;
  }
  append(id, entry);
  refit(id);
}

void RTree::split(NodeId id, const Entry& extra) {
  std::vector<Entry> entries;
  std::vector<VoxelBox> entry_boxes;
  Node* n = node(id);
  for (int i = 0; i < n->count; ++i) entries.push_back(entryAt(n, i));
  entries.push_back(extra);
  for (const Entry& e : entries) entry_boxes.push_back(e.box);
  const std::vector<std::uint8_t> group = split_(entry_boxes, options_.min_entries);

  const NodeId sibling = allocateNode(n->level);
  const NodeId ids[2] = {id, sibling};
  n->count = 0;
  for (std::size_t k = 0; k < entries.size(); ++k) append(ids[group[k]], entries[k]);

  if (id == root_) {
    root_ = allocateNode(n->level + 1);
    for (const NodeId child : ids) append(root_, summary(child));
    return;
  }
  refit(id);
  const NodeId parent = n->parent;
  Node* p = node(parent);
  if (p->count == options_.max_entries) {
    split(parent, summary(sibling));
  } else {
    append(parent, summary(sibling));
    refit(parent);
  }
}

bool RTree::erase(const VoxelBox& box) {
  struct Search {
    const RTree& tree;
    const VoxelBox& box;
    NodeId leaf = kNone;
    int slot = 0;
    bool operator()(NodeId id) {
      Node* n = tree.node(id);
      for (int i = 0; i < n->count; ++i) {
        const VoxelBox& b = tree.boxes(n)[i];
        if (n->level > 0 && b.contains(box) && (*this)(tree.payloads(n)[i].child & ~kOccupiedBit))
          return true;
        if (n->level == 0 && b == box) {
          leaf = id;
          slot = i;
          return true;
        }
      }
      return false;
    }
  } search{*this, box};
  if (!search(root_)) return false;
  removeEntry(node(search.leaf), search.slot);
  --num_cells_;
  condense(search.leaf);
  return true;
}

// Guttman's CondenseTree.
void RTree::condense(NodeId id) {
  std::vector<std::pair<Entry, int>> orphans;  // with the level of the node that they need
  while (id != root_) {
    Node* n = node(id);
    if (n->count >= options_.min_entries) {
      refit(id);
      break;
    }
    const NodeId parent = n->parent;
    for (int i = 0; i < n->count; ++i) orphans.emplace_back(entryAt(n, i), n->level);
    removeEntry(node(parent), slotInParent(id));
    freeNode(id);
    id = parent;
  }
  for (auto o = orphans.rbegin(); o != orphans.rend(); ++o) insertEntry(o->first, o->second);
  shortenRoot();
}

void RTree::shortenRoot() {
  while (node(root_)->level > 0 && node(root_)->count == 1) {
    const NodeId child = payloads(node(root_))[0].child & ~kOccupiedBit;
    freeNode(root_);
    root_ = child;
    node(root_)->parent = kNone;
  }
}

// ---- many at a time -----------------------------------------------------------------------------

void RTree::replace(const VoxelBox& region, const std::vector<Cell>& cells) {
  leaves_.clear();
  rest_.clear();
  collectReplaced(root_, region);
  num_cells_ += cells.size();

  const auto d = static_cast<std::size_t>(options_.min_entries),
             M = static_cast<std::size_t>(options_.max_entries);
  const bool root_is_leaf = node(root_)->level == 0;
  if (!root_is_leaf && cells.size() >= d && rest_.size() >= d) {
    pack(cells.data(), cells.size());
  } else {
    rest_.insert(rest_.begin(), cells.begin(), cells.end());
  }
  if (root_is_leaf && rest_.size() > M) {
    rebuild(rest_);
    return;
  }
  const bool fills_leaves = rest_.size() >= d || root_is_leaf;
  if (fills_leaves) pack(rest_.data(), rest_.size());
  for (const NodeId leaf : leaves_) {  // no longer needed
    node(leaf)->count = 0;
    condense(leaf);
  }
  if (fills_leaves) return;
  for (const Cell& cell : rest_) insertEntry(cellEntry(cell), 0);
}

// Leaves that hold a cell of the region go to leaves_, their other cells to rest_.
void RTree::collectReplaced(NodeId id, const VoxelBox& region) {
  Node* n = node(id);
  const VoxelBox* box = boxes(n);
  if (n->level > 0) {
    const auto child = [&](int i) { return payloads(n)[i].child & ~kOccupiedBit; };
    for (int i = 0; i < n->count; ++i) {
      if (!region.overlaps(box[i])) continue;
      // The leaves lie scattered in memory.
      const char* next = reinterpret_cast<const char*>(node(child(i)));
      for (std::size_t k = 0; k < stride_; k += kCacheLine) __builtin_prefetch(next + k);
    }
    for (int i = 0; i < n->count; ++i) {
      if (region.overlaps(box[i])) collectReplaced(child(i), region);
    }
    return;
  }
  const auto replaced =
      std::count_if(box, box + n->count, [&region](const VoxelBox& b) { return region.contains(b); });
  if (replaced == 0 && id != root_) return;
  leaves_.push_back(id);
  num_cells_ -= replaced;
  if (replaced == n->count) return;
  for (int i = 0; i < n->count; ++i) {
    if (!region.contains(box[i])) rest_.push_back(cellAt(n, i));
  }
}

void RTree::fillLeaf(NodeId id, const Cell* cells, std::size_t count) {
  Node* n = node(id);
  n->count = static_cast<std::uint16_t>(count);
  for (std::size_t i = 0; i < count; ++i) {
    boxes(n)[i] = cells[i].box;
    payloads(n)[i].log_odds = cells[i].log_odds;
    if (options_.store_reflectivity) reflectivities(n)[i] = cells[i].reflectivity;
  }
}

// Shares the cells out evenly among as few leaves as hold them: first those of leaves_, then new ones.
void RTree::pack(const Cell* cells, std::size_t count) {
  const std::size_t nodes = (count + options_.max_entries - 1) / options_.max_entries;
  const auto fill = [&](NodeId id, std::size_t k) {
    fillLeaf(id, cells + share(count, nodes, k), share(count, nodes, k + 1) - share(count, nodes, k));
  };
  std::size_t k = 0;
  refilled_.clear();
  for (; k < nodes && !leaves_.empty(); ++k) {
    refilled_.push_back(leaves_.back());
    leaves_.pop_back();
    fill(refilled_.back(), k);
  }
  refitAll(refilled_);
  for (; k < nodes; ++k) {
    const NodeId id = allocateNode(0);
    fill(id, k);
    insertEntry(summary(id), 1);
  }
}

void RTree::bulkLoad(std::vector<Cell> cells) {
  std::sort(cells.begin(), cells.end(),
            [](const Cell& a, const Cell& b) { return zOrder(a.box) < zOrder(b.box); });
  num_cells_ = cells.size();
  rebuild(cells);
}

// Packs the cells, bottom up. num_cells_ is up to date already.
void RTree::rebuild(const std::vector<Cell>& cells) {
  const std::size_t num_cells = num_cells_;
  clear();
  num_cells_ = num_cells;
  std::vector<Entry> entries;
  entries.reserve(cells.size());
  for (const Cell& cell : cells) entries.push_back(cellEntry(cell));
  if (entries.empty()) return;
  for (int level = 0; level == 0 || entries.size() > 1; ++level) {
    const std::size_t nodes = (entries.size() + options_.max_entries - 1) / options_.max_entries;
    std::vector<Entry> parents;
    for (std::size_t k = 0; k < nodes; ++k) {
      const NodeId id = level == 0 && k == 0 ? root_ : allocateNode(level);
      for (std::size_t i = share(entries.size(), nodes, k); i < share(entries.size(), nodes, k + 1); ++i) {
        append(id, entries[i]);
      }
      parents.push_back(summary(id));
    }
    entries = std::move(parents);
    root_ = entries.back().payload.child & ~kOccupiedBit;
  }
  node(root_)->parent = kNone;
}

// ---- invariants ---------------------------------------------------------------------------------

std::string RTree::checkInvariants() const {
  std::ostringstream broken;
  std::size_t cells = 0, nodes = 0;
  struct Check {
    const RTree& tree;
    std::ostringstream& broken;
    std::size_t &cells, &nodes;
    void operator()(NodeId id, NodeId parent, int level) {
      Node* n = tree.node(id);
      ++nodes;
      const int least = id != tree.root_ ? tree.options_.min_entries : level > 0 ? 2 : 0;
      if (n->level != level)
        broken << "node " << id << " has level " << n->level << ", not " << level << "\n";
      if (n->parent != parent)
        broken << "node " << id << " has parent " << n->parent << ", not " << parent << "\n";
      if (n->count < least || n->count > tree.options_.max_entries) {
        broken << "node " << id << " holds " << n->count << " entries, allowed is " << least << " to M\n";
      }
      if (level == 0) {
        cells += n->count;
        return;
      }
      for (int i = 0; i < n->count; ++i) {
        const NodeId child = tree.payloads(n)[i].child & ~kOccupiedBit;
        const Entry expected = tree.summary(child);
        if (tree.boxes(n)[i] != expected.box) broken << "the box of node " << child << " is not tight\n";
        if (tree.payloads(n)[i].child != expected.payload.child)
          broken << "the flag of node " << child << " is wrong\n";
        (*this)(child, id, level - 1);
      }
    }
  };
  Check{*this, broken, cells, nodes}(root_, kNone, node(root_)->level);
  if (cells != num_cells_) broken << cells << " cells found, " << num_cells_ << " counted\n";
  if (nodes != num_nodes_) broken << nodes << " nodes found, " << num_nodes_ << " counted\n";
  return broken.str();
}

}  // namespace rtree_occupancy_map
