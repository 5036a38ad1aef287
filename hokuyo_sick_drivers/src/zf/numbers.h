// SPDX-License-Identifier: BSD-3-Clause
//
// Numbers from text, whatever the locale.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace hokuyo_sick_drivers {

/// The value that strtod finds in the C locale; "nan" and "inf" are numbers, hexadecimal ones are not.
/// @return where the number ends, nullptr if there is none at `text`
const char* parseNumber(const char* text, const char* end, double& value);

/// Whether a character parts two numbers of a line.
inline bool isSeparator(char c) {
  return c == ' ' || c == '\t' || c == ',' || c == ';';
}

/// The numbers of a line, parted by blanks, tabs, commas or semicolons.
/// @return how many there are, no more than `max`; kNotNumbers where one of these fields is none
constexpr std::size_t kNotNumbers = ~std::size_t{0};
std::size_t parseNumbers(std::string_view line, double* values, std::size_t max);

/// A number that has to be all of the text, but for blanks around it.
bool parseWhole(std::string_view text, double& value);
bool parseWhole(std::string_view text, std::int64_t& value);

}  // namespace hokuyo_sick_drivers
