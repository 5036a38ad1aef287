// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>

namespace hokuyo_sick_drivers {

/// Turns a counter of few bits, which starts anew at 2^bits, into one that doesn't.
class CounterUnwrapper {
 public:
  explicit CounterUnwrapper(int bits) : modulus_(std::int64_t{1} << bits) {}

  /// @param value the counter's latest, at most half of its span before or after the one before
  /// @return the first value as it is, then as many more or less as the counter has gone on or back
  std::int64_t unwrap(std::int64_t value) {
    if (last_) {
      std::int64_t step = (value - *last_) % modulus_;
      if (step < 0) step += modulus_;
      if (step > modulus_ / 2) step -= modulus_;
      value = *last_ + step;
    }
    last_ = value;
    return value;
  }
  void restart() { last_.reset(); }

 private:
  std::int64_t modulus_;
  std::optional<std::int64_t> last_;
};

}  // namespace hokuyo_sick_drivers
