// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "intensity_place_recognition/similarity_matrix.h"

namespace intensity_place_recognition {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
constexpr int kPlaces = 30;

// Of two visits of each place, i and i + kPlaces, at random, and more so at one place.
SimilarityMatrix similarities(unsigned seed, float more) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise;
  SimilarityMatrix matrix(2 * kPlaces, 2 * kPlaces);
  for (int i = 0; i < matrix.rows(); ++i)
    for (int j = 0; j <= i; ++j)
      matrix(i, j) = matrix(j, i) = noise(random) + (i == j + kPlaces ? more : 0.0f);
  return matrix;
}

int rightlyMostAlike(const SimilarityMatrix& matrix) {
  int right = 0;
  for (int i = 0; i < kPlaces; ++i) {
    Eigen::VectorXf row = matrix.row(i);
    row[i] = -1e9f;
    Eigen::Index best = 0;
    row.maxCoeff(&best);
    right += best == i + kPlaces;
  }
  return right;
}

TEST(SimilarityMatrix, FusedIsBetterThanEachAloneWhateverTheScales) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    const SimilarityMatrix a = similarities(2 * seed, 2.5f),
                           b = SimilarityMatrix(1000.0f * similarities(2 * seed + 1, 2.5f).array() - 7.0f);
    const int alone = std::max(rightlyMostAlike(a), rightlyMostAlike(b));
    EXPECT_GT(rightlyMostAlike(fused({a, b})), alone) << "seed " << seed;
  }
}

TEST(SimilarityMatrix, WhatOneKnowsNothingOfTheOtherTells) {
  SimilarityMatrix a = similarities(1, 5.0f), b = similarities(2, 5.0f);
  b.row(3).setConstant(kUnknown);
  b.col(3).setConstant(kUnknown);
  a(7, 8) = a(8, 7) = b(7, 8) = b(8, 7) = kUnknown;
  const SimilarityMatrix both = fused({a, b});
  EXPECT_EQ(2, (both.array().isNaN()).count());
  EXPECT_TRUE(std::isnan(both(7, 8)));
  Eigen::VectorXf row = a.row(3), of_both = both.row(3);
  row[3] = of_both[3] = -1e9f;
  Eigen::Index expected = 0, found = 0;
  row.maxCoeff(&expected);
  of_both.maxCoeff(&found);
  EXPECT_EQ(expected, found);
  EXPECT_TRUE(fused({SimilarityMatrix::Constant(4, 4, 0.3f)}).isZero())
      << "what is always the same says nothing";
}

TEST(SimilarityMatrix, WhoSeesNothingDoesntOutvote) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    const SimilarityMatrix a = similarities(2 * seed, 4.5f), nothing = similarities(2 * seed + 1, 0.0f);
    EXPECT_GE(rightlyMostAlike(a), kPlaces - 2);
    EXPECT_GE(rightlyMostAlike(fused({a, nothing})), kPlaces - 4) << "seed " << seed;
  }
}

TEST(SimilarityMatrix, TheSecondComparesThoseThatTheFirstFindsAlike) {
  SimilarityMatrix global(4, 4), local(4, 4);
  global << 1.0f, 0.9f, 0.1f, 0.2f, 0.9f, 1.0f, 0.3f, 0.4f, 0.1f, 0.3f, 1.0f, 0.2f, 0.2f, 0.4f, 0.2f, 1.0f;
  local.setConstant(7.0f);
  const SimilarityMatrix result = confirmed(global, local, 1);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      // The most like 0 is 1, 1: 0, 2: 1, 3: 1.
      if (i != j && (i == 1 || j == 1))
        EXPECT_EQ(7.0f, result(i, j)) << i << ' ' << j;
      else
        EXPECT_TRUE(std::isnan(result(i, j))) << i << ' ' << j;
    }
  }
}

}  // namespace
}  // namespace intensity_place_recognition
