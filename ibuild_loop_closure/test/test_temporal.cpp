// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "ibuild_loop_closure/temporal.h"

namespace ibuild_loop_closure {
namespace {

TEST(TemporalConsistency, ConstrainsTheNextLoops) {  // 4.4.3 and Fig. 4.11, beta = 10
  TemporalConsistency consistency(10);
  EXPECT_TRUE(consistency.allows(99, 3));
  consistency.accept(99, 40);  // t = 100, t - k = 40
  EXPECT_TRUE(consistency.allows(100, 40));
  EXPECT_TRUE(consistency.allows(110, 50));
  EXPECT_FALSE(consistency.allows(100, 39));
  EXPECT_FALSE(consistency.allows(100, 51));
  EXPECT_TRUE(consistency.allows(111, 5));  // forgotten
}

TEST(TemporalConsistency, AllowsAnyOfSeveralVisits) {
  TemporalConsistency consistency(10);
  consistency.accept(99, 40);
  consistency.accept(100, 45);
  EXPECT_TRUE(consistency.allows(101, 42));
  EXPECT_TRUE(consistency.allows(101, 55));
  EXPECT_FALSE(consistency.allows(101, 56));
}

class Tracks : public ::testing::Test {
 protected:
  Tracks() {
    options_.min_significance = 4.0;
    options_.open_significance = 40.0;
    options_.trust_significance = 70.0;
    options_.min_verified = 2;
    options_.memory = 0.5;
    options_.backward = 2;
    options_.ahead = 3;
  }
  TrackOptions options_;
};

TEST_F(Tracks, OpenWithSeveralVerifiedLoops) {
  LoopTracks tracks(options_, 10);
  EXPECT_FALSE(tracks.decide(50, {{10, 100.0, true}}).accepted);  // one alone, however significant
  const auto second = tracks.decide(51, {{11, 30.0, true}});
  EXPECT_TRUE(second.accepted);
  EXPECT_DOUBLE_EQ(80.0, second.evidence);
  EXPECT_TRUE(tracks.decide(52, {{12, 5.0, false}}).accepted);   // then less will do
  EXPECT_FALSE(tracks.decide(53, {{13, 3.0, false}}).accepted);  // but not insignificance
}

TEST_F(Tracks, DontOpenWithoutSignificanceOrOrder) {
  LoopTracks weak(options_, 10), disordered(options_, 10), unverified(options_, 10);
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(weak.decide(50 + i, {{10 + i, 15.0, true}}).accepted);
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(disordered.decide(50 + i, {{100 - 20 * i, 60.0, true}}).accepted);
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(unverified.decide(50 + i, {{10 + i, 60.0, false}}).accepted);
}

TEST_F(Tracks, EndAfterBetaImages) {
  LoopTracks tracks(options_, 10);
  tracks.decide(50, {{10, 50.0, true}});
  ASSERT_TRUE(tracks.decide(51, {{11, 50.0, true}}).accepted);
  EXPECT_EQ((std::vector<int>{11, 12, 13, 14}), tracks.expected(52));
  EXPECT_TRUE(tracks.expected(62).empty());
  EXPECT_FALSE(tracks.decide(62, {{12, 50.0, true}}).accepted);
}

TEST_F(Tracks, EndWhenTheirEvidenceIsGone) {
  LoopTracks tracks(options_, 10);  // half of the evidence is left after each image
  tracks.decide(50, {{10, 30.0, true}});
  ASSERT_TRUE(tracks.decide(51, {{11, 30.0, true}}).accepted);   // 45
  EXPECT_TRUE(tracks.decide(52, {{12, 6.0, false}}).accepted);   // 22.5 is left
  EXPECT_TRUE(tracks.decide(54, {{14, 6.0, false}}).accepted);   // 5.6
  EXPECT_FALSE(tracks.decide(55, {{15, 6.0, false}}).accepted);  // 2.8 of 4
}

TEST_F(Tracks, AreTrustedWithMoreAndSayWhereTheyOpened) {
  LoopTracks tracks(options_, 10);
  EXPECT_FALSE(tracks.decide(50, {{10, 30.0, true}}).look_back);
  EXPECT_TRUE(tracks.decide(51, {{11, 30.0, true, 1.0, {1.5, 0.1, {}}}}).accepted);  // evidence 45
  EXPECT_FALSE(tracks.lastVerified(52));
  const auto trusted = tracks.decide(52, {{12, 50.0, true, 1.0, {1.2, 0.2, {}}}});  // 72.5
  ASSERT_TRUE(trusted.look_back);
  EXPECT_EQ(51, trusted.look_back->query);
  EXPECT_EQ(11, trusted.look_back->match);
  EXPECT_DOUBLE_EQ(72.5, trusted.look_back->evidence);
  EXPECT_DOUBLE_EQ(1.5, trusted.look_back->placement.scale);
  EXPECT_FALSE(tracks.decide(53, {{13, 60.0, false}}).look_back);  // once only
  const auto last = tracks.lastVerified(54);
  ASSERT_TRUE(last);
  EXPECT_EQ(52, last->query);
  EXPECT_EQ(12, last->match);
  EXPECT_DOUBLE_EQ(1.2, last->placement.scale);
  EXPECT_TRUE(tracks.goesOn(54, 14));
  EXPECT_FALSE(tracks.goesOn(54, 40));
  EXPECT_FALSE(tracks.lastVerified(64));
  for (int image : {54, 50}) {  // the same after it and before it
    EXPECT_DOUBLE_EQ(72.5 / 4.0, tracks.left(*last, image));
    const int expected = image - 40;
    EXPECT_GT(tracks.weightOf({expected, 5.0}, image, *last),
              tracks.weightOf({expected + 2, 5.0}, image, *last));
  }
}

TEST_F(Tracks, PreferTheCloserViewpoint) {
  LoopTracks tracks(options_, 10);
  EXPECT_EQ(1, tracks.decide(50, {{10, 50.0, true, 0.6}, {12, 45.0, true, 1.0}}).hypothesis);
  EXPECT_EQ(-1, tracks.decide(51, {}).hypothesis);
  // A match as far on as the query is.
  EXPECT_EQ(0, tracks.decide(52, {{14, 20.0, true}, {20, 22.0, true}}).hypothesis);
}

}  // namespace
}  // namespace ibuild_loop_closure
