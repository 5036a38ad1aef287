// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "pose_graph/session.h"

namespace pose_graph {

struct SessionMerge {
  std::size_t key_poses = 0;
  std::size_t place_edges = 0;           ///< between sessions
  std::size_t revoked = 0;               ///< of these: they don't agree with most
  std::vector<std::string> unconnected;  ///< sessions that none connects with the first
};

/// Writes one session with all that several have. Those that PLACE edges connect with the first are moved, as
/// a whole, to where most of these edges agree; the rest are revoked, until a loop check says better. The
/// others stay in frames of their own. PLACE edges to poses of another file (ForeignEdge) become edges where
/// that is among them.
/// @param paths with one, it is copied
/// @param out whole at the end or not there; one that there is is replaced
/// @param progress gets the share that is done, 0 to 1; false ends the work
/// @return none where it was ended
/// @throws std::runtime_error that names the file; std::invalid_argument where planar and spatial ones are
/// mixed
std::optional<SessionMerge> mergeSessions(const std::vector<std::string>& paths, const std::string& out,
                                          const std::function<bool(double share)>& progress = {});

}  // namespace pose_graph
