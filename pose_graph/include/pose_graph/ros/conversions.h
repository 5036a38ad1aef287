// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <geometry_msgs/Pose.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <nav_msgs/Path.h>
#include <pose_graph/Event.h>
#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include <string>

#include "pose_graph/online_graph.h"
#include "pose_graph/session.h"

namespace pose_graph {

std::int64_t toNanoseconds(const ros::Time& stamp);
ros::Time toTime(std::int64_t nanoseconds);

/// @throws std::invalid_argument if it isn't finite, or its quaternion isn't of length 1
Pose toPose(const geometry_msgs::Pose& pose);
Pose toPose(const Eigen::Isometry3d& transform);
geometry_msgs::Pose toMessage(const Pose& pose);

/// In the frame that the message's transform is in. Of one without a transform, just stamps and type.
/// @throws std::invalid_argument that says what is malformed
Measurement toMeasurement(const mapping_msgs::EdgeConstraint& edge, const std::string& source);

Event toMessage(const GraphEvent& event, const std::string& frame);

/// Of all nodes, in the order of their stamps.
nav_msgs::Path toPath(const Graph& graph, const std_msgs::Header& header);

/// Lines, a marker for each kind and state of edges, by namespaces: consecutive, loop_closure, place,
/// by_hand, pending, revoked.
visualization_msgs::MarkerArray toMarkers(const OnlineGraph& graph, const std_msgs::Header& header);

/// Summary and values of diagnostics.
void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, const OnlineGraph& graph);
void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, const SessionWriter::Status& session);

}  // namespace pose_graph
