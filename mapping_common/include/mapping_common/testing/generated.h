// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>
#include <mapping_common/files.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>

namespace mapping_common {

/// A file of the repository that the code generates: says where it differs, or, with MAPPING_REGENERATE set
/// in the environment (scripts/parameters does), writes it.
inline void expectGenerated(const std::string& path, const std::string& text) {
  if (std::getenv("MAPPING_REGENERATE") != nullptr) {
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    return writeFile(path, [&text](std::ostream& out) { out << text; });
  }
  const std::string file = std::filesystem::exists(path) ? readFile(path) : "";
  if (file == text) return;
  std::istringstream is(file), should(text);
  std::string a, b;
  int line = 0;
  do {
    ++line;
    if (!std::getline(is, a)) a = "(its end)";
    if (!std::getline(should, b)) b = "(its end)";
  } while (a == b);
  ADD_FAILURE() << path << " isn't what the code generates, scripts/parameters writes it. Line " << line
                << " is\n  " << a << "\nand should be\n  " << b;
}

}  // namespace mapping_common
