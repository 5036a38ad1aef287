// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <stdexcept>
#include <string>

namespace mapping_common {

/// A folder for the files of one test.
class TempDir {
 public:
  TempDir() {
    std::string name = (std::filesystem::temp_directory_path() / "mapping_XXXXXX").string();
    if (!mkdtemp(&name[0])) throw std::runtime_error("can't make " + name);
    path_ = name;
  }
  ~TempDir() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;

  std::string path(const std::string& name = "") const { return (path_ / name).string(); }

  std::string write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path(name), std::ios::binary) << bytes;
    return path(name);
  }

 private:
  std::filesystem::path path_;
};

/// The message of the std::runtime_error that `call` throws, "" if it throws none.
template <typename Call>
std::string errorOf(Call call) {
  try {
    call();
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "";
}

/// Whether a message holds all of the parts.
inline testing::AssertionResult mentions(const std::string& message,
                                         std::initializer_list<const char*> parts) {
  for (const char* part : parts)
    if (message.find(part) == std::string::npos)
      return testing::AssertionFailure() << '"' << part << "\" isn't in \"" << message << '"';
  return testing::AssertionSuccess();
}

}  // namespace mapping_common
