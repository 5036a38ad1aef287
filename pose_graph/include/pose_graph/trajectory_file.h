// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "pose_graph/graph.h"

namespace pose_graph {

/// Writes the poses in TUM's format, a line for each: stamp (s) x y z (m) qx qy qz qw, in the order of the
/// nodes. Where the stamp isn't known, the id stands in its place.
/// @throws std::runtime_error that names the file
void writeTum(const std::string& path, const Graph& graph);

}  // namespace pose_graph
