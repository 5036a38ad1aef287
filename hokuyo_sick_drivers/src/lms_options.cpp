// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <stdexcept>
#include <string>

#include "hokuyo_sick_drivers/lms2xx.h"

namespace hokuyo_sick_drivers {
namespace {

using lms::Variant;

void checkIndices(const LmsOptions& options) {
  const int values = options.variant.value_or(Variant()).values();
  const int last = options.last_index == 0 ? values : options.last_index;
  if (options.first_index < 1 || last < options.first_index || last > values) {
    throw std::invalid_argument("values " + std::to_string(options.first_index) + " to " +
                                std::to_string(last) + " are asked for, there are 1 to " +
                                std::to_string(values));
  }
  const int most = options.real_time_index == false ? 199 : 198, count = last - options.first_index + 1;
  if (count > most) {
    throw std::invalid_argument(std::to_string(count) + " values with intensities don't fit in a telegram, " +
                                std::to_string(most) +
                                " do: take a resolution of 1 degree, or a part of them by first_index and "
                                "last_index");
  }
}

}  // namespace

void LmsOptions::check() const {
  const bool intensities = intensity != Intensity::kNone;
  const bool known_rate = std::any_of(lms::kBaudRates.begin(), lms::kBaudRates.end(),
                                      [this](const auto& rate) { return rate.first == baud_rate; });
  if (!known_rate) {
    throw std::invalid_argument("an LMS 2xx doesn't know " + std::to_string(baud_rate) +
                                " baud, but 9600, 19200, 38400 and 500000");
  }
  if (variant && !variant->valid()) {
    throw std::invalid_argument(
        "the angle and resolution are none that an LMS 2xx knows: 180 or 100 degrees by 1, 0.5 or 0.25");
  }
  if (interlaced && (!variant || variant->angle != 180)) {
    throw std::invalid_argument("partial scans (interlaced) need an angle of 180 and a resolution");
  }
  if (interlaced && intensities) {
    throw std::invalid_argument("partial scans (interlaced) come without intensities");
  }
  if (!interlaced && variant && *variant == Variant{180, 25}) {
    throw std::invalid_argument("180 degrees by 0.25 come as partial scans only (interlaced)");
  }
  if (intensities) {
    checkIndices(*this);
  } else if (first_index != 1 || last_index != 0) {
    throw std::invalid_argument("first_index and last_index need intensities");
  }
  if (intensities && measuring_mode) {
    throw std::invalid_argument("intensities have a measuring mode of their own, leave measuring_mode open");
  }
  if (measuring_mode && !lms::RangeWord::ofMode(*measuring_mode)) {
    throw std::invalid_argument("measuring mode " + std::to_string(*measuring_mode) +
                                " has no ranges, 0 to 6 and 15 have");
  }
  if (sensitivity && (*sensitivity < 0 || *sensitivity > 3)) {
    throw std::invalid_argument("the sensitivity is " + std::to_string(*sensitivity) + ", allowed is 0 to 3");
  }
}

}  // namespace hokuyo_sick_drivers
