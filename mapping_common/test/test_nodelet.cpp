// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

#include "mapping_common/nodelet.h"

namespace mapping_common {
namespace {

struct Response {
  bool success = false;
  std::string message;
};

TEST(Answer, TellsHowItWent) {
  Response done, failed, relative;
  answer("/tmp/a", done, [] { return "written"; });
  EXPECT_TRUE(done.success);
  EXPECT_EQ("written", done.message);
  answer("/tmp/a", failed, []() -> std::string { throw std::runtime_error("disk full"); });
  EXPECT_FALSE(failed.success);
  EXPECT_EQ("disk full", failed.message);
  answer("a", relative, []() -> std::string { throw std::logic_error("must not be called"); });
  EXPECT_FALSE(relative.success);
  EXPECT_EQ("path is 'a', allowed is an absolute path", relative.message);
}

}  // namespace
}  // namespace mapping_common
