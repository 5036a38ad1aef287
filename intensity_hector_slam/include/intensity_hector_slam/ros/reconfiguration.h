// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <intensity_hector_slam/SlamConfig.h>
#include <intensity_hector_slam/ros/parameters.h>

namespace intensity_hector_slam {

/// What may change while the nodelet runs, as it was started.
SlamConfig startConfig(mapping_common::Parameters& reader, const SlamParameters& parameters);
/// The options with that of a configuration.
/// @throws std::invalid_argument that names the option, its value and what is allowed
SlamOptions reconfigured(SlamOptions options, const SlamConfig& config);

}  // namespace intensity_hector_slam
