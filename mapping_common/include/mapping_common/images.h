// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/Image.h>

namespace mapping_common {

/// @throws std::exception if the image is empty, its encoding unknown, or its size and its data don't agree,
///   which cv_bridge doesn't see where their products are beyond 32 bits
void requireWhole(const sensor_msgs::Image& message);

}  // namespace mapping_common
