// SPDX-License-Identifier: BSD-3-Clause
//
// What the readers of scan files share: bytes, lines of text, folders. Errors are std::runtime_error naming
// the file.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace rosbag_tests {

/// Throws std::runtime_error "where: what".
[[noreturn]] void fail(const std::string& where, const std::string& what);

/// The bytes of a file, unpacked if its name ends in .xz or .gz.
std::string readFileBytes(const std::string& path);

/// The files of a folder whose whole name matches a regular expression, each with what the first group
/// matched; in natural order: 2 before 10.
std::vector<std::pair<std::string, std::filesystem::path>> matchingFiles(const std::string& folder,
                                                                         const char* pattern);

/// The numbers of a line, separated by blanks; false if it holds anything else.
bool parseNumbers(const std::string& line, std::vector<double>& numbers);

/// Calls `use(line, where)` for each line of a text without its # comment, `where` being "path:line number".
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

}  // namespace rosbag_tests
