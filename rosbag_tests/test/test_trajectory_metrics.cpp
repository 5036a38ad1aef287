// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_simulation/testing/worlds.h>
#include <rosbag_tests/evaluations/trajectory_metrics.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <sstream>

namespace rosbag_tests {

using mapping_simulation::makePose;
using mapping_simulation::TimedPose;
using mapping_simulation::Trajectory;

namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

Trajectory straightLine(double start, double speed, int poses) {
  std::vector<TimedPose> line;
  for (int i = 0; i < poses; ++i) line.push_back({start + i, makePose(speed * i, 0, 0)});
  return Trajectory(line);
}

TEST(Moments, ByHand) {
  const Moments m = momentsOf({4, 1, 1, 2});
  EXPECT_DOUBLE_EQ(2.0, m.mean);
  EXPECT_DOUBLE_EQ(std::sqrt(1.5), m.deviation);
  EXPECT_DOUBLE_EQ(1.5, m.median);
  EXPECT_DOUBLE_EQ(4.0, m.max);
  EXPECT_TRUE(std::isnan(momentsOf({}).mean));
}

TEST(PoseAt, ExactInterpolatedAndNone) {
  const Trajectory line({{0.0, makePose(0, 0, 0)}, {1.0, makePose(2, 0, 0)}, {5.0, makePose(4, 0, 0)}});
  EXPECT_DOUBLE_EQ(2.0, poseAt(line, 1.0 + 1e-7, 0.0)->translation().x());
  EXPECT_DOUBLE_EQ(2.0, poseAt(line, 1.0 - 1e-7, 0.0)->translation().x());
  EXPECT_NEAR(0.5, poseAt(line, 0.25, 1.0)->translation().x(), 1e-12);
  EXPECT_FALSE(poseAt(line, 0.25, 0.9)) << "the neighbours are too far apart";
  EXPECT_FALSE(poseAt(line, 3.0, 1.0));
  EXPECT_FALSE(poseAt(line, -0.1, 10.0)) << "nothing is extrapolated";
  EXPECT_FALSE(poseAt(line, 5.1, 10.0));
}

TEST(Relations, ReadAndRejected) {
  TempDir dir;
  const auto relations =
      readRelations(dir.write("a.relations", "# comment\n1.5 2.5 1 2 3 0 0 1.570796326794897\n\n"));
  ASSERT_EQ(1u, relations.size());
  EXPECT_DOUBLE_EQ(1.5, relations[0].from);
  EXPECT_DOUBLE_EQ(2.5, relations[0].to);
  EXPECT_TRUE(relations[0].pose.isApprox(makePose(1, 2, 3, M_PI / 2), 1e-12));
  EXPECT_TRUE(mentions(errorOf([&] { readRelations(dir.write("b", "1 2 3\n")); }), {"b:1", "from to"}));
  EXPECT_TRUE(mentions(errorOf([&] { readRelations(dir.write("c", "1 2 nan 0 0 0 0 0\n")); }), {"c:1"}));
  EXPECT_TRUE(mentions(errorOf([&] { readRelations(dir.write("d", "\n")); }), {"no relation"}));
}

TEST(Relations, ErrorsByHand) {
  // True steps of 1 m, estimated as 1.3 m with a turn of 0.1 rad at the second pose.
  const Trajectory estimate({{0.0, makePose(7, 8, 0, M_PI / 2)},
                             {1.0, makePose(7, 9.3, 0, M_PI / 2 + 0.1)},
                             {2.0, makePose(7, 9.3, 0, M_PI / 2)}});
  const std::vector<Relation> relations{{0.0, 1.0, makePose(1, 0, 0)},
                                        {1.0, 2.0, makePose(0, 0, 0, -0.1)},
                                        {1.0, 0.0, makePose(0, 0, 0)},
                                        {0.0, 9.0, makePose(0, 0, 0)}};
  const PoseErrors errors = relationErrors(estimate, relations, 0.5);
  ASSERT_EQ(3u, errors.errors.size());
  EXPECT_EQ(1u, errors.unmatched);
  EXPECT_NEAR(0.3, errors.errors[0].translation, 1e-12);
  EXPECT_NEAR(0.1, errors.errors[0].rotation, 1e-12);
  EXPECT_NEAR(0.0, errors.errors[1].translation, 1e-12);
  EXPECT_NEAR(0.0, errors.errors[1].rotation, 1e-9);
  EXPECT_NEAR(1.3, errors.errors[2].translation, 1e-12);
  EXPECT_NEAR(1.6 / 3, errors.translation().mean, 1e-12);
  EXPECT_NEAR((0.09 + 1.69) / 3, errors.squaredTranslation().mean, 1e-12);
  EXPECT_NEAR(0.2 / 3, errors.rotation().mean, 1e-9);
  EXPECT_NEAR(0.02 / 3, errors.squaredRotation().mean, 1e-9);
  EXPECT_NEAR(1.3, errors.translation().max, 1e-12);
}

TEST(Relations, AngleWrapsAround) {
  const Trajectory estimate({{0.0, makePose(0, 0, 0)}, {1.0, makePose(0, 0, 0, M_PI - 0.05)}});
  const PoseErrors errors = relationErrors(estimate, {{0.0, 1.0, makePose(0, 0, 0, -M_PI + 0.05)}}, 0.5);
  EXPECT_NEAR(0.1, errors.errors.at(0).rotation, 1e-9);
}

TEST(Relations, ChangedStamps) {
  TempDir dir;
  const StampMap stamps(dir.write("stamps", "# stamp original\n2.000000 3.500000\n"));
  EXPECT_DOUBLE_EQ(2.0, stamps(3.5));
  EXPECT_DOUBLE_EQ(2.0, stamps(3.5 + 1e-7));
  EXPECT_DOUBLE_EQ(3.4, stamps(3.4));
  const PoseErrors errors =
      relationErrors(straightLine(0, 1, 3), {{0.0, 3.5, makePose(2, 0, 0)}}, 0.0, stamps);
  ASSERT_EQ(1u, errors.errors.size());
  EXPECT_NEAR(0.0, errors.errors[0].translation, 1e-12);
  EXPECT_TRUE(mentions(errorOf([&] { StampMap(dir.write("bad", "1 2\n1\n")); }), {"bad:2"}));
}

TEST(DeltaErrors, WhereverTheTrajectoriesStart) {
  const Trajectory reference = straightLine(0, 1.0, 11);
  const Trajectory estimate({{-1.0, makePose(0, 0, 0)},
                             {2.0, makePose(5, 5, 0, M_PI / 2)},
                             {4.0, makePose(5, 7.5, 0, M_PI / 2)},
                             {4.5, makePose(5, 8.0, 0, M_PI / 2 + 0.2)}});
  const PoseErrors errors = deltaErrors(reference, estimate, 1.0);
  EXPECT_EQ(1u, errors.unmatched);
  ASSERT_EQ(2u, errors.errors.size());
  EXPECT_DOUBLE_EQ(4.0, errors.errors[0].time);
  EXPECT_NEAR(0.5, errors.errors[0].translation, 1e-12);
  EXPECT_NEAR(0.0, errors.errors[0].rotation, 1e-9);
  EXPECT_NEAR(0.0, errors.errors[1].translation, 1e-12);
  EXPECT_NEAR(0.2, errors.errors[1].rotation, 1e-9);
}

TEST(AbsoluteErrors, Alignments) {
  std::vector<TimedPose> reference, estimate;
  const Eigen::Isometry3d moved = makePose(3, -2, 1, 2.5);
  for (int i = 0; i < 20; ++i) {
    reference.push_back({1.0 * i, makePose(std::sin(0.3 * i), 0.1 * i * i, 0, 0.1 * i)});
    estimate.push_back({1.0 * i, moved * reference.back().pose});
  }
  EXPECT_GT(
      absoluteErrors(Trajectory(reference), Trajectory(estimate), 0.5, Alignment::kNone).translation().mean,
      1.0);
  for (const Alignment alignment : {Alignment::kFirst, Alignment::kRigid}) {
    const PoseErrors errors = absoluteErrors(Trajectory(reference), Trajectory(estimate), 0.5, alignment);
    EXPECT_EQ(20u, errors.errors.size());
    EXPECT_LT(errors.translation().max, 1e-9);
    EXPECT_LT(errors.rotation().max, 1e-7);
  }
}

TEST(AbsoluteErrors, RigidAlignmentIsLeastSquares) {
  // An offset of +-0.3 m across a straight line can't be aligned away, whichever way the line points.
  std::vector<TimedPose> estimate;
  for (int i = 0; i < 40; ++i)
    estimate.push_back({1.0 * i, makePose(1, 1, 0, 0.7) * makePose(i, (i / 2) % 2 == i % 2 ? 0.3 : -0.3, 0)});
  const PoseErrors errors =
      absoluteErrors(straightLine(0, 1.0, 40), Trajectory(estimate), 0.5, Alignment::kRigid);
  EXPECT_NEAR(0.09, errors.squaredTranslation().mean, 1e-6);
  EXPECT_GT(absoluteErrors(straightLine(0, 1.0, 40), Trajectory(estimate), 0.5, Alignment::kFirst)
                .squaredTranslation()
                .mean,
            0.1);
}

TEST(Errors, TableAndJson) {
  const PoseErrors errors = deltaErrors(straightLine(0, 1.0, 5), straightLine(0, 1.5, 5), 0.5);
  std::ostringstream table;
  printErrors(table, "delta", errors);
  EXPECT_TRUE(
      mentions(table.str(), {"delta: 4 used, 0 without a pose", "0.5000", "rotation, squared (deg^2)"}));
  const YAML::Node json = YAML::Load(errorsToJson(errors));
  EXPECT_DOUBLE_EQ(0.5, json["translation_m"]["mean"].as<double>());
  EXPECT_DOUBLE_EQ(0.25, json["squared_translation_m2"]["mean"].as<double>());
  EXPECT_EQ(4u, json["errors"]["time_s"].size());
  EXPECT_TRUE(YAML::Load(errorsToJson(PoseErrors()))["rotation_rad"]["mean"].IsNull());
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
