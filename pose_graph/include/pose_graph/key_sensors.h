// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <set>
#include <vector>

#include "pose_graph/online_graph.h"
#include "pose_graph/session.h"

namespace pose_graph {

/// Picks for each key pose what was measured there: of each kind what comes first with it or after it. Scans,
/// which front ends make key poses of, wait for one with their own stamp.
class KeySensors {
 public:
  /// ns: whether a scan has the stamp of a key pose is known within `hold`; what can't be attached to one
  /// within `wait` is forgotten, both by later stamps of the kind.
  explicit KeySensors(std::int64_t hold = 2'000'000'000, std::int64_t wait = 10'000'000'000)
      : hold_(hold), wait_(wait) {}

  using Encode = std::function<KeyData(const Trajectory& front_end)>;
  /// @param until to when it took, on from the stamp: nothing is picked before the front end's poses are
  /// there
  /// @param encode gives the data, in the frame of the body at the stamp; is called where they are picked,
  /// and throws nothing
  void add(DataKind kind, std::int64_t stamp, std::int64_t until, Encode encode);
  /// What has been picked since, with key pose, stamp and `sensor`.
  std::vector<KeyData> take(const OnlineGraph& graph);
  bool has(DataKind kind, std::size_t node) const { return nodes_.count({kind, node}) > 0; }
  /// Up to this node all is there, as in a session that goes on.
  void skip(std::size_t nodes);
  void clear() { waiting_.clear(); }

 private:
  struct Item {
    std::int64_t stamp, until;
    Encode encode;
  };
  std::int64_t hold_, wait_;
  std::map<DataKind, std::deque<Item>> waiting_;
  std::set<std::pair<DataKind, std::size_t>> nodes_;  // that have some
};

}  // namespace pose_graph
