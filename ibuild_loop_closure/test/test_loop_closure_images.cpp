// SPDX-License-Identifier: BSD-3-Clause
//
// loop_closure_images as a user runs it: on rendered images, in a bag, and on recorded images.
#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/tool_test.h>
#include <rosbag/bag.h>
#include <sensor_msgs/Image.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <vector>

#include "test_images.h"

namespace ibuild_loop_closure {
namespace {

constexpr int kWalk = 24;

struct Loop {
  int query, match;
};

class LoopClosureImages : public mapping_common::ToolTest {
 protected:
  LoopClosureImages() : ToolTest(LOOP_CLOSURE_IMAGES) {}

  std::string folder(const std::string& name, int offset) const {
    std::filesystem::create_directory(dir_.path(name));
    for (int i = 0; i < kWalk; ++i) {
      cv::imwrite(dir_.path(name + "/image" + std::to_string(i) + ".png"), renderWalk(i, offset));
    }
    return dir_.path(name);
  }
  std::vector<Loop> loops() const {
    std::istringstream in(mapping_common::readFile(dir_.path("out/loops.csv")));
    std::string line;
    std::getline(in, line);
    EXPECT_EQ("query,match,similarity,correct", line);
    std::vector<Loop> loops;
    while (std::getline(in, line)) {
      Loop loop{};
      EXPECT_EQ(2, std::sscanf(line.c_str(), "%d,%d", &loop.query, &loop.match));
      loops.push_back(loop);
    }
    return loops;
  }
  void expectTheSecondWalk() const {
    EXPECT_GE(loops().size(), kWalk / 2u);
    for (const Loop& loop : loops()) EXPECT_NEAR(loop.query - kWalk, loop.match, 4);
  }
  void expectPictures(const std::vector<std::string>& names) const {
    for (const std::string& name : names) {
      EXPECT_FALSE(cv::imread(dir_.path("out/" + name)).empty()) << name;
    }
  }
  // Of a file that was written, with this at their end.
  int rows(const std::string& name, const std::string& end = "") const {
    std::istringstream in(mapping_common::readFile(dir_.path("out/" + name)));
    int rows = 0;
    for (std::string line; std::getline(in, line);)
      rows += line.size() >= end.size() && line.compare(line.size() - end.size(), end.size(), end) == 0;
    return rows;
  }
  static bool withFigures() {
    return mapping_common::run("/usr/bin/python3 -c 'import matplotlib'").code == 0;
  }
  const std::string out_ = " --out " + dir_.path("out");
};

TEST_F(LoopClosureImages, FindsTheSecondWalkAndWritesAll) {
  const std::string log = outputOf("--images " + folder("a", 0) + " --images " + folder("b", 3) +
                                   " --walks 4 --deltas 50 --save " + dir_.path("v") + out_);
  expectTheSecondWalk();
  EXPECT_NE(std::string::npos, log.find("Precision 100.00 %")) << log;
  expectPictures({"pairs.png"});
  if (withFigures()) expectPictures({"similarity.png", "precision_recall.png"});
  for (const char* name : {"out/timing.json", "out/timing.md", "out/precision_recall.csv", "v"}) {
    EXPECT_TRUE(std::filesystem::exists(dir_.path(name))) << name;
  }
}

TEST_F(LoopClosureImages, WritesTheDataWithoutMatplotlib) {
  dir_.write("matplotlib.py", "raise ImportError('No module named matplotlib')");
  setenv("PYTHONPATH", dir_.path().c_str(), 1);
  const std::string log =
      outputOf("--images " + folder("a", 0) + " --images " + folder("b", 3) + " --walks 4" + out_);
  unsetenv("PYTHONPATH");
  EXPECT_NE(std::string::npos, log.find("install python3-matplotlib")) << log;
  EXPECT_NE(std::string::npos, log.find("no figures were drawn")) << log;
  EXPECT_FALSE(std::filesystem::exists(dir_.path("out/similarity.png")));
  expectTheSecondWalk();
  EXPECT_EQ(2 * kWalk * (2 * kWalk + 1) / 2 + 1, rows("similarity.csv"));
  EXPECT_EQ(rows("loops.csv"), 1 + rows("loops.csv", ",1"));  // header, and loops that are right
}

TEST_F(LoopClosureImages, TakesGroundTruthAsIntervalsOrPoses) {
  const std::string images = "--images " + folder("a", 0) + " --images " + folder("b", 3) + out_;
  std::ostringstream intervals, poses;
  for (int i = 0; i < kWalk; ++i) intervals << i + kWalk << ' ' << std::max(0, i - 4) << ' ' << i + 4 << '\n';
  for (int i = 0; i < 2 * kWalk; ++i) poses << "0 " << i % kWalk << " 0 0 0 0 0 1\n";
  EXPECT_NE(
      std::string::npos,
      outputOf(images + " --ground-truth " + dir_.write("t", intervals.str())).find("Precision 100.00 %"));
  EXPECT_NE(std::string::npos,
            outputOf(images + " --gap 10 --max-distance 4.5 --poses " + dir_.write("p", poses.str()))
                .find("Precision 100.00 %"));
  EXPECT_EQ(2 * kWalk + 1, rows("trajectory.csv"));
  if (withFigures()) expectPictures({"trajectory.png"});
}

TEST_F(LoopClosureImages, RunsEachMethodAndEstimatesDelta) {
  const std::string images =
      "--images " + folder("a", 0) + " --images " + folder("b", 3) + " --walks 4" + out_;
  for (const char* method : {"thesis", "thesis+grouping", "thesis+geometry"}) {
    outputOf(images + " --delta auto --method " + method);
    EXPECT_GE(loops().size(), kWalk / 3u) << method;
  }
}

TEST_F(LoopClosureImages, ReadsBags) {
  {
    rosbag::Bag bag(dir_.path("a.bag"), rosbag::bagmode::Write);
    for (int i = 0; i < 2 * kWalk; ++i) {
      std_msgs::Header header;
      header.stamp = ros::Time(100.0 + i);
      const cv_bridge::CvImage image(header, "mono8", renderWalk(i % kWalk, i < kWalk ? 0 : 3));
      if (i % 2 == 0) bag.write("raw", header.stamp, image.toImageMsg());
      bag.write("image", header.stamp, image.toCompressedImageMsg());
    }
  }
  outputOf("--bag " + dir_.path("a.bag") + " --image image" + out_);
  expectTheSecondWalk();
  outputOf("--bag " + dir_.path("a.bag") + " --image raw" + out_);
  EXPECT_NE(std::string::npos,
            outputOf("--bag " + dir_.path("a.bag") + " --image none" + out_, 1).find("topic none"));
}

TEST_F(LoopClosureImages, GivesTransformsWithRightImages) {
  constexpr int kDisparity = 15;  // of a wall 2 m away
  constexpr double kPixel = 2.0 / 300.0;
  const std::string arguments = "--images " + folder("a", 0) + " --images " + folder("b", 4);
  const std::string camera = " --camera 300 300 160 120 --baseline " + std::to_string(kDisparity * kPixel);
  outputOf(arguments + " --right " + folder("c", kDisparity) + " --right " + folder("d", 4 + kDisparity) +
           camera + out_);
  std::istringstream in(mapping_common::readFile(dir_.path("out/transforms.csv")));
  std::string line;
  std::getline(in, line);
  EXPECT_EQ("query,match,x,y,z,qx,qy,qz,qw,inliers", line);
  int transforms = 0;
  while (std::getline(in, line)) {
    int query = 0, match = 0;
    double x = 0, y = 0, z = 0;
    ASSERT_EQ(5, std::sscanf(line.c_str(), "%d,%d,%lf,%lf,%lf", &query, &match, &x, &y, &z)) << line;
    EXPECT_NEAR(kPixel * (6 * (query % 4) + 4 - 6 * (match % 4)), x, 0.03);
    EXPECT_NEAR(0.0, z, 0.05);
    ++transforms;
  }
  EXPECT_GE(transforms, kWalk / 3);
  EXPECT_NE(std::string::npos,
            outputOf(arguments + " --right " + dir_.path("c") + out_, 2).find("--right needs --camera"));
  EXPECT_NE(std::string::npos,
            outputOf(arguments + " --right " + dir_.path("c") + camera + out_, 1).find("equal numbers"));
}

TEST_F(LoopClosureImages, LeavesOutWhatItCantRead) {
  const std::string a = folder("a", 0), b = folder("b", 3);
  dir_.write("a/image5.png", "no image");
  const std::string log = outputOf("--images " + a + " --images " + b + out_);
  EXPECT_NE(std::string::npos, log.find("image5.png can't be read"));
  expectTheSecondWalk();  // ids are those of the files
}

TEST_F(LoopClosureImages, SaysWhatIsWrong) {
  EXPECT_NE(std::string::npos, outputOf("--images /nowhere" + out_, 1).find("no folder /nowhere"));
  EXPECT_NE(std::string::npos, outputOf(out_, 2).find("--images or --bag"));
  EXPECT_NE(std::string::npos, outputOf("--images . --method magic" + out_, 2).find("--method is magic"));
}

TEST_F(LoopClosureImages, GardensPoint) {
  const std::string data = mapping_common::findRecording("gardens_point");
  if (data.empty()) GTEST_SKIP() << mapping_common::withoutRecording("gardens_point");
  const std::string left = " --images " + data + "/day_left", right = " --images " + data + "/day_right";
  for (const std::string& walks : {left + right, right + left}) {
    outputOf(walks + " --walks 5" + out_);
    for (const Loop& loop : loops()) EXPECT_NEAR(loop.query - 120, loop.match, 5);
    EXPECT_GE(loops().size(), 111u) << walks;  // 92 %
  }
}

}  // namespace
}  // namespace ibuild_loop_closure
