// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <Eigen/LU>

#include "pose_graph/appearance.h"
#include "recorded_room.h"

namespace pose_graph {
namespace {

namespace slam = intensity_hector_slam;

class Appearance : public ::testing::Test {
 protected:
  Appearance() : path_(circle(24)) {
    const std::vector<Pose> round = path_;
    path_.insert(path_.end(), round.begin(), round.end());
    {
      SessionWriter writer(file_, true);
      writeRun(writer, path_);
    }
    session_ = std::make_unique<Session>(file_);
    graph_ = readGraph(*session_).graph;
  }
  std::int64_t idOf(std::size_t node) const { return graph_.nodes()[node].id; }
  ScanMatch match(std::size_t from, std::size_t to, const AppearanceOptions& options = {}) const {
    return matchScans(*session_, graph_, idOf(from), idOf(to), {}, {}, loop_, options);
  }

  mapping_common::TempDir dir_;
  const std::string file_ = dir_.path("room.session");
  std::vector<Pose> path_;
  std::unique_ptr<Session> session_;
  Graph graph_{true};
  slam::LoopOptions loop_;
};

TEST_F(Appearance, GivesTheTransformOfTwoScansOfARoom) {
  const ScanMatch match = this->match(2, 27);
  ASSERT_TRUE(match.sure) << match.why;
  const Pose error = (path_[2].inverse() * path_[27]).inverse() * match.transform;
  EXPECT_LT(error.translation.norm(), 0.02);
  EXPECT_LT(std::abs(error.yaw()), 0.005);
}

// What the map of key scans is off by makes a loop less sure than the match itself is.
TEST_F(Appearance, IsNoSurerThanALoopOfTheLaser) {
  const ScanMatch match = this->match(2, 27);
  ASSERT_TRUE(match.sure) << match.why;
  Eigen::Matrix3d information;
  const int rows[] = {0, 1, 5};
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) information(r, c) = match.information(rows[r], rows[c]);
  const Eigen::Matrix3d covariance = information.inverse();
  EXPECT_GE(covariance(0, 0), 0.999 * loop_.sigma_distance * loop_.sigma_distance);
  EXPECT_GE(covariance(1, 1), 0.999 * loop_.sigma_distance * loop_.sigma_distance);
  EXPECT_GE(covariance(2, 2), 0.999 * loop_.sigma_angle * loop_.sigma_angle);
  EXPECT_LT(covariance(0, 0), 4.0 * loop_.sigma_distance * loop_.sigma_distance) << "a room tells where";
}

// A scan that isn't of its key pose: sought among the others it is where it isn't, and the other way round
// not.
TEST_F(Appearance, RefusesWhatTheWayBackContradicts) {
  const double stamp = 1e-9 * static_cast<double>(graph_.nodes()[27].stamp) - 0.001;  // before the other
  KeyData elsewhere = toKeyData(lookAtRoom(path_[27] * planarPose(0.2, 0.0, 0.0), stamp));
  elsewhere.key_pose = idOf(27);
  elsewhere.frame = "base_link";
  SessionWriter(file_, true).put(std::move(elsewhere));
  session_ = std::make_unique<Session>(file_);
  ASSERT_EQ(2u, session_->dataAt(idOf(27), DataKind::kScan).size());
  const ScanMatch match = this->match(2, 27);
  EXPECT_FALSE(match.sure);
  EXPECT_NE(std::string::npos, match.why.find("the two ways round differ by 0.")) << match.why;
}

TEST_F(Appearance, SaysWhatIsMissing) {
  const ScanMatch later = matchScans(*session_, graph_, idOf(2), 12345, {}, {}, loop_, {});
  EXPECT_FALSE(later.sure);
  EXPECT_EQ("there is no scan at one of the poses", later.why);
  AppearanceOptions all;
  all.scans = 100;  // all are neighbours of the later pose
  const ScanMatch earlier = match(2, 27, all);
  EXPECT_FALSE(earlier.sure);
  EXPECT_EQ("there are no scans around one of the poses", earlier.why);
}

}  // namespace
}  // namespace pose_graph
