// SPDX-License-Identifier: BSD-3-Clause
//
// Graphs in the text format of g2o: VERTEX_SE2, EDGE_SE2, VERTEX_SE3:QUAT, EDGE_SE3:QUAT and FIX. Those of
// TORO (VERTEX2, EDGE2) are read, too.
#pragma once

#include <string>

#include "pose_graph/graph.h"

namespace pose_graph {

struct G2oFile {
  Graph graph;
  bool has_poses = false;  ///< false: there were edges alone, and all poses are the identity
};

/// Edges between nodes whose ids follow one another are consecutive, all others loop closures. An edge's line
/// may come before those of its nodes.
/// @throws std::runtime_error that names file and line
G2oFile readG2o(const std::string& path);
/// The same from memory.
/// @param path for messages
G2oFile parseG2o(const std::string& text, const std::string& path);

/// Active edges alone. The numbers are those in memory, to the last bit but for angles of planar graphs.
/// @throws std::runtime_error that names the file
void writeG2o(const std::string& path, const Graph& graph);

}  // namespace pose_graph
