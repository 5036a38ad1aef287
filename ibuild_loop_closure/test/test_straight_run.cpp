// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "ibuild_loop_closure/straight_run.h"

namespace ibuild_loop_closure {
namespace {

// Goes ahead, each image 5 % larger than the last one, and sways a little.
void goAhead(StraightRun& run, int images) {
  for (int i = 0; i < images; ++i) run.add(ImageMotion{i % 2 ? 0.04 : -0.04, 0.05});
}

TEST(StraightRun, LastsAsLongAsTheCameraGoesAhead) {
  StraightRun run;
  run.add({});
  goAhead(run, 200);
  EXPECT_EQ(0, run.start());
}

TEST(StraightRun, EndsWhereItTurns) {
  StraightRun run;
  run.add({});
  goAhead(run, 20);
  for (int i = 0; i < 10; ++i) run.add(ImageMotion{0.15, 0.0});  // 1.5 widths
  // From the image on after which it is a width to the last one.
  EXPECT_EQ(24, run.start());
  goAhead(run, 20);
  EXPECT_EQ(24, run.start());
}

TEST(StraightRun, EndsWhereTheCameraGoesBack) {
  StraightRun run;
  run.add({});
  goAhead(run, 20);
  for (int i = 0; i < 3; ++i) run.add(ImageMotion{0.0, -0.06});
  EXPECT_EQ(22, run.start());
}

TEST(StraightRun, BeginsWhereMotionIsUnknown) {
  StraightRun run(7);
  EXPECT_EQ(7, run.start());
  run.add(ImageMotion{0.0, 0.1});  // since an image of which nothing is known
  goAhead(run, 5);
  run.add({});
  goAhead(run, 5);
  EXPECT_EQ(13, run.start());
}

}  // namespace
}  // namespace ibuild_loop_closure
