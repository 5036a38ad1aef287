// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "mapping_common/recent.h"

namespace mapping_common {
namespace {

TEST(Recent, KeepsTheLastWithinItsMemory) {
  Recent<int> recent;
  recent.setMemory(100);
  for (int i = 0; i < 10; ++i) recent.add(i, 30, i);
  EXPECT_EQ(90u, recent.bytes());
  EXPECT_EQ(3u, recent.entries().size());
  const auto later = recent.after(7.0);
  ASSERT_EQ(2u, later.size());
  EXPECT_EQ(8, later[0].value);
  EXPECT_EQ(9, later[1].value);
  EXPECT_TRUE(recent.isComplete(6.0));
  EXPECT_FALSE(recent.isComplete(5.5));
}

TEST(Recent, WithoutMemoryItKnowsThatItLacksAll) {
  Recent<int> recent;
  EXPECT_TRUE(recent.isComplete(-1.0));
  recent.add(5.0, 1, 0);
  EXPECT_TRUE(recent.after(0.0).empty());
  EXPECT_FALSE(recent.isComplete(4.0));
  EXPECT_TRUE(recent.isComplete(5.0));
  recent.setMemory(10);
  recent.add(6.0, 1, 1);
  EXPECT_FALSE(recent.isComplete(4.0));
  EXPECT_EQ(1u, recent.after(4.0).size());
  recent.setMemory(0);
  EXPECT_FALSE(recent.isComplete(5.5));
}

TEST(Recent, ForgetsAllWhereTimeJumpsBack) {
  Recent<int> recent;
  recent.setMemory(100);
  recent.add(5.0, 1, 0);
  recent.add(1.0, 1, 1);
  ASSERT_EQ(1u, recent.after(0.0).size());
  EXPECT_EQ(1, recent.after(0.0)[0].value);
  EXPECT_EQ(1u, recent.bytes());
  EXPECT_TRUE(recent.isComplete(0.0));
}

}  // namespace
}  // namespace mapping_common
