// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "../tools/synthetic_words.h"
#include "ibuild_loop_closure/graph_index.h"
#include "random_descriptors.h"

namespace ibuild_loop_closure {
namespace {

constexpr int kDelta = 70;

std::vector<Descriptor> someWords(std::size_t count, unsigned seed) {
  SyntheticWords source(seed);
  std::vector<Descriptor> words;
  for (std::size_t i = 0; i < count; ++i) words.push_back(source.word(source.patch()));
  return words;
}

TEST(GraphIndex, FindsNothingInNothing) {
  EXPECT_EQ(-1, GraphIndex({}).find(Descriptor(), 512).word);
  EXPECT_EQ(0u, GraphIndex({}).size());
}

TEST(GraphIndex, FindsWhatIsThereWhileItGrows) {
  SyntheticWords source(1);
  GraphIndex graph({});
  LinearIndex exact(true);
  std::vector<SyntheticWords::Patch> seen;
  int there = 0, found = 0, nearest = 0;
  for (int i = 0; i < 20000; ++i) {
    seen.push_back(source.patch());
    graph.add(source.word(seen.back()));
    exact.add(source.word(seen.back()));
    if (i % 20 != 0) continue;
    const Descriptor query = source.word(source.again(seen[source.below(seen.size())]));
    const FoundWord expected = exact.find(query, kDelta), actual = graph.find(query, kDelta);
    if (expected.word < 0) {
      EXPECT_EQ(-1, actual.word);
      continue;
    }
    ++there;
    found += actual.word >= 0;
    nearest += actual.distance == expected.distance;
    if (actual.word >= 0) {
      EXPECT_EQ(hamming(query, graph.word(actual.word)), actual.distance);
    }
  }
  EXPECT_GT(there, 900);
  EXPECT_GE(found, 0.99 * there);
  EXPECT_GE(nearest, 0.98 * there);
}

// Groups of words that have no more in common than chance, one after the other: no direction leads from one
// to the next. A graph has nothing worse.
TEST(GraphIndex, FindsMostGroupsWithNothingInCommon) {
  const auto centres = randomDescriptors(100, 2);
  std::mt19937_64 random(3);
  GraphIndex graph({});
  for (const Descriptor& centre : centres) {
    for (int i = 0; i < 50; ++i) {
      Descriptor word = centre;
      for (int k = 0; k < 20; ++k) word = flip(word, 1, static_cast<int>(random() % 512));
      graph.add(word);
    }
  }
  int found = 0;
  for (const Descriptor& centre : centres) found += graph.find(centre, kDelta).word >= 0;
  EXPECT_GE(found, 90);
}

TEST(GraphIndex, IsTheSameForTheSameWords) {
  const auto words = someWords(3000, 4);
  GraphIndex a({}), b({});
  for (const Descriptor& word : words) {
    a.add(word);
    b.find(word, kDelta);  // looking leaves no trace
    b.add(word);
  }
  EXPECT_EQ(a.links(), b.links());
}

TEST(GraphIndex, FindsTheFirstOfEqualWords) {
  const auto random = randomDescriptors(1);
  GraphIndex graph({});
  for (int i = 0; i < 1000; ++i) graph.add(Descriptor());
  graph.add(random[0]);
  for (int i = 0; i < 1000; ++i) graph.add(Descriptor());
  graph.add(random[0]);
  EXPECT_EQ(2002u, graph.size());
  EXPECT_EQ(0, graph.find(Descriptor(), kDelta).word);
  EXPECT_EQ(0, graph.find(flip(Descriptor(), 30), kDelta).word);
  EXPECT_EQ(1000, graph.find(random[0], kDelta).word);
  EXPECT_EQ(random[0], graph.word(2001));
}

TEST(GraphIndex, FindsAmongWordsThatHardlyDiffer) {
  GraphIndex graph({});
  for (int i = 0; i < 512; ++i) graph.add(flip(Descriptor(), 1, i));
  for (int i = 0; i < 512; ++i) EXPECT_LE(graph.find(flip(Descriptor(), 1, i), kDelta).distance, 2);
}

TEST(GraphIndex, IsRestoredFromItsLinks) {
  const auto words = someWords(4000, 5), queries = someWords(200, 6);
  GraphIndex graph({}), restored({});
  for (int i = 0; i < 2000; ++i) graph.add(words[i]);
  restored.add(words[3000]);
  restored.restore({words.begin(), words.begin() + 2000}, graph.links());
  for (int i = 0; i < 2000; ++i) ASSERT_EQ(words[i], restored.word(i));
  for (int i = 2000; i < 4000; ++i) {  // and it goes on as if nothing had been
    graph.add(words[i]);
    restored.add(words[i]);
  }
  EXPECT_EQ(graph.links(), restored.links());
  for (const Descriptor& query : queries) {
    EXPECT_EQ(graph.find(query, 150).word, restored.find(query, 150).word);
  }
}

TEST(GraphIndex, RefusesLinksThatAreNone) {
  const auto words = someWords(500, 7);
  GraphIndex graph({}), other({});
  for (const Descriptor& word : words) graph.add(word);
  other.add(words[0]);
  const auto links = graph.links();
  const auto refuses = [&](std::vector<std::int32_t> broken) {
    EXPECT_THROW(other.restore(words, broken), std::runtime_error);
    EXPECT_EQ(1u, other.size());
  };
  refuses({});
  refuses({links.begin(), links.end() - 1});
  auto broken = links;
  broken.push_back(0);
  refuses(broken);
  for (std::int32_t bad : {-2, 500, 1000000}) {
    broken = links;
    broken[1] = bad;
    refuses(broken);
  }
  broken = links;
  broken[0] = 1000;
  refuses(broken);
  other.restore(words, links);
  EXPECT_EQ(500u, other.size());
}

}  // namespace
}  // namespace ibuild_loop_closure
