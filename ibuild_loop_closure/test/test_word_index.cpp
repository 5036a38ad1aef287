// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "ibuild_loop_closure/word_index.h"
#include "random_descriptors.h"

namespace ibuild_loop_closure {
namespace {

TEST(LinearIndex, FindsTheFirstOrTheNearest) {
  const Descriptor zero;
  LinearIndex first(false), nearest(true);
  for (int bits : {50, 20, 10, 10}) {
    first.add(flip(zero, bits));
    nearest.add(flip(zero, bits));
  }
  EXPECT_EQ(1, first.find(zero, 30).word);  // Fig. 4.9
  EXPECT_EQ(2, nearest.find(zero, 30).word);
  EXPECT_EQ(10, nearest.find(zero, 30).distance);
  EXPECT_EQ(-1, first.find(zero, 10).word);  // under delta, not at it
  EXPECT_EQ(-1, nearest.find(zero, 10).word);
  EXPECT_EQ(-1, LinearIndex(true).find(zero, 100).word);
}

TEST(IndexOptions, AreChecked) {
  IndexOptions options;
  options.links = 1;
  EXPECT_THROW(makeIndex(options), std::invalid_argument);
  options = {};
  options.search_breadth = 0;
  EXPECT_THROW(makeIndex(options), std::invalid_argument);
  options = {};
  options.insert_breadth = 0;
  EXPECT_THROW(makeIndex(options), std::invalid_argument);
}

}  // namespace
}  // namespace ibuild_loop_closure
