// SPDX-License-Identifier: BSD-3-Clause
//
// For tests of tools: runs them as a shell does, and keeps what they say.
#pragma once

#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>
#include <sys/wait.h>

#include <cstdlib>
#include <string>
#include <utility>

namespace mapping_common {

struct Ran {
  int code = -1;  ///< -1: it was killed, or crashed
  std::string out, err;
  std::string said() const { return out + err; }
};

/// Runs a command of the shell to its end.
inline Ran run(const std::string& command) {
  const TempDir dir;
  const std::string out = dir.path("out"), err = dir.path("err");
  const int status = std::system(("{ " + command + "\n} >" + out + " 2>" + err).c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, readFile(out), readFile(err)};
}

/// A tool, and a folder for its files.
class ToolTest : public ::testing::Test {
 protected:
  explicit ToolTest(std::string tool) : tool_(std::move(tool)) {}

  /// @return the exit code; what was said is in output()
  int run(const std::string& arguments) {
    ran_ = mapping_common::run(tool_ + ' ' + arguments);
    return ran_.code;
  }
  /// The same on a terminal.
  int runOnTerminal(const std::string& arguments) {
    ran_ = mapping_common::run("script --quiet --return --command '" + tool_ + ' ' + arguments +
                               "' /dev/null </dev/null");
    return ran_.code;
  }
  std::string output() const { return ran_.said(); }
  /// Runs it, which has to end with this code. @return what was said
  std::string outputOf(const std::string& arguments, int code = 0) {
    EXPECT_EQ(code, run(arguments)) << arguments << '\n' << output();
    return output();
  }

  const TempDir dir_;
  Ran ran_;  ///< the last one

 private:
  const std::string tool_;
};

}  // namespace mapping_common
