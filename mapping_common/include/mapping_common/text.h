// SPDX-License-Identifier: BSD-3-Clause
//
// Text files of numbers, line by line.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

namespace mapping_common {

/// The numbers of a line, separated by blanks.
/// @return false if it holds anything else
bool parseNumbers(const std::string& line, std::vector<double>& numbers);

/// Calls use(line, where) for each line of a text without its # comment, `where` being "path:line number".
template <typename Use>
void forEachLine(const std::string& text, const std::string& path, Use use) {
  std::size_t number = 0;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    const std::string line = text.substr(start, end - start);
    use(line.substr(0, line.find('#')), path + ":" + std::to_string(++number));
    start = end + 1;
  }
}

}  // namespace mapping_common
