// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

#include "ibuild_loop_closure/loop_detector.h"
#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

constexpr int kWalk = 48;  // images

LoopDetectorOptions thesisOptions() {
  LoopDetectorOptions options = LoopDetectorOptions::thesis();
  options.min_similarity = 0.05;
  return options;
}

struct Count {
  int accepted = 0, correct = 0;
};

// The same walk twice, the second displaced by a few pixels.
// @param size of the images, which are scaled down to it
Count walkTwice(LoopDetector& detector, cv::Size size = {320, 240}) {
  Count count;
  for (int i = 0; i < 2 * kWalk; ++i) {
    cv::Mat image = renderWalk(i % kWalk, i < kWalk ? 0 : 4);
    if (image.size() != size) cv::resize(image, image, size, 0.0, 0.0, cv::INTER_AREA);
    const Detection d = detector.process({image, {}, {}});
    EXPECT_EQ(i, d.image);
    EXPECT_EQ(static_cast<std::size_t>(i), d.similarities.size());
    if (!d.accepted) continue;
    ++count.accepted;
    count.correct += i >= kWalk && std::abs(d.best->match - (i - kWalk)) <= 4;
    EXPECT_GE(d.best->similarity, 0.0);
    EXPECT_LE(d.best->similarity, 1.0);
  }
  return count;
}

TEST(LoopDetector, FindsTheSecondWalk) {
  LoopDetector detector;
  const Count count = walkTwice(detector);
  EXPECT_EQ(count.accepted, count.correct);
  EXPECT_GE(count.correct, kWalk - 6);
}

// Thresholds are the same share of the bits for each.
LoopDetectorOptions optionsWith(const char* descriptor) {
  LoopDetectorOptions options;
  options.features.descriptor = descriptor;
  const int bits = FeatureExtractor(options.features).bits();
  for (int* delta : {&options.delta, &options.tracking_delta, &options.geometry.delta})
    *delta = *delta * bits / 512;
  return options;
}

TEST(LoopDetector, FindsItWithEachDescriptor) {
  for (const auto& descriptor : descriptors()) {
    const LoopDetectorOptions options = optionsWith(descriptor.name);
    LoopDetector detector(options);
    const Count count = walkTwice(detector);
    EXPECT_EQ(count.accepted, count.correct) << descriptor.name;
    EXPECT_GE(count.correct, kWalk - 6) << descriptor.name;
    // Bits are used as far as the length says, and none beyond.
    const int bits = FeatureExtractor(options.features).bits();
    Descriptor seen;
    for (std::size_t w = 0; w < detector.vocabulary().size(); ++w)
      for (std::size_t i = 0; i < seen.bits.size(); ++i)
        seen.bits[i] |= detector.vocabulary().word(w).bits[i];
    EXPECT_GT(hamming(seen, Descriptor()), 0.95 * bits) << descriptor.name;
    for (std::size_t i = (bits + 63) / 64; i < seen.bits.size(); ++i)
      EXPECT_EQ(0u, seen.bits[i]) << descriptor.name;
  }
}

TEST(LoopDetector, RefusesThresholdsBeyondTheDescriptorsLength) {
  LoopDetectorOptions options = optionsWith("orb");
  options.tracking_delta = 257;
  try {
    LoopDetector detector(options);
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_STREQ("tracking_delta is 257, allowed is 1 to 256 bits", e.what());
  }
}

TEST(LoopDetector, FindsItAsTheThesisDoes) {
  LoopDetector detector(thesisOptions());
  const Count count = walkTwice(detector);
  EXPECT_GE(count.correct, 0.9 * count.accepted);
  EXPECT_GE(count.correct, kWalk / 2);
}

TEST(LoopDetector, FindsItInSmallImages) {
  for (const cv::Size size : {cv::Size(160, 120), cv::Size(64, 32)}) {
    LoopDetector detector;
    const Count count = walkTwice(detector, size);
    EXPECT_EQ(count.accepted, count.correct) << size;
    EXPECT_GE(count.correct, kWalk / 2) << size;
  }
}

TEST(LoopDetector, IsTheSameEachTime) {
  LoopDetector a, b;
  for (int i = 0; i < 30; ++i) {
    const Detection x = a.process({renderWalk(i % 15), {}, {}}), y = b.process({renderWalk(i % 15), {}, {}});
    EXPECT_EQ(x.similarities, y.similarities);
    EXPECT_EQ(x.accepted, y.accepted);
  }
}

TEST(LoopDetector, AStandingCameraClosesNoLoop) {
  LoopDetector detector;
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(detector.process({renderWalk(i), {}, {}}).accepted);
  for (int i = 0; i < 60; ++i) EXPECT_FALSE(detector.process({renderWalk(20), {}, {}}).accepted) << i;
  int accepted = 0;
  for (int i = 0; i < 20; ++i) accepted += detector.process({renderWalk(i, 3), {}, {}}).accepted;
  EXPECT_GT(accepted, 10);
}

// What is in view all along, such as the house at a street's end, is no loop, though it can hardly be seen in
// some images; an image of it after a long way elsewhere is.
TEST(LoopDetector, ClosesLoopsOnlyWithWhatItHasLostSightOf) {
  const cv::Mat house = renderPlace(500, 0, {120, 120});
  const auto street = [&house](int image, bool shown) {
    cv::Mat view = renderPlace(image);  // the sides are new in every image
    if (shown) house.copyTo(view(cv::Rect(100 + image % 3, 60, 120, 120)));
    return view;
  };
  LoopDetectorOptions options;
  options.geometry.min_overlap = 0.0;
  LoopDetector detector(options);
  for (int i = 0; i < 60; ++i) {
    const bool hidden = i % 13 == 6 || i % 13 == 7;
    EXPECT_FALSE(detector.process({street(i, !hidden), {}, {}}).accepted) << i;
  }
  for (int i = 60; i < 90; ++i) EXPECT_FALSE(detector.process({street(i, false), {}, {}}).accepted) << i;
  int accepted = 0;
  for (int i = 90; i < 110; ++i) accepted += detector.process({street(i, true), {}, {}}).accepted;
  EXPECT_GT(accepted, 10);
}

// Two images in a row open a track; the first of them has its loop then, too.
TEST(LoopDetector, FindsTheBeginningOfATrackLater) {
  for (const int look_back : {10, 0}) {
    LoopDetectorOptions options;
    options.tracks.look_back = look_back;
    LoopDetector detector(options);
    std::vector<int> loops(kWalk);  // of each image of the second walk
    int late = 0;
    for (int i = 0; i < 2 * kWalk; ++i) {
      const Detection d = detector.process({renderWalk(i % kWalk, i < kWalk ? 0 : 4), {}, {}});
      if (d.accepted) ++loops.at(d.best->query - kWalk);
      for (const Loop& loop : d.earlier) {
        EXPECT_LT(loop.query, i);
        EXPECT_NEAR(loop.query - kWalk, loop.match, 4);
        EXPECT_GT(loop.similarity, 0.0);
        EXPECT_FALSE(loop.geometry.pairs.empty());
        ++loops.at(loop.query - kWalk);
        ++late;
      }
    }
    EXPECT_LE(*std::max_element(loops.begin(), loops.end()), 1);  // each image's is accepted once
    EXPECT_EQ(look_back > 0, late > 0);
    EXPECT_EQ(look_back > 0 ? 1 : 0, loops[0]);
  }
}

TEST(LoopDetector, DoesNotLookBackBeforeABreak) {
  LoopDetector detector;
  int late = 0;
  for (int i = 0; i < 2 * kWalk; ++i) {
    if (i == kWalk + 1) detector.breakSequence();
    const Detection d = detector.process({renderWalk(i % kWalk, i < kWalk ? 0 : 4), {}, {}});
    for (const Loop& loop : d.earlier) {
      EXPECT_GT(loop.query, kWalk);
      ++late;
    }
  }
  EXPECT_GT(late, 0);
}

// Of each fourth image of the second walk a part only shows the place: less than a loop by itself needs,
// enough for one that is like the loop before it.
TEST(LoopDetector, GoesOnWhereAnImageShowsLittle) {
  LoopDetector detector;
  const double least = detector.options().tracks.min_significance;
  int weak = 0;
  for (int i = 0; i < 2 * kWalk; ++i) {
    cv::Mat image = renderWalk(i % kWalk, i < kWalk ? 0 : 4);
    if (i >= kWalk && i % 4 == 3) {
      const cv::Rect shown(130, 20 + 4 * (i / 4), 60, 60);
      const cv::Mat place = image(shown).clone();
      image = renderPlace(500 + i);
      place.copyTo(image(shown));
    }
    const Detection d = detector.process({image, {}, {}});
    if (!d.accepted) continue;
    EXPECT_NEAR(i - kWalk, d.best->match, 4);
    const View &query = detector.view(i), &match = detector.view(d.best->match);
    weak += checkLayout(query, match, detector.options().geometry).significance < least;
  }
  EXPECT_GE(weak, 2);
}

TEST(LoopDetector, DoesNotMindHowOftenAnImageComes) {
  constexpr int kTimes = 4;
  LoopDetector detector;
  int accepted = 0;
  for (int i = 0; i < 2 * kWalk; ++i) {
    for (int k = 0; k < kTimes; ++k) {
      const Detection d = detector.process({renderWalk(i % kWalk, i < kWalk ? 0 : 4), {}, {}});
      if (!d.accepted) continue;
      ++accepted;
      EXPECT_NEAR(i - kWalk, d.best->match / kTimes, 4) << i;
    }
  }
  EXPECT_GT(accepted, kTimes * kWalk / 2);
}

TEST(LoopDetector, FindsNothingInAMirroredWalk) {
  LoopDetector detector;
  for (int i = 0; i < 2 * kWalk; ++i) {
    cv::Mat image = renderWalk(i % kWalk);
    if (i >= kWalk) cv::flip(image, image, 1);
    EXPECT_FALSE(detector.process({image, {}, {}}).accepted) << i;
  }
}

TEST(LoopDetector, SurvivesBlackAndBlurredImages) {
  for (const auto& options : {LoopDetectorOptions(), thesisOptions()}) {
    LoopDetector detector(options);
    for (int i = 0; i < 12; ++i) detector.process({renderWalk(i), {}, {}});
    cv::Mat blurred;
    cv::GaussianBlur(renderWalk(12), blurred, {51, 51}, 20.0);
    for (const cv::Mat& image :
         {cv::Mat(240, 320, CV_8UC1, cv::Scalar(0)), blurred, cv::Mat(240, 320, CV_8UC1, cv::Scalar(255))}) {
      const Detection d = detector.process({image, {}, {}});
      EXPECT_FALSE(d.accepted);
      EXPECT_LT(d.features, 20);
    }
    EXPECT_EQ(15, detector.images());
  }
}

TEST(LoopDetector, TakesImagesOfAnySizeAndDepth) {
  LoopDetector detector;
  for (int i = 0; i < 20; ++i) {
    cv::Mat image = renderPlace(i / 4, i % 4, {200 + 30 * (i % 5), 150 + 20 * (i % 3)});
    if (i % 3 == 1) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
    if (i % 3 == 2) image.convertTo(image, CV_16U, 100.0);
    EXPECT_GT(detector.process({image, {}, {}}).features, 50);
  }
  for (int size : {1, 2, 7, 15, 40}) {
    EXPECT_NO_THROW(detector.process({cv::Mat(size, size, CV_8UC1, cv::Scalar(100)), {}, {}}));
    EXPECT_NO_THROW(detector.process({cv::Mat(size, 2000, CV_8UC1, cv::Scalar(100)), {}, {}}));
  }
}

TEST(LoopDetector, RefusesWhatIsNoImageAndChangesNothing) {
  LoopDetector detector;
  detector.process({renderWalk(0), {}, {}});
  EXPECT_THROW(detector.process({cv::Mat(), {}, {}}), std::invalid_argument);
  EXPECT_THROW(detector.process({cv::Mat(10, 10, CV_32F), {}, {}}), std::invalid_argument);
  EXPECT_THROW(detector.process({cv::Mat(10, 10, CV_8UC2), {}, {}}), std::invalid_argument);
  EXPECT_THROW(detector.process({renderWalk(1), cv::Mat(10, 10, CV_16U), {}}), std::invalid_argument);
  EXPECT_THROW(detector.process({renderWalk(1), cv::Mat(240, 320, CV_8U), {}}), std::invalid_argument);
  EXPECT_EQ(1, detector.images());
}

TEST(LoopDetector, GivesThePoseWithDepth) {  // a wall seen head-on: a shift of the image is one of the camera
  const Camera camera = {300.0, 300.0, 160.0, 120.0};
  const cv::Mat depth(240, 320, CV_32FC1, cv::Scalar(2.0f));
  LoopDetector detector;
  int with_pose = 0;
  for (int i = 0; i < 2 * kWalk; ++i) {
    const Detection d = detector.process({renderWalk(i % kWalk, i < kWalk ? 0 : 4), depth, camera});
    if (!d.accepted || !d.best->geometry.pose) continue;
    ++with_pose;
    const auto shift = [](int image) { return 6 * (image % 4) + (image >= kWalk ? 4 : 0); };
    const double expected = 2.0 / 300.0 * (shift(i) - shift(d.best->match));
    const Eigen::Vector3d t = d.best->geometry.pose->transform.translation();
    EXPECT_NEAR(expected, t.x(), 0.03);
    EXPECT_GT(d.best->geometry.pose->information.diagonal().minCoeff(), 0.0);
  }
  EXPECT_GT(with_pose, kWalk / 2);
}

TEST(LoopDetector, ReportsItsStages) {
  LoopDetector detector;
  std::vector<Stage> stages;
  detector.process({renderWalk(0), {}, {}}, [&](Stage s) { stages.push_back(s); });
  ASSERT_EQ(static_cast<std::size_t>(kStages), stages.size());
  for (int i = 0; i < kStages; ++i) EXPECT_EQ(i, static_cast<int>(stages[i]));
}

TEST(FeatureExtractor, GivesPixelsOfTheImageAsItCame) {
  cv::Mat image(960, 1280, CV_8UC1, cv::Scalar(60));
  const cv::Rect square(480, 400, 160, 160);
  image(square).setTo(200);
  cv::GaussianBlur(image, image, {}, 2.0);
  for (int max_width : {640, 320}) {
    FeatureOptions options;
    options.max_width = max_width;
    const Features features = FeatureExtractor(options).extract(image);
    ASSERT_GE(features.size(), 4u);
    cv::Point2f low = features.points[0], high = low;
    for (const cv::Point2f& p : features.points) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y)};
    }
    EXPECT_NEAR(559.5, (low.x + high.x) / 2, 0.01) << max_width;
    EXPECT_NEAR(479.5, (low.y + high.y) / 2, 0.01) << max_width;
  }
}

TEST(LoopDetectorOptions, AreChecked) {
  LoopDetectorOptions options;
  options.delta = 600;
  EXPECT_THROW(LoopDetector{options}, std::invalid_argument);
  options = {};
  options.beta = 0;
  EXPECT_THROW(LoopDetector{options}, std::invalid_argument);
}

TEST(Delta, IsEstimatedFromConsecutiveImages) {  // 4.7.1
  const FeatureExtractor extractor;
  std::vector<std::pair<Features, Features>> pairs;
  for (int i = 0; i < 8; i += 4)
    pairs.emplace_back(extractor.extract(renderWalk(i)), extractor.extract(renderWalk(i + 1)));
  const int delta = estimateDelta(pairs);
  EXPECT_GE(delta, 30);
  EXPECT_LE(delta, 160);
  EXPECT_EQ(0, estimateDelta({}));
  EXPECT_EQ(0,
            estimateDelta({{extractor.extract(cv::Mat(240, 320, CV_8UC1, cv::Scalar(0))), pairs[0].first}}));
}

}  // namespace
}  // namespace ibuild_loop_closure
