// SPDX-License-Identifier: BSD-3-Clause
//
// What the readers of recordings share: bytes, lines of text, folders. Errors are std::runtime_error naming
// the file.
#pragma once

#include <mapping_common/text.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace rosbag_tests {

using mapping_common::forEachLine;
using mapping_common::parseNumbers;

/// Throws std::runtime_error "where: what".
[[noreturn]] void fail(const std::string& where, const std::string& what);

/// The bytes of a file, unpacked if its name ends in .xz or .gz.
std::string readFileBytes(const std::string& path);

/// The files of a folder whose whole name matches a regular expression, each with what the first group
/// matched; in natural order: 2 before 10.
std::vector<std::pair<std::string, std::filesystem::path>> matchingFiles(const std::string& folder,
                                                                         const char* pattern);

}  // namespace rosbag_tests
