// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

#include "mapping_common/nodelet.h"

namespace mapping_common {
namespace {

TEST(DropCounts, CountsByReason) {
  DropCounts drops({"no transform", "malformed"});
  drops.add(0, 3);
  drops.add(1);
  EXPECT_EQ("3 no transform, 1 malformed", drops.text());
  EXPECT_EQ(4u, drops.recent());
  drops.endReport();
  EXPECT_EQ(0u, drops.recent());
  drops.add(1);
  EXPECT_EQ(1u, drops.recent());
  diagnostic_updater::DiagnosticStatusWrapper status;
  drops.addTo(status, "Dropped");
  ASSERT_EQ(2u, status.values.size());
  EXPECT_EQ("Dropped: malformed", status.values[1].key);
  EXPECT_EQ("2", status.values[1].value);
}

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
