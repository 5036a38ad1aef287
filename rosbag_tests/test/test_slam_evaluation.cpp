// SPDX-License-Identifier: BSD-3-Clause
//
// The scenarios that SLAM is judged by, and a small version of the evaluation (thesis, section 3.5.2).
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/testing/worlds.h>
#include <rosbag_tests/evaluations/slam_evaluation.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <filesystem>
#include <sstream>

namespace rosbag_tests {

using mapping_simulation::configFile;
using mapping_simulation::loadTrajectory;
using mapping_simulation::TimedPose;
using mapping_simulation::Trajectory;

namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

SlamScenario scenario(const std::string& name, double duration) {
  SlamScenario scenario = loadScenario(PACKAGE_DIR "/config/slam_evaluation/" + name + ".yaml");
  scenario.duration = duration;
  return scenario;
}

SlamRun run(const SlamRecording& recording, const std::string& cost,
            intensity_hector_slam::SlamOptions options = intensity_hector_slam::SlamOptions()) {
  options.matcher.cost = cost;
  if (options.guess == intensity_hector_slam::Guess::kOdometry)
    options.guess = intensity_hector_slam::Guess::kConstantVelocity;
  return runSlam(recording, options);
}

TEST(RandomDrive, StaysInItsAreaAndWithinItsLimits) {
  DriveOptions options;
  options.area = Eigen::AlignedBox2d(Eigen::Vector2d(-3, -1), Eigen::Vector2d(3, 2));
  options.turn_rate = 0.8;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Trajectory drive = randomDrive(options, 60.0, seed);
    EXPECT_DOUBLE_EQ(0.0, drive.startTime());
    EXPECT_GT(drive.endTime(), 60.0);
    double way = 0.0;
    for (std::size_t i = 1; i < drive.poses().size(); ++i) {
      const TimedPose &a = drive.poses()[i - 1], &b = drive.poses()[i];
      const Eigen::Isometry3d step = a.pose.inverse() * b.pose;
      const double elapsed = b.time - a.time;
      way += step.translation().norm();
      EXPECT_LE(step.translation().norm() / elapsed, options.max_speed + 1e-6);
      EXPECT_LE(Eigen::AngleAxisd(step.linear()).angle() / elapsed, options.turn_rate + 1e-6);
      EXPECT_NEAR(0.0, step.translation().y(), 0.02 * options.max_speed * options.turn_rate * elapsed + 1e-9);
      EXPECT_LT(options.area.exteriorDistance(b.pose.translation().head<2>()), 0.5);
    }
    EXPECT_GT(way, 5.0) << "seed " << seed;
  }
}

TEST(RandomDrive, SeedDecides) {
  DriveOptions options;
  options.area = Eigen::AlignedBox2d(Eigen::Vector2d(-3, -1), Eigen::Vector2d(3, 2));
  const auto end = [&](std::uint64_t seed) { return randomDrive(options, 10.0, seed).poses().back().pose; };
  EXPECT_TRUE(end(1).isApprox(end(1), 0.0));
  EXPECT_FALSE(end(1).isApprox(end(2), 1e-3));
}

TEST(Scenario, AllThatShipLoad) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PACKAGE_DIR "/config/slam_evaluation")) {
    EXPECT_NO_THROW(loadScenario(entry.path().string())) << entry.path();
    ++count;
  }
  EXPECT_GE(count, 9);
}

TEST(Scenario, FaultyFilesAreNamed) {
  TempDir dir;
  const auto error = [&](const std::string& text) {
    return errorOf([&] { loadScenario(dir.write("s.yaml", text)); });
  };
  const std::string files = "world: " + configFile("worlds/room_8x5.yaml") + "\n";
  const std::string sensor = "sensor: " + configFile("simulator/hokuyo_utm30lx.yaml") + "\n";
  EXPECT_EQ("", error(files + sensor + "duration: 3\n"));
  EXPECT_TRUE(mentions(error(files + sensor + "duration: -1\n"), {"s.yaml", "duration"}));
  EXPECT_TRUE(mentions(error(files + sensor + "duration: 3\nfault: fire\n"), {"fire", "clutter"}));
  EXPECT_TRUE(mentions(error(files + sensor + "duration: 3\nspeed: 3\n"), {"speed"}));
  EXPECT_TRUE(mentions(error(files + sensor + "duration: 3\ncalibration: none.yaml\n"),
                       {"s.yaml", "calibration: ", "none.yaml"}));
  EXPECT_TRUE(mentions(
      error(files + sensor + "duration: 3\ndrive: {x: [0, 1], y: [0, 1], speed: [1, 1], min_leg: 5}\n"),
      {"min_leg"}));
  EXPECT_TRUE(
      mentions(error(files + "sensor: " + configFile("simulator/velodyne_vlp16.yaml") + "\nduration: 3\n"),
               {"planar"}));
}

TEST(Recording, PointsLieOnTheWalls) {
  const SlamRecording recording = record(scenario("room", 0.5), 3);
  ASSERT_EQ(recording.scans.size(), recording.truth.size());
  ASSERT_GE(recording.scans.size(), 19u);
  for (std::size_t k = 0; k < recording.scans.size(); ++k) {
    const auto& scan = recording.scans[k];
    EXPECT_DOUBLE_EQ(scan.stamp, recording.truth[k].time);
    ASSERT_GT(scan.points.size(), 400u);
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      const Eigen::Vector3d point =
          recording.truth[k].pose * Eigen::Vector3d(scan.points[i].x(), scan.points[i].y(), 0.0);
      const double off = std::min(4.25 - std::abs(point.x()), 2.75 - std::abs(point.y()));
      EXPECT_NEAR(0.0, off, 0.15);
    }
  }
}

TEST(Recording, ReflectivitiesAreTheWalls) {
  const SlamRecording recording = record(scenario("room", 0.2), 4);
  std::size_t known = 0, all = 0, plausible = 0;
  for (const auto& scan : recording.scans) {
    all += scan.reflectivities.size();
    for (const float reflectivity : scan.reflectivities) {
      known += std::isfinite(reflectivity);
      plausible += reflectivity > 0.02f && reflectivity < 1.3f;
    }
  }
  EXPECT_GT(known, 0.8 * all);
  EXPECT_GT(plausible, 0.98 * known);
}

// The calibration is of another simulated drive, towards a wall of 0.8. What it doesn't cover has no
// reflectivity.
TEST(Recording, TheFittedTableIsNearTheIdeal) {
  SlamScenario room = scenario("room", 0.2);
  ASSERT_TRUE(room.calibration);
  const SlamRecording fitted = record(room, 4);
  room.calibration.reset();
  const SlamRecording ideal = record(room, 4);
  std::vector<float> errors;
  std::size_t lacking = 0;
  for (std::size_t k = 0; k < ideal.scans.size(); ++k) {
    for (std::size_t i = 0; i < ideal.scans[k].points.size(); ++i) {
      const float truth = ideal.scans[k].reflectivities[i] / 0.8f, found = fitted.scans[k].reflectivities[i];
      ASSERT_FALSE(std::isnan(truth) && std::isfinite(found)) << "no angle, but a reflectivity";
      if (std::isnan(found))
        lacking += std::isfinite(truth);
      else
        errors.push_back(std::abs(found / truth - 1.0f));
    }
  }
  EXPECT_EQ(errors.size(), fitted.known);
  EXPECT_LT(lacking, 0.1 * errors.size());
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.02f) << "median";
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.06f) << "nine tenths";
  EXPECT_GT(errors.back(), 0.0f) << "it is no copy of the simulator's own function";
}

TEST(Recording, RawIntensitiesAreScaled) {
  SlamScenario room = scenario("room", 0.1);
  room.model = laser_intensity_calib::ModelType::kRaw;
  const SlamRecording once = record(room, 4);
  room.reflectivity_scale = 0.4;
  const SlamRecording scaled = record(room, 4);
  ASSERT_GT(once.known, 0u);
  for (std::size_t i = 0; i < once.scans[0].points.size(); ++i)
    ASSERT_FLOAT_EQ(0.4f * once.scans[0].reflectivities[i], scaled.scans[0].reflectivities[i]);
  EXPECT_EQ(once.known, scaled.known);
}

TEST(Recording, ClutterHidesItsShare) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SlamRecording recording = record(scenario("room_clutter", 2.0), seed);
    const double share = static_cast<double>(recording.hidden) / recording.beams;
    EXPECT_NEAR(0.3, share, 0.1) << "seed " << seed;
  }
  EXPECT_EQ(0u, record(scenario("room", 0.1), 1).hidden);
}

TEST(Recording, Faults) {
  const SlamRecording whole = record(scenario("room", 4.0), 5);
  const auto faulty = [&](Fault fault) {
    SlamScenario s = scenario("room", 4.0);
    s.fault = fault;
    return record(s, 5);
  };
  const std::size_t half = whole.scans.size() / 2;
  const auto step = [&](const SlamRecording& r, std::size_t i) {
    return r.scans[i].stamp - r.scans[i - 1].stamp;
  };
  EXPECT_NEAR(10.025, step(faulty(Fault::kPause), half), 1e-9);
  EXPECT_NEAR(-29.975, step(faulty(Fault::kBackInTime), half), 1e-9);
  const SlamRecording empty = faulty(Fault::kEmpty), silent = faulty(Fault::kSilence);
  EXPECT_TRUE(empty.scans[half].points.empty());
  EXPECT_TRUE(empty.scans[half + 39].points.empty());
  EXPECT_FALSE(empty.scans[half + 40].points.empty());
  EXPECT_LT(silent.scans.size(), whole.scans.size());
  EXPECT_EQ(silent.scans.size(), silent.truth.size());
  EXPECT_EQ(Fault::kSilence, parseFault("silence"));
  EXPECT_THROW(parseFault("fire"), std::invalid_argument);
}

TEST(Evaluation, LossIsNoticed) {
  // Truth that the scans don't have: from 1 s on, a metre aside.
  SlamRecording recording = record(scenario("room", 2.0), 1);
  for (TimedPose& timed : recording.truth)
    if (timed.time >= 1.0) timed.pose.pretranslate(Eigen::Vector3d(1.0, 0.0, 0.0));
  const SlamRun result = run(recording, "combined");
  EXPECT_NEAR(1.0, result.lost_after, 1e-6);
  EXPECT_NEAR(1.0, result.delta.translation().max, 0.05);
}

TEST(Evaluation, TableAndJson) {
  std::vector<SlamRun> runs{run(record(scenario("room", 0.5), 1), "combined")};
  runs[0].scenario = "room";
  runs.push_back(runs[0]);
  runs[1].lost_after = 0.25;
  std::ostringstream table;
  printTable(table, runs);
  EXPECT_TRUE(
      mentions(table.str(), {"| scenario | cost     |   lost |", "| room     | combined | 1 of 2 |"}));
  const YAML::Node json = YAML::Load(runsToJson(runs));
  ASSERT_EQ(2u, json.size());
  EXPECT_TRUE(json[0]["lost_after_s"].IsNull());
  EXPECT_DOUBLE_EQ(0.25, json[1]["lost_after_s"].as<double>());
}

TEST(Evaluation, MapPicture) {
  TempDir dir;
  const SlamRecording recording = record(scenario("room", 0.2), 1);
  intensity_hector_slam::MultiMap map;
  const SlamRun result = runSlam(recording, {}, {}, &map);
  const auto& level = map.level(0);
  writeMapPicture(dir.path("m.ppm"), level);
  const std::string picture = mapping_common::readFile(dir.path("m.ppm"));
  int width = 0, height = 0;
  ASSERT_EQ(2, std::sscanf(picture.c_str(), "P6\n%d %d\n255\n", &width, &height));
  const std::size_t header = picture.find("255\n") + 4;
  ASSERT_EQ(3u * width * height, picture.size() - header);

  const YAML::Node json = YAML::Load(runToJson(result, level));
  EXPECT_EQ(result.delta.errors.size(), json["delta"]["errors"]["time_s"].size());
  EXPECT_EQ(result.poses.size(), json["absolute"]["errors"]["rotation_rad"].size());
  EXPECT_TRUE(json["lost_after_s"].IsNull());
  EXPECT_DOUBLE_EQ(level.resolution(), json["map"]["resolution"].as<double>());
  // It is free ahead of the start, the map's origin: white. Nothing is known at the picture's corner: grey.
  const auto pixel = [&](double x, double y) {
    const int column = static_cast<int>((x - json["map"]["x"].as<double>()) / level.resolution());
    const int row = height - 1 - static_cast<int>((y - json["map"]["y"].as<double>()) / level.resolution());
    return static_cast<unsigned char>(picture.at(header + 3 * (row * width + column)));
  };
  EXPECT_EQ(255, pixel(0.5, 0.0));
  const Eigen::Vector2d corner(json["map"]["x"].as<double>(), json["map"]["y"].as<double>());
  EXPECT_EQ(190, pixel(corner.x() + 0.01, corner.y() + 0.01));

  writeMapPicture(dir.path("empty.ppm"), intensity_hector_slam::MultiMap().level(0));
  EXPECT_EQ("P6\n1 1\n255\n", mapping_common::readFile(dir.path("empty.ppm")).substr(0, 11));
}

TEST(Evaluation, WhatWasSeenIsOnTheWalls) {
  TempDir dir;
  writeSeen(dir.path("seen.csv"), record(scenario("room", 2.0), 3));
  std::istringstream in(mapping_common::readFile(dir.path("seen.csv")));
  std::string line;
  std::getline(in, line);
  EXPECT_EQ("x,y", line);
  int points = 0;
  for (double x = 0, y = 0; std::getline(in, line); ++points) {
    ASSERT_EQ(2, std::sscanf(line.c_str(), "%lf,%lf", &x, &y)) << line;
    EXPECT_NEAR(0.0, std::min(4.25 - std::abs(x), 2.75 - std::abs(y)), 0.15);
  }
  EXPECT_GT(points, 10000);
  EXPECT_LT(points, 40000);
}

// The tool from end to end, and the pictures of what it wrote.
TEST(Evaluation, ToolAndPlots) {
  TempDir dir;
  std::string said;
  const auto run = [&said](const std::string& command) {
    const mapping_common::Ran ran = mapping_common::run(command);
    said = ran.said();
    return ran.code;
  };
  const std::string tool =
      EVALUATE_SLAM " " PACKAGE_DIR "/config/slam_evaluation/room.yaml --duration 1 --seeds 1 ";
  ASSERT_EQ(0, run(tool + "--cost reflectivity combined --out " + dir.path("out"))) << said;
  const YAML::Node runs = YAML::LoadFile(dir.path("out/evaluation.json"));
  ASSERT_EQ(2u, runs.size());
  for (const YAML::Node& one : runs) {
    const std::string file = dir.path("out/room-" + one["cost"].as<std::string>());
    const YAML::Node delta = YAML::LoadFile(file + ".json")["delta"];
    EXPECT_EQ(one["scans"].as<std::size_t>(), delta["errors"]["time_s"].size() + 1);
    EXPECT_DOUBLE_EQ(one["delta_translation_mean_m"].as<double>(),
                     delta["translation_m"]["mean"].as<double>());
    EXPECT_EQ(one["scans"].as<std::size_t>(), loadTrajectory(file + ".tum").poses().size());
  }
  EXPECT_EQ(2, run(tool + "--model lambert"));
  EXPECT_TRUE(mentions(said, {"lambert", "raw | range | lut"}));
  EXPECT_EQ(0, run(tool + "--model ideal --cost reflectivity"));

  if (run("/usr/bin/python3 -c 'import matplotlib'") != 0)
    GTEST_SKIP() << "no figures without python3-matplotlib";
  EXPECT_EQ(0, run("/usr/bin/python3 " PACKAGE_DIR "/scripts/plot_evaluation.py " + dir.path("out"))) << said;
  for (const char* name : {"out/room-errors.png", "out/room-maps.png"})
    EXPECT_GT(std::filesystem::file_size(dir.path(name)), 5000u) << name;
  EXPECT_EQ(0, run("/usr/bin/python3 " PACKAGE_DIR "/scripts/plot_evaluation.py " + dir.path("one.png") +
                   " room=" + dir.path("out/room-combined.json")));
  EXPECT_GT(std::filesystem::file_size(dir.path("one.png")), 5000u);
  EXPECT_NE(0, run("/usr/bin/python3 " PACKAGE_DIR "/scripts/plot_evaluation.py " + dir.path()));
  EXPECT_TRUE(mentions(said, {"evaluate_slam --out"}));
}

// Errors of the edges, whitened by their covariances, have the standard deviation 1 and are within it twice
// out of three times, whatever the cost.
TEST(Evaluation, CovariancesHold) {
  for (const char* cost : {"occupancy", "reflectivity", "combined"}) {
    double squares = 0.0, within = 0.0;
    std::size_t count = 0;
    for (const std::uint64_t seed : {21, 22, 23, 24}) {
      for (const double error : run(record(scenario("room", 20.0), seed), cost).normalized_errors) {
        squares += error * error;
        within += std::abs(error) <= 1.0;
        ++count;
      }
    }
    ASSERT_GT(count, 150u) << cost;
    EXPECT_NEAR(1.0, std::sqrt(squares / count), 0.2) << cost;
    EXPECT_NEAR(0.68, within / count, 0.1) << cost;
  }
}

// The thesis's case (Fig. 3.6). With all seeds: evaluate_slam config/slam_evaluation/room.yaml --seeds 100.
TEST(Evaluation, ReflectivityKeepsTheMapOfTheRoom) {
  intensity_hector_slam::SlamOptions hector;  // which never asks whether the pose is observable
  hector.matcher.min_observability = 0.0;
  hector.guess = intensity_hector_slam::Guess::kLastPose;
  int lost_by_hector = 0;
  for (const std::uint64_t seed : {8, 10, 13}) {
    const SlamRecording recording = record(scenario("room", 12.0), seed);
    lost_by_hector += run(recording, "occupancy", hector).lost();
    for (const char* cost : {"reflectivity", "combined"}) {
      const SlamRun result = run(recording, cost);
      EXPECT_FALSE(result.lost()) << cost << ", seed " << seed << ", after " << result.lost_after << " s";
      EXPECT_LT(result.delta.translation().mean, 0.005);
      EXPECT_LT(result.delta.rotation().mean, 0.1 * M_PI / 180.0);
    }
  }
  EXPECT_GE(lost_by_hector, 2);
}

// Fig. 3.1.
TEST(Evaluation, ReflectivityTellsWhereAlongTheCorridor) {
  const SlamRecording recording = record(scenario("corridor_textured", 8.0), 1);
  EXPECT_TRUE(run(recording, "occupancy").lost());
  EXPECT_FALSE(run(recording, "reflectivity").lost());
  EXPECT_FALSE(run(recording, "combined").lost());
}

// What calibration is for: raw intensities change along the corridor with range and angle more than with the
// walls.
TEST(Evaluation, RawIntensitiesDoNotTellWhereAlongTheCorridor) {
  SlamScenario corridor = scenario("corridor_textured", 6.0);
  EXPECT_FALSE(run(record(corridor, 208), "reflectivity").lost());
  corridor.model = laser_intensity_calib::ModelType::kRaw;
  corridor.reflectivity_scale = 0.4;
  EXPECT_TRUE(run(record(corridor, 208), "reflectivity").lost());
}

// Fig. 3.7: at most 5 mm and 0.1 degrees per scan.
TEST(Evaluation, LaboratoryAgainstTheTruth) {
  const SlamRun result = run(record(scenario("laboratory", 6.0), 1), "combined");
  EXPECT_FALSE(result.lost());
  EXPECT_LT(result.delta.translation().mean, 0.005);
  EXPECT_LT(result.delta.rotation().mean, 0.1 * M_PI / 180.0);
}

TEST(Evaluation, CorridorWithoutTextureIsUnobservable) {
  const SlamRecording recording = record(scenario("corridor", 3.0), 1);
  for (const char* cost : {"occupancy", "reflectivity", "combined"}) {
    const SlamRun result = run(recording, cost);
    EXPECT_GE(result.unobservable, 0.95 * (result.scans - 1)) << cost;
    EXPECT_TRUE(result.normalized_errors.empty()) << cost;
  }
  EXPECT_EQ(0u, run(record(scenario("corridor_textured", 3.0), 1), "combined").unobservable);
}

// Those of the occupancy are more cautious than honest, so that only the other has an upper bound.
TEST(Evaluation, CovariancesAreHonest) {
  for (const std::string cost : {"reflectivity", "combined"}) {
    int all = 0, within[3] = {};
    for (const std::uint64_t seed : {21, 22}) {
      const SlamRun result = run(record(scenario("room", 12.0), seed), cost);
      for (const double error : result.normalized_errors) {
        ++all;
        for (int i = 0; i < 3; ++i) within[i] += std::abs(error) <= i + 1.0;
      }
    }
    EXPECT_GT(all, 45) << cost;
    EXPECT_GT(within[0], 0.4 * all) << cost;
    if (cost == "reflectivity") {
      EXPECT_LT(within[0], 0.9 * all);
    }
    EXPECT_GT(within[2], 0.9 * all) << cost;
  }
}

TEST(Evaluation, FaultsDoNotBreakTheMap) {
  for (const char* name : {"room_clutter", "room_pause", "room_silence", "room_back_in_time", "room_empty"}) {
    const SlamRun result = run(record(scenario(name, 8.0), 2), "combined");
    EXPECT_FALSE(result.lost()) << name << ", after " << result.lost_after << " s";
  }
}

// People who walk along with the robot drag no map away, and get into none.
TEST(Evaluation, PeopleAroundTheRobotDoNotCostTheMap) {
  const SlamRecording recording = record(scenario("room_clutter", 13.0), 3);
  for (const char* cost : {"occupancy", "reflectivity", "combined"}) {
    const SlamRun result = run(recording, cost);
    EXPECT_FALSE(result.lost()) << cost << " after " << result.lost_after << " s";
    EXPECT_LT(result.absolute.translation().max, 0.2) << cost;
  }
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
