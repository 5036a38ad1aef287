// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace mapping_common {

/// The path of a recording that isn't part of the repository, empty if it isn't there. The folder of
/// recordings is the environment variable TEST_DATA_DIR or else DEFAULT_TEST_DATA_DIR.
inline std::string findRecording(const std::string& name) {
  const char* variable = std::getenv("TEST_DATA_DIR");
  const std::string path = std::string(variable ? variable : DEFAULT_TEST_DATA_DIR) + "/" + name;
  return std::filesystem::exists(path) ? path : "";
}

/// Why a test that needs it is skipped.
inline std::string withoutRecording(const std::string& name) {
  return "no recording " + name + ": it is neither in TEST_DATA_DIR nor in " + DEFAULT_TEST_DATA_DIR;
}

}  // namespace mapping_common
