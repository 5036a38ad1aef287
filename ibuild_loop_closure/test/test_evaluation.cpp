// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <numeric>

#include "ibuild_loop_closure/evaluation.h"

namespace ibuild_loop_closure {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

std::vector<int> counted(int count, int first = 0, int step = 1) {
  std::vector<int> ids;
  for (int i = 0; i < count; ++i) ids.push_back(first + i * step);
  return ids;
}

class Files : public ::testing::Test {
 protected:
  const mapping_common::TempDir dir_;
};

TEST_F(Files, OfIntervalsAreRead) {
  const auto path = dir_.write("t", "# query first last\n8 0 2\n8 4 4 # again\n\n9 1 3\n");
  const GroundTruth truth = GroundTruth::fromIntervals(path, counted(10));
  EXPECT_EQ(2, truth.loops());
  for (int match : {0, 2, 4}) EXPECT_TRUE(truth.isLoop(8, match));
  EXPECT_FALSE(truth.isLoop(8, 3));
  EXPECT_FALSE(truth.hasLoop(7));
  EXPECT_TRUE(GroundTruth::fromIntervals(path, counted(10), 1).isLoop(8, 3));
}

TEST_F(Files, OfIntervalsMayCountInTheNumbersOfFiles) {
  const auto path = dir_.write("t", "000036 000002 000011\n");
  const GroundTruth truth = GroundTruth::fromIntervals(path, counted(10, 0, 4));  // 0, 4, ... 36
  EXPECT_FALSE(truth.isLoop(9, 0));
  EXPECT_TRUE(truth.isLoop(9, 1));
  EXPECT_TRUE(truth.isLoop(9, 2));
  EXPECT_FALSE(truth.isLoop(9, 3));
}

TEST_F(Files, ThatAreWrongAreRefused) {
  const auto refuses = [&](const char* text, std::initializer_list<const char*> why) {
    const auto path = dir_.write("t", text);
    EXPECT_TRUE(mentions(errorOf([&] { GroundTruth::fromIntervals(path, counted(10)); }), why));
  };
  refuses("1 2\n", {"line 1", "three numbers"});
  refuses("9 0 1\n10 0 1\n", {"line 2", "no image 10"});
  refuses("9 0 x\n", {"line 1", "no number"});
  EXPECT_TRUE(mentions(errorOf([&] { GroundTruth::fromIntervals("/nowhere", {}); }), {"/nowhere"}));
  const auto poses = dir_.write("p", "1 2 3\n");
  EXPECT_TRUE(mentions(errorOf([&] { loadPoses(poses, counted(1)); }), {"line 1", "8, 12, 13 or 16"}));
  const auto few = dir_.write("p", "0 1 2 3 0 0 0 1\n");
  EXPECT_TRUE(mentions(errorOf([&] { loadPoses(few, counted(2)); }), {"no pose of image 1"}));
}

TEST_F(Files, OfPosesAreRead) {
  const auto tum = loadPoses(dir_.write("p", "0 1 2 3 0 0 0 1\n"), counted(1));
  const auto numbered =
      loadPoses(dir_.write("q", "8 1 0 0 5 0 1 0 6 0 0 1 7\n4 1 0 0 1 0 1 0 2 0 0 1 3\n"), counted(2, 4, 4));
  EXPECT_EQ(Eigen::Vector3d(1, 2, 3), tum[0].translation());
  EXPECT_EQ(Eigen::Vector3d(1, 2, 3), numbered[0].translation());
  EXPECT_EQ(Eigen::Vector3d(5, 6, 7), numbered[1].translation());
}

TEST(GroundTruth, OfWalks) {
  const GroundTruth truth = GroundTruth::fromWalks({5, 4, 5}, 1);
  EXPECT_EQ(14, truth.images());
  EXPECT_EQ(9, truth.loops());
  EXPECT_FALSE(truth.hasLoop(4));
  EXPECT_TRUE(truth.isLoop(5, 0));
  EXPECT_TRUE(truth.isLoop(7, 3));
  EXPECT_FALSE(truth.isLoop(7, 4));
  EXPECT_TRUE(truth.isLoop(11, 2));  // of the first walk
  EXPECT_TRUE(truth.isLoop(11, 7));  // of the second
}

TEST(GroundTruth, OfPoses) {
  std::vector<Eigen::Isometry3d> poses(20, Eigen::Isometry3d::Identity());
  for (int i = 0; i < 20; ++i) poses[i].translation().x() = i < 10 ? i : 19 - i;  // there and back
  GroundTruth truth = GroundTruth::fromPoses(poses, 1.5, 0.5, 5);
  EXPECT_TRUE(truth.isLoop(19, 0));
  EXPECT_TRUE(truth.isLoop(19, 1));
  EXPECT_FALSE(truth.isLoop(19, 2));
  EXPECT_FALSE(truth.hasLoop(11));  // too early
  for (int i = 10; i < 20; ++i) poses[i].linear() = Eigen::AngleAxisd(3.1, Eigen::Vector3d::UnitY()).matrix();
  EXPECT_EQ(0, GroundTruth::fromPoses(poses, 1.5, 0.5, 5).loops());
}

TEST(PrecisionRecall, CountsAcceptedLoops) {
  GroundTruth truth(10);
  for (int query : {6, 7, 8, 9}) truth.add(query, {query - 6, query - 5});
  const std::vector<Proposal> proposals = {
      {5, 1, 0.1, true}, {6, 1, 0.9, true}, {7, 5, 0.2, true}, {8, 2, 0.8, true}, {9, 3, 0.3, false}};
  const PrecisionRecall r = evaluate(proposals, truth);
  EXPECT_EQ(4, r.detected);
  EXPECT_EQ(2, r.correct);
  EXPECT_DOUBLE_EQ(0.5, r.precision());
  EXPECT_DOUBLE_EQ(0.5, r.recall());

  const auto curve = precisionRecallCurve(proposals, truth);
  ASSERT_EQ(5u, curve.size());
  EXPECT_DOUBLE_EQ(0.9, curve[0].threshold);
  EXPECT_DOUBLE_EQ(0.75, curve[2].at.recall());
  EXPECT_DOUBLE_EQ(1.0, curve[2].at.precision());
  EXPECT_DOUBLE_EQ(0.6, curve[4].at.precision());
  ASSERT_TRUE(bestAtFullPrecision(curve));
  EXPECT_DOUBLE_EQ(0.3, bestAtFullPrecision(curve)->threshold);
  EXPECT_FALSE(bestAtFullPrecision({}));
}

}  // namespace
}  // namespace ibuild_loop_closure
