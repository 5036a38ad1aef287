// SPDX-License-Identifier: BSD-3-Clause
//
// Poses to begin an optimisation with, from the active edges alone.
#pragma once

#include "pose_graph/graph.h"

namespace pose_graph {

/// Chains the consecutive edges, and goes over others only to where there is no other way. Each connected
/// part begins with its fixed nodes, or where its first node is.
void startFromOdometry(Graph& graph);

/// Chordal relaxation (Martinec and Pajdla 2007; Carlone et al., "Initialization Techniques for 3D SLAM",
/// ICRA 2015): the rotations as matrices by linear least squares, each projected onto SO(3); then the
/// translations by linear least squares. Needs no guess, and is good where odometry is too bad to begin with.
/// Fixed nodes stay, and in a connected part without any, its first.
/// @throws std::runtime_error where edges without any information about the rotation leave the poses
/// undetermined
void startFromChords(Graph& graph);

}  // namespace pose_graph
