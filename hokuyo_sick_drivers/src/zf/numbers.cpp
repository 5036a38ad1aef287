// SPDX-License-Identifier: BSD-3-Clause
#include "numbers.h"

#include <charconv>
#include <limits>
#include <string>
#ifndef __cpp_lib_to_chars  // no std::from_chars for double: GCC 9, 10
#include <clocale>
#include <cstdlib>
#endif

namespace hokuyo_sick_drivers {
namespace {

// Powers of ten that a double holds exactly.
constexpr double kTens[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                            1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
constexpr int kMaxTen = 22;

bool isDigit(char c) {
  return static_cast<unsigned char>(c - '0') < 10;
}

#ifdef __cpp_lib_to_chars
const char* parseAny(const char* text, const char* end, double& value) {
  const auto [stop, error] = std::from_chars(text, end, value);
  if (error == std::errc::invalid_argument) return nullptr;
  if (error == std::errc::result_out_of_range) {  // a tiny one or a huge one
    const std::string_view number(text, static_cast<std::size_t>(stop - text));
    const std::size_t exponent = number.find_first_of("eE");
    const bool tiny = exponent != number.npos ? number[exponent + 1] == '-' : number.find('.') != number.npos;
    value = tiny ? 0.0 : std::numeric_limits<double>::infinity();
    if (number[0] == '-') value = -value;
  }
  return stop;
}
#else
const char* parseAny(const char* text, const char* end, double& value) {
  static const locale_t c_locale = newlocale(LC_ALL_MASK, "C", nullptr);
  const char* stop = text;
  while (stop != end &&
         (isDigit(*stop) || std::string_view("+-.eEnaiftyNAIFTY").find(*stop) != std::string_view::npos)) {
    ++stop;
  }
  const std::string number(text, stop);
  char* number_end = nullptr;
  value = strtod_l(number.c_str(), &number_end, c_locale);
  return number_end == number.c_str() ? nullptr : text + (number_end - number.c_str());
}
#endif

std::string_view trim(std::string_view text) {
  constexpr const char* kBlanks = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

}  // namespace

// As in W. D. Clinger, How to Read Floating Point Numbers Accurately: where digits and power of ten are
// exact, one division or multiplication rounds right.
const char* parseNumber(const char* text, const char* end, double& value) {
  if (text != end && *text == '+') {
    ++text;
    if (text != end && *text == '-') return nullptr;
  }
  const char* p = text;
  const bool negative = p != end && *p == '-';
  if (negative) ++p;
  std::uint64_t digits = 0;
  const char* first = p;
  while (p != end && isDigit(*p)) digits = 10 * digits + static_cast<std::uint64_t>(*p++ - '0');
  std::ptrdiff_t count = p - first;
  int exponent = 0;
  if (p != end && *p == '.') {
    const char* fraction = ++p;
    while (p != end && isDigit(*p)) digits = 10 * digits + static_cast<std::uint64_t>(*p++ - '0');
    count += p - fraction;
    if (count > 19) return parseAny(text, end, value);
    exponent = static_cast<int>(fraction - p);
  }
  if (count == 0 || count > 19 || digits > (1ULL << 53U) || exponent < -kMaxTen ||
      (p != end && (*p == 'e' || *p == 'E'))) {
    return parseAny(text, end, value);
  }
  value = static_cast<double>(digits);
  if (exponent < 0) value /= kTens[-exponent];
  if (negative) value = -value;
  return p;
}

std::size_t parseNumbers(std::string_view line, double* values, std::size_t max) {
  const char* p = line.data();
  const char* const end = p + line.size();
  std::size_t count = 0;
  while (true) {
    while (p != end && isSeparator(*p)) ++p;
    if (p == end || count == max) return count;
    p = parseNumber(p, end, values[count]);
    if (!p || (p != end && !isSeparator(*p))) return kNotNumbers;
    ++count;
  }
}

bool parseWhole(std::string_view text, double& value) {
  text = trim(text);
  const char* end = text.data() + text.size();
  return !text.empty() && parseNumber(text.data(), end, value) == end;
}

bool parseWhole(std::string_view text, std::int64_t& value) {
  text = trim(text);
  if (!text.empty() && text[0] == '+') text.remove_prefix(1);
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && stop == text.data() + text.size() && !text.empty();
}

}  // namespace hokuyo_sick_drivers
