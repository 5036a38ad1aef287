// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <ostream>
#include <string>

namespace mapping_common {

/// Writes a file that is whole or isn't there: under a temporary name in the same folder, flushed to the
/// disk, renamed at the end. Where anything fails, an older file of that name stays as it was.
/// @throws std::runtime_error that names the file; whatever `write` throws
void writeFile(const std::string& path, const std::function<void(std::ostream&)>& write);

/// @throws std::runtime_error that names the file
std::string readFile(const std::string& path);

/// For files in formats of this workspace's own.
/// @throws std::invalid_argument if the path ends as files of other programs do, which couldn't read it
void requireOwnEnding(const std::string& path);

}  // namespace mapping_common
