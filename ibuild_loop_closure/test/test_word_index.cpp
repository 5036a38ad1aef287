// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "ibuild_loop_closure/word_index.h"
#include "random_descriptors.h"

namespace ibuild_loop_closure {
namespace {

// Words around centres, as those of images are.
std::vector<Descriptor> clusteredWords(std::size_t count, unsigned seed) {
  std::mt19937_64 random(seed);
  const auto centres = randomDescriptors(50, seed);
  std::vector<Descriptor> words;
  for (std::size_t i = 0; i < count; ++i) {
    Descriptor word = centres[random() % centres.size()];
    for (int k = 0; k < 120; ++k) word = flip(word, 1, static_cast<int>(random() % 512));
    words.push_back(word);
  }
  return words;
}

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

TEST(TreeIndex, IsExactWithoutALimit) {
  IndexOptions options;
  options.leaf_size = 40;
  options.max_checks = 1000000;
  TreeIndex tree(options);
  LinearIndex exact(true);
  for (const Descriptor& word : clusteredWords(3000, 1)) {
    tree.add(word);
    exact.add(word);
  }
  for (const Descriptor& query : clusteredWords(100, 1)) {
    const FoundWord a = exact.find(query, 150), b = tree.find(query, 150);
    EXPECT_EQ(a.word, b.word);
    EXPECT_EQ(a.distance, b.distance);
  }
}

TEST(TreeIndex, FindsMostWithFewComparisons) {
  IndexOptions options;
  options.leaf_size = 64;
  options.max_checks = 500;
  TreeIndex tree(options);
  LinearIndex exact(true);
  for (const Descriptor& word : clusteredWords(10000, 2)) {
    tree.add(word);
    exact.add(word);
  }
  int there = 0, found = 0;
  std::mt19937_64 random(3);
  for (int i = 0; i < 300; ++i) {
    Descriptor query = tree.word(random() % tree.size());
    for (int k = 0; k < 30; ++k) query = flip(query, 1, static_cast<int>(random() % 512));
    const FoundWord expected = exact.find(query, 70);
    there += expected.word >= 0;
    found += expected.word >= 0 && tree.find(query, 70).word == expected.word;
  }
  EXPECT_EQ(300, there);
  EXPECT_GT(found, 240);
}

TEST(TreeIndex, HoldsAnyNumberOfEqualWords) {
  IndexOptions options;
  options.leaf_size = 20;
  TreeIndex tree(options);
  const Descriptor zero;
  for (int i = 0; i < 500; ++i) tree.add(zero);
  tree.add(flip(zero, 100));
  EXPECT_EQ(0, tree.find(zero, 10).word);
  EXPECT_EQ(500, tree.find(flip(zero, 100), 10).word);
}

TEST(TreeIndex, IsRestoredFromItsShape) {
  IndexOptions options;
  options.leaf_size = 40;
  const auto words = clusteredWords(2000, 4);
  TreeIndex tree(options), other(options);
  for (const Descriptor& word : words) tree.add(word);
  other.restore(tree.shape(), words);
  for (const Descriptor& query : clusteredWords(100, 4)) {
    EXPECT_EQ(tree.find(query, 150).word, other.find(query, 150).word);
  }
  for (std::size_t i = 0; i < words.size(); ++i) ASSERT_EQ(words[i], other.word(i));

  auto broken = tree.shape();
  broken.leaves[3] = 0;  // the root is no leaf
  EXPECT_THROW(other.restore(broken, words), std::runtime_error);
  broken = tree.shape();
  broken.parents[1] = 7;
  EXPECT_THROW(other.restore(broken, words), std::runtime_error);
}

TEST(IndexOptions, AreChecked) {
  IndexOptions options;
  options.branching = 1;
  EXPECT_THROW(makeIndex(options), std::invalid_argument);
  options.branching = 16;
  options.leaf_size = 16;
  EXPECT_THROW(makeIndex(options), std::invalid_argument);
}

}  // namespace
}  // namespace ibuild_loop_closure
