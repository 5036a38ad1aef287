// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace laser_intensity_calib {

/// @throws std::invalid_argument that names the option, its value and what is allowed
template <class T>
void checkWithin(const std::string& name, const T& value, const T& min, const T& max) {
  if (value >= min && value <= max) return;
  std::ostringstream text;
  text << name << " is " << value << ", allowed is " << min << " to " << max;
  throw std::invalid_argument(text.str());
}

}  // namespace laser_intensity_calib
