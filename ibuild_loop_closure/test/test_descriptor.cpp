// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "ibuild_loop_closure/features.h"
#include "random_descriptors.h"

namespace ibuild_loop_closure {
namespace {

TEST(Hamming, CountsDifferingBits) {
  const Descriptor zero;
  EXPECT_EQ(0, hamming(zero, zero));
  EXPECT_EQ(1, hamming(zero, flip(zero, 1, 511)));
  EXPECT_EQ(77, hamming(zero, flip(zero, 77, 30)));
  EXPECT_EQ(512, hamming(zero, flip(zero, 512)));
}

TEST(Hamming, AllKernelsAgree) {
  std::vector<Descriptor> words = randomDescriptors(300);
  words[7] = words[0];
  words[8] = flip(words[0], 512);
  std::vector<const Descriptor*> places;
  for (const Descriptor& word : words) places.push_back(&word);
  for (std::size_t count : {std::size_t{0}, std::size_t{1}, words.size()}) {
    std::vector<std::uint16_t> expected(words.size(), 9999), distances(words.size(), 9999);
    hammingDistances(words[0], words.data(), count, expected.data(), HammingKernel::kPortable);
    for (HammingKernel kernel : supportedKernels()) {
      hammingDistances(words[0], words.data(), count, distances.data(), kernel);
      EXPECT_EQ(expected, distances) << kernelName(kernel);
      std::fill(distances.begin(), distances.end(), 9999);
      hammingDistances(words[0], places.data(), count, distances.data(), kernel);
      EXPECT_EQ(expected, distances) << kernelName(kernel);
    }
    hammingDistances(words[0], words.data(), count, distances.data());
    EXPECT_EQ(expected, distances);
  }
}

TEST(Hamming, TakesWordsFromAnywhere) {
  const auto words = randomDescriptors(3);
  const std::vector<const Descriptor*> places = {&words[2], &words[0]};
  std::vector<std::uint16_t> distances(2);
  hammingDistances(words[0], places.data(), 2, distances.data());
  EXPECT_EQ((std::vector<std::uint16_t>{static_cast<std::uint16_t>(hamming(words[0], words[2])), 0}),
            distances);
}

TEST(Hamming, PortableIsAlwaysThere) {
  EXPECT_EQ(HammingKernel::kPortable, supportedKernels().front());
}

TEST(Centroid, IsTheMajorityOfEachBit) {  // Eq. 4.1: at least half
  const Descriptor zero;
  const Descriptor a = flip(zero, 3), b = flip(zero, 2), c = flip(zero, 1);
  EXPECT_EQ(b, centroid({a, b, c}));
  EXPECT_EQ(a, centroid({a, zero}));
  EXPECT_EQ(centroid({a, c}), centroid(a, c));
  const auto random = randomDescriptors(2);
  EXPECT_EQ(centroid({random[0], random[1]}), centroid(random[0], random[1]));
  EXPECT_THROW(centroid(std::vector<Descriptor>()), std::invalid_argument);
}

TEST(Matching, TakesPairsThatAreEachOthersNearest) {
  const auto random = randomDescriptors(4);
  const std::vector<Descriptor> a = {random[0], random[1], flip(random[1], 10)};
  const std::vector<Descriptor> b = {random[2], flip(random[1], 4), flip(random[0], 20)};
  EXPECT_EQ((std::vector<Match>{{0, 2, 20}, {1, 1, 4}}), matchDescriptors(a, b, 60));
  EXPECT_EQ((std::vector<Match>{{1, 1, 4}}), matchDescriptors(a, b, 20));  // under delta
  EXPECT_TRUE(matchDescriptors(a, {}, 60).empty());
  EXPECT_TRUE(matchDescriptors({}, b, 60).empty());
}

TEST(Matching, OneFeatureMatchesOnce) {
  const auto random = randomDescriptors(1);
  const std::vector<Descriptor> same = {random[0], random[0]};
  EXPECT_EQ(1u, matchDescriptors(same, {random[0]}, 60).size());
}

TEST(Matching, RatioRejectsTheAmbiguous) {
  const auto random = randomDescriptors(2);
  const std::vector<Descriptor> a = {random[0]};
  EXPECT_TRUE(matchDescriptors(a, {flip(random[0], 30), flip(random[0], 32, 100)}, 60, 0.8).empty());
  EXPECT_EQ(1u, matchDescriptors(a, {flip(random[0], 20), flip(random[0], 32, 100)}, 60, 0.8).size());
}

}  // namespace
}  // namespace ibuild_loop_closure
