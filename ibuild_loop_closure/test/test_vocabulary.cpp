// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "ibuild_loop_closure/vocabulary.h"
#include "random_descriptors.h"

namespace ibuild_loop_closure {
namespace {

TEST(Merge, ReplacesTheSimilarByTheirCentroid) {  // Fig. 4.8
  const auto random = randomDescriptors(2);
  const Descriptor a = random[0], b = flip(a, 5), c = random[1];
  const auto words = mergeDescriptors({a, c, b}, 20);
  ASSERT_EQ(2u, words.size());
  EXPECT_EQ(centroid(a, b), words[0]);
  EXPECT_EQ(c, words[1]);
}

TEST(Merge, IsGreedyFromTheUpdatedCentroid) {
  const Descriptor zero;
  // The second is 8 bits from the first and joins it; the third, 15 bits from the first, is 7 from the
  // centroid.
  EXPECT_EQ(1u, mergeDescriptors({zero, flip(zero, 8), flip(zero, 15)}, 10).size());
  EXPECT_EQ(2u, mergeDescriptors({zero, flip(zero, 15), flip(zero, 8, 100)}, 10).size());
  EXPECT_TRUE(mergeDescriptors({}, 10).empty());
}

class Similarity : public ::testing::TestWithParam<IndexType> {
 protected:
  Similarity() : words_(randomDescriptors(10)) {
    IndexOptions index;
    index.type = GetParam();
    vocabulary_ = Vocabulary(30, index);
  }
  std::vector<Descriptor> pick(const std::vector<int>& which) const {
    std::vector<Descriptor> picked;
    for (int i : which) picked.push_back(words_[i]);
    return picked;
  }
  Assignment see(const std::vector<int>& which) {
    const Assignment assignment = vocabulary_.assign(pick(which));
    vocabulary_.update(assignment);
    return assignment;
  }
  const std::vector<Descriptor> words_;
  Vocabulary vocabulary_;
};

TEST_P(Similarity, AssignsOldAndNewWords) {  // Fig. 4.9
  see({0, 1, 2});
  EXPECT_EQ(3u, vocabulary_.size());
  const Assignment assignment =
      vocabulary_.assign({flip(words_[2], 29), words_[5], flip(words_[0], 30), words_[2]});
  EXPECT_EQ(std::vector<int>{2}, assignment.old_words);
  EXPECT_EQ(2u, assignment.new_words.size());
  EXPECT_EQ(3u, vocabulary_.size());  // updated last
}

TEST_P(Similarity, KeepsOccurrencesAndInvertedIndex) {  // Fig. 4.10
  see({0, 1, 2});
  see({1, 2, 3});
  see({2});
  EXPECT_EQ(4u, vocabulary_.size());
  EXPECT_EQ(3, vocabulary_.occurrences(2));
  EXPECT_EQ((std::vector<int>{0, 1}), vocabulary_.imagesOf(1));
  EXPECT_EQ((std::vector<int>{1}), vocabulary_.imagesOf(3));
  EXPECT_EQ((std::vector<int>{1, 2, 3}), vocabulary_.wordsOf(1));
}

TEST_P(Similarity, IsTheModifiedJaccardIndex) {  // 4.4.3, by hand
  see({0, 1, 2});
  see({1, 2, 3});
  const Assignment now = vocabulary_.assign(pick({1, 3, 7, 8}));
  ASSERT_EQ(2u, now.new_words.size());
  // f = 1 for words 0 and 3, 2 for words 1 and 2.
  // Image 0: U = {1}, T = {0, 2}. Image 1: U = {1, 3}, T = {2}.
  const double u0 = 0.5 * 1, t0 = 1.5 * 2, u1 = 1.5 * 2, t1 = 0.5 * 1;
  const auto similarity = vocabulary_.similarities(now);
  EXPECT_NEAR(u0 / (u0 + t0 + 2), similarity[0], 1e-12);
  EXPECT_NEAR(u1 / (u1 + t1 + 2), similarity[1], 1e-12);
  EXPECT_EQ((std::vector<int>{1, 2}), vocabulary_.commonWords(now));
}

TEST_P(Similarity, OfTheSameImageIsOne) {
  see({0, 1, 2});
  EXPECT_NEAR(1.0, vocabulary_.similarities(vocabulary_.assign(pick({0, 1, 2})))[0], 1e-12);
}

TEST_P(Similarity, OfNothingIsZero) {
  see({0, 1});
  see({});
  EXPECT_EQ((std::vector<double>{0.0, 0.0}), vocabulary_.similarities(vocabulary_.assign(pick({4, 5}))));
  EXPECT_EQ((std::vector<double>{0.0, 0.0}), vocabulary_.idfSimilarities(vocabulary_.assign({})));
}

TEST_P(Similarity, IdfWeighsDownWhatIsCommon) {  // Eq. 4.3
  see({0, 1});
  see({0, 2});
  see({0, 3});
  const auto similarity = vocabulary_.idfSimilarities(vocabulary_.assign(pick({0, 3})));
  EXPECT_NEAR(std::log(4.0 / 3.0) / std::sqrt(30.0), similarity[0], 1e-12);
  EXPECT_NEAR((std::log(4.0 / 3.0) + std::log(4.0)) / std::sqrt(30.0), similarity[2], 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Indices, Similarity, ::testing::Values(IndexType::kLinear, IndexType::kGraph));

TEST(Vocabulary, ChecksDelta) {
  EXPECT_THROW(Vocabulary(0), std::invalid_argument);
  EXPECT_THROW(Vocabulary(513), std::invalid_argument);
}

}  // namespace
}  // namespace ibuild_loop_closure
