// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_simulation/trajectory.h>

#include <string>

namespace rosbag_tests {

/// The poses on a topic of a bag: nav_msgs Odometry, or geometry_msgs PoseStamped, PoseWithCovarianceStamped
/// or TransformStamped, in order of their stamps. Malformed messages and those with the stamp of another are
/// left out. Throws std::runtime_error if the bag can't be read or has no pose there.
mapping_simulation::Trajectory readPoseTopic(const std::string& bag, const std::string& topic);

/// The poses of frame `child` in frame `parent` that /tf and /tf_static of a bag give, at each stamp of /tf
/// at which they do. Throws std::runtime_error if the bag can't be read or connects the two nowhere.
mapping_simulation::Trajectory readTransforms(const std::string& bag, const std::string& parent,
                                              const std::string& child);

}  // namespace rosbag_tests
