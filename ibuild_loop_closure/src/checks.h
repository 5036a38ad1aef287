// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <stdexcept>

namespace ibuild_loop_closure {

/// @throws std::invalid_argument that names the option, its value and the allowed range
template <class T>
void checkRange(const char* name, T value, T min, T max) {
  if (value >= min && value <= max) return;
  std::ostringstream text;
  text << name << " is " << value << ", allowed is " << min << " to " << max;
  throw std::invalid_argument(text.str());
}

}  // namespace ibuild_loop_closure
