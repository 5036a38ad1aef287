// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <sstream>

#include "mapping_common/progress.h"

namespace {

using mapping_common::Progress;

TEST(Progress, WritesOverALineOfATerminal) {
  std::ostringstream out;
  {
    Progress progress("tool", out, true);
    progress.show(1, " of ", 200);
    for (int i = 2; i < 200; ++i) progress.show(i, " of ", 200);
  }
  const std::string empty = "\r\033[K", text = out.str();
  EXPECT_EQ(0u, text.rfind(empty + "tool: 1 of 200", 0));
  EXPECT_EQ(empty, text.substr(text.size() - empty.size())) << "what comes next begins on an empty line";
  EXPECT_EQ(std::string::npos, text.find("199")) << "it isn't written more often than somebody can read it";
  EXPECT_EQ(std::string::npos, text.find('\n'));
}

TEST(Progress, HasNoLineOfATerminalInALog) {
  std::ostringstream out;
  Progress progress("tool", out, false);
  for (int i = 1; i <= 200; ++i) progress.show(i, " of 200");
  progress.say(200, " scans -> ", "out");
  EXPECT_EQ("tool: 200 scans -> out\n", out.str());
}

TEST(Progress, LastLineStays) {
  std::ostringstream out;
  {
    Progress progress("tool", out, true);
    progress.say("done");
  }
  EXPECT_EQ("\r\033[Ktool: done\n", out.str());
}

}  // namespace
