// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/images.h"

#include <sensor_msgs/image_encodings.h>

#include <cstdint>
#include <stdexcept>
#include <string>

namespace mapping_common {

void requireWhole(const sensor_msgs::Image& message) {
  namespace encodings = sensor_msgs::image_encodings;
  const auto size = std::to_string(message.width) + " x " + std::to_string(message.height);
  if (message.width == 0 || message.height == 0)
    throw std::invalid_argument("the image is empty (" + size + ")");
  const std::uint64_t step = message.step, row = std::uint64_t{message.width} *
                                                 encodings::numChannels(message.encoding) *
                                                 (encodings::bitDepth(message.encoding) / 8);
  if (step < row)
    throw std::invalid_argument("the image of " + size + " has rows of only " + std::to_string(step) +
                                " bytes");
  if (message.data.size() / step < message.height)
    throw std::invalid_argument("the image of " + size + " has only " + std::to_string(message.data.size()) +
                                " bytes");
}

}  // namespace mapping_common
