// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "intensity_place_recognition/local_description.h"
#include "intensity_place_recognition/vector_vocabulary.h"

namespace intensity_place_recognition {
namespace {

using Word = VectorVocabulary::Word;

template <class Read>
void passOn(const std::function<void(mapping_common::ArchiveWriter&)>& write, const Read& read) {
  const mapping_common::ArchiveFormat format{"ARCHIVE1", "words"};
  const std::string file = mapping_common::toArchive(format, write);
  mapping_common::readArchive(file.data(), file.data() + file.size(), "it", format, read);
}

TEST(VectorVocabulary, MergesWhatIsNearerThanDelta) {
  const VectorVocabulary vocabulary(0.5);
  // The second moves the first one's mean away from the third.
  const std::vector<Word> merged =
      vocabulary.merge({{0.0f, 0.0f}, {0.4f, 0.0f}, {-0.4f, 0.0f}, {5.0f, 5.0f}});
  EXPECT_EQ((std::vector<Word>{{0.2f, 0.0f}, {-0.4f, 0.0f}, {5.0f, 5.0f}}), merged);
  EXPECT_EQ(1u, vocabulary.nearest({-1.0f, 0.0f}, merged));
}

TEST(VectorVocabulary, FindsWordsAndMovesThemToTheirMean) {
  VectorVocabulary vocabulary(0.5);
  EXPECT_EQ(-1, vocabulary.find({1.0f, 0.0f}));
  vocabulary.add({1.0f, 0.0f});
  vocabulary.add({0.0f, 1.0f});
  EXPECT_EQ(1, vocabulary.find({0.3f, 0.9f}));
  EXPECT_EQ(-1, vocabulary.find({0.6f, 0.6f}));
  vocabulary.update(1, {0.3f, 1.0f}, 2);  // the third
  VectorVocabulary read(0.5);
  passOn([&](auto& out) { vocabulary.write(out); }, [&](auto& in) { read.read(in); });
  EXPECT_EQ(2u, read.size());
  EXPECT_EQ(1, read.find({0.55f, 0.9f}));
  EXPECT_TRUE(toWord(std::vector<float>{0.0f, 0.0f}.data(), 2).empty());
  EXPECT_EQ((Word{0.6f, 0.8f}), toWord(std::vector<float>{3.0f, 4.0f}.data(), 2));
}

TEST(InvertedIndex, SumsUpTheIdfOfCommonWords) {
  InvertedIndex index;
  index.add({{0, 0.0f}, {0, 1.0f}, {1, 0.0f}, {3, 0.0f}});
  index.add({{1, 0.0f}, {2, 0.0f}});
  index.add({{0, 0.0f}, {1, 0.0f}, {3, 2.0f}});
  // Eq. 4.3: word 1 is in all three.
  EXPECT_NEAR(2.0 * std::log(3.0 / 2.0), index.similarity(0, 2), 1e-5);
  EXPECT_NEAR(0.0, index.similarity(0, 1), 1e-6);
  // With a fourth.
  const std::vector<float> all = index.similarities({{2, 0.0f}, {3, 0.0f}}, 2);
  ASSERT_EQ(2u, all.size());
  EXPECT_NEAR(std::log(4.0 / 3.0), all[0], 1e-6);
  EXPECT_NEAR(std::log(4.0 / 2.0), all[1], 1e-6);
}

TEST(InvertedIndex, LetsCommonWordsVoteForTheTurn) {
  InvertedIndex index;
  index.add({{0, 1.0f}, {1, 2.0f}, {2, -3.0f}});
  std::vector<float> votes(120, 0.0f);
  index.vote({{0, 0.5f}, {1, 1.5f}, {2, 2.78f}, {2, 0.0f}}, 0, votes);  // past a half turn
  EXPECT_NEAR(0.5, bestTurns(votes, 1).at(0).yaw, 0.05);
}

TEST(InvertedIndex, RefusesWordsThatArentThere) {
  InvertedIndex index, read;
  index.add({{0, 1.0f}, {7, 2.0f}});
  const auto write = [&](mapping_common::ArchiveWriter& out) { index.write(out); };
  passOn(write, [&](auto& in) { read.read(in, 8); });
  EXPECT_EQ(1u, read.occurrences(7));
  EXPECT_THROW(passOn(write, [](auto& in) { InvertedIndex().read(in, 7); }), std::runtime_error);
}

}  // namespace
}  // namespace intensity_place_recognition
