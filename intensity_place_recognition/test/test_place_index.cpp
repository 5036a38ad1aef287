// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <random>

#include "intensity_place_recognition/place_index.h"

namespace intensity_place_recognition {
namespace {

constexpr std::size_t kSize = 128;

std::vector<float> randomKey(std::mt19937& random) {
  // As keys are: far fewer dimensions than numbers.
  std::normal_distribution<float> normal;
  float hidden[12];
  for (float& h : hidden) h = normal(random);
  std::vector<float> key(kSize);
  float norm = 0.0f;
  for (std::size_t i = 0; i < kSize; ++i) {
    key[i] = std::abs(std::sin(hidden[i % 12] + hidden[(i / 12) % 12] * 0.5f) + 0.1f * normal(random));
    norm += key[i] * key[i];
  }
  for (float& value : key) value /= std::sqrt(norm);
  return key;
}

std::vector<float> changed(std::vector<float> key, std::mt19937& random) {
  std::normal_distribution<float> normal(0.0f, 0.01f);
  for (float& value : key) value += normal(random);
  return key;
}

TEST(PlaceIndex, FindsTheNearestAmongFew) {
  PlaceIndex index;
  EXPECT_TRUE(index.nearest({1.0f}, 3).empty());
  for (const float x : {0.0f, 3.0f, 1.0f, 3.0f}) index.add({x, 0.0f});
  EXPECT_EQ((std::vector<std::size_t>{1, 3, 2}), index.nearest({2.9f, 0.0f}, 3));
  EXPECT_EQ((std::vector<std::size_t>{1, 2}), index.nearest({2.9f, 0.0f}, 2, 3));
  index.move(2, {3.2f, 0.0f});
  EXPECT_EQ((std::vector<std::size_t>{2, 1}), index.nearest({3.3f, 0.0f}, 2));
  EXPECT_THROW(index.move(0, {1.0f}), std::invalid_argument);
  EXPECT_THROW(index.add({1.0f}), std::invalid_argument);
  EXPECT_THROW(index.nearest({1.0f}, 1), std::invalid_argument);
}

// Among a hundred times as many places an answer takes less than twice the time that a scan takes at all.
TEST(PlaceIndex, GrowsToAHundredThousandPlaces) {
  std::mt19937 random(1);
  PlaceIndex index;
  std::vector<std::vector<float>> keys;
  double seconds[2];
  const std::size_t sizes[] = {1000, 100000};
  for (int s = 0; s < 2; ++s) {
    while (index.size() < sizes[s]) {
      keys.push_back(randomKey(random));
      index.add(keys.back());
    }
    int found = 0;
    constexpr int kQueries = 200;
    std::vector<std::vector<float>> queries;
    for (int i = 0; i < kQueries; ++i) queries.push_back(changed(keys[i * keys.size() / kQueries], random));
    const std::clock_t start = std::clock();
    for (int i = 0; i < kQueries; ++i) {
      const auto nearest = index.nearest(queries[i], 50);
      found += std::find(nearest.begin(), nearest.end(), i * keys.size() / kQueries) != nearest.end();
    }
    seconds[s] = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC / kQueries;
    EXPECT_GE(found, 0.97 * kQueries) << "at " << sizes[s] << " places";
    std::cout << sizes[s] << " places: " << 1e3 * seconds[s] << " ms, " << found << " of " << kQueries
              << " found\n";
  }
  EXPECT_LT(seconds[1], seconds[0] + 0.02);
}

}  // namespace
}  // namespace intensity_place_recognition
