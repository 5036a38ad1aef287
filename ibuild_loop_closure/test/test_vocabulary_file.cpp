// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include "ibuild_loop_closure/loop_detector.h"
#include "ibuild_loop_closure/vocabulary_file.h"
#include "random_descriptors.h"
#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

class VocabularyFiles : public ::testing::TestWithParam<IndexType> {
 protected:
  VocabularyFiles() {
    options_.index.type = GetParam();
    LoopDetector detector(options_);
    for (int i = 0; i < 16; ++i) detector.process({renderWalk(i), {}, {}});
    images_ = detector.images();
    words_ = detector.vocabulary().size();
    detector.save(path_);
  }
  LoopDetectorOptions options_;
  const mapping_common::TempDir dir_;
  const std::string path_ = dir_.path("a.vocabulary");
  int images_ = 0;
  std::size_t words_ = 0;
};

TEST_P(VocabularyFiles, AreReadAsTheyWereWritten) {
  LoopDetector loaded(options_), reference(options_);
  loaded.load(path_);
  ASSERT_GT(words_, 100u);
  EXPECT_EQ(words_, loaded.vocabulary().size());
  EXPECT_EQ(images_, loaded.images());
  for (int i = 0; i < 16; ++i) reference.process({renderWalk(i), {}, {}});
  reference.breakSequence();
  for (int i = 0; i < 4; ++i) {
    const cv::Mat image = renderWalk(4 + i, 3);
    EXPECT_EQ(reference.process({image, {}, {}}).similarities, loaded.process({image, {}, {}}).similarities);
  }
}

TEST_P(VocabularyFiles, AreRefusedIfCorruptedAndNothingChanges) {
  const std::string bytes = mapping_common::readFile(path_);
  LoopDetector detector(options_);
  detector.process({renderWalk(0), {}, {}});
  detector.process({renderWalk(1), {}, {}});
  const std::size_t words = detector.vocabulary().size();
  const auto refuses = [&](const std::string& content, const char* why) {
    const std::string path = dir_.write("broken", content);
    EXPECT_TRUE(mentions(errorOf([&] { detector.load(path); }), {path.c_str(), why}));
    EXPECT_EQ(words, detector.vocabulary().size());
    EXPECT_EQ(2, detector.images());
  };
  refuses("", "isn't a vocabulary");
  refuses("something else altogether", "isn't a vocabulary");
  refuses(bytes.substr(0, 10), "truncated");
  for (std::size_t i = 20; i < bytes.size(); i += bytes.size() / 50) {
    std::string broken = bytes;
    broken[i] = static_cast<char>(broken[i] ^ 0x10);
    refuses(broken, "checksum");
    refuses(bytes.substr(0, i), "truncated");
  }
  std::string other_version = bytes;
  other_version[8] = 9;
  refuses(other_version, "version 9");
  EXPECT_TRUE(
      mentions(errorOf([&] { detector.load(dir_.path("nowhere")); }), {"nowhere", "can't be opened"}));
}

INSTANTIATE_TEST_SUITE_P(Indices, VocabularyFiles, ::testing::Values(IndexType::kLinear, IndexType::kGraph));

// The bytes of version 2 were written by the program that wrote that version.
TEST(VocabularyFile, OfAnOlderVersionIsRead) {
  VocabularyFile file = loadVocabulary(PACKAGE_DIR "/test/files/version2.vocabulary");
  EXPECT_EQ("brisk", file.descriptor);
  EXPECT_EQ(70, file.content.delta);
  EXPECT_EQ(IndexType::kGraph, file.content.index.type);
  EXPECT_TRUE(file.content.index.nearest);
  EXPECT_EQ(24, file.content.index.search_breadth);
  EXPECT_EQ(6u, file.content.words.size());
  ASSERT_EQ(2u, file.content.image_words.size());
  EXPECT_EQ((std::vector<int>{4, 5}), file.content.image_words[1]);
  ASSERT_EQ(2u, file.views.size());
  EXPECT_EQ(cv::Point2f(3.0f, 4.5f), file.views[0].features.points[1]);
  EXPECT_EQ((std::vector<float>{1.0f, 0.0f}), file.views[1].depths);
  const mapping_common::TempDir dir;
  saveVocabulary(dir.path("v"), file);
  const VocabularyFile again = loadVocabulary(dir.path("v"));
  EXPECT_EQ(file.content.words, again.content.words);
  EXPECT_EQ(file.content.links, again.content.links);
  EXPECT_TRUE(mapping_common::same(file.content, again.content));
  EXPECT_EQ(6u, Vocabulary::restore(std::move(file.content)).size());
}

TEST(VocabularyFile, WithoutFeaturesIsRefusedByTheGeometricCheck) {
  const mapping_common::TempDir dir;
  LoopDetectorOptions without;
  without.geometric_check = false;
  LoopDetector detector(without), with;
  detector.process({renderWalk(0), {}, {}});
  detector.save(dir.path("v"));
  EXPECT_TRUE(mentions(errorOf([&] { with.load(dir.path("v")); }), {"geometric check"}));
}

TEST(VocabularyFile, OfOtherDescriptorsIsRefused) {
  const mapping_common::TempDir dir;
  for (const auto& written : descriptors()) {
    for (const auto& read : descriptors()) {
      LoopDetectorOptions options;
      options.features.descriptor = written.name;
      LoopDetector writer(options);
      writer.process({renderWalk(0), {}, {}});
      writer.process({renderWalk(1), {}, {}});
      writer.save(dir.path("v"));
      EXPECT_EQ(written.name, loadVocabulary(dir.path("v")).descriptor);
      options.features.descriptor = read.name;
      LoopDetector reader(options);
      const std::string error = errorOf([&] { reader.load(dir.path("v")); });
      EXPECT_EQ(&written != &read, mentions(error, {written.name, read.name})) << error;
      EXPECT_EQ(&written == &read ? 2 : 0, reader.images()) << error;
    }
  }
}

TEST(VocabularyFile, ThatIsInconsistentIsRefused) {
  const mapping_common::TempDir dir;
  const auto words = randomDescriptors(2);
  const auto refuses = [&](const std::vector<std::vector<int>>& image_words, const char* why) {
    Vocabulary::Content content;
    content.index.type = IndexType::kLinear;
    content.words = words;
    content.image_words = image_words;
    EXPECT_TRUE(mentions(errorOf([&] { Vocabulary::restore(content); }), {why}));
  };
  refuses({{0, 1, 2}}, "unknown words");
  refuses({{1, 0}}, "unordered");
  refuses({{0}}, "no image has");
}

TEST(VocabularyFile, WithLinksToUnknownWordsIsRefused) {
  Vocabulary vocabulary;
  vocabulary.update(vocabulary.assign(randomDescriptors(20)));
  Vocabulary::Content content = vocabulary.content();
  EXPECT_EQ(20u, Vocabulary::restore(content).size());
  content.links[1] = 20;
  EXPECT_TRUE(mentions(errorOf([&] { Vocabulary::restore(content); }), {"links"}));
  content.links.clear();
  EXPECT_TRUE(mentions(errorOf([&] { Vocabulary::restore(content); }), {"links"}));
}

}  // namespace
}  // namespace ibuild_loop_closure
