// SPDX-License-Identifier: BSD-3-Clause
//
// Places of one shape: the streets of a simulated city, which differ in what they reflect alone, and a
// building that is the same turned by half a turn. No false place may be accepted.
#include <gtest/gtest.h>
#include <mapping_simulation/city.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/trajectory.h>
#include <mapping_simulation/world.h>

#include <Eigen/Cholesky>
#include <filesystem>
#include <string>
#include <vector>

#include "intensity_place_recognition/place_recognizer.h"

namespace intensity_place_recognition {
namespace {

using mapping_simulation::SensorConfig;

std::string config(const std::string& name) {
  return std::string(PACKAGE_DIR) + "/../mapping_simulation/config/" + name;
}

struct Counts {
  int visits_again = 0, accepted = 0, wrong = 0;
};

// Scans in turn; those of one place are nearer to each other than `near`, in m.
class Drive {
 public:
  explicit Drive(double near, int beta = 0) : near_(near), recognizer_(withBeta(beta)), beta_(beta) {}

  void add(const mapping_simulation::PosedScan& scan) {
    const int number = recognizer_.places();
    bool again = false;
    for (int i = 0; i < number - beta_; ++i)
      again = again || (poses_[i].translation() - scan.pose.translation()).norm() < near_;
    counts_.visits_again += again;
    const Recognition found = recognizer_.process(scan.cloud);
    if (found.registration.accepted) {
      const Eigen::Isometry3d error =
          (poses_[found.match].inverse() * scan.pose).inverse() * found.registration.pose;
      const bool right = error.translation().norm() < 0.3 && Eigen::AngleAxisd(error.linear()).angle() < 0.05;
      ++counts_.accepted;
      counts_.wrong += !right;
      EXPECT_TRUE(right) << number << " at " << found.match << ", evidence " << found.registration.evidence
                         << ", margin " << found.margin << ", wrong by " << error.translation().norm()
                         << " m";
    }
    poses_.push_back(scan.pose);
  }
  const Counts& counts() const { return counts_; }

 private:
  static PlaceRecognizerOptions withBeta(int beta) {
    PlaceRecognizerOptions options;
    options.beta = beta;
    return options;
  }
  double near_;
  PlaceRecognizer recognizer_;
  int beta_;
  std::vector<Eigen::Isometry3d> poses_;
  Counts counts_;
};

TEST(PlacesBuiltAlike, InACityAreToldApartByWhatTheyReflect) {
  mapping_simulation::CityOptions city;
  city.places = 12;
  city.seed = 11;
  SensorConfig sensor = mapping_simulation::loadSensor(config("simulator/velodyne_hdl64e.yaml"));
  sensor.columns /= 2;  // which is as good, and faster
  sensor.angle_increment *= 2.0;
  Drive drive(10.0);
  int number = 0;
  for (const mapping_simulation::CityVisit& visit : mapping_simulation::cityVisits(city)) {
    const mapping_simulation::Trajectory base({mapping_simulation::TimedPose{0.0, visit.pose}});
    drive.add(toPosedScan(sensor, sweep(sensor, cityAt(city, visit), base, 0.0, 500u + number++)));
  }
  EXPECT_EQ(0, drive.counts().wrong);
  EXPECT_EQ(12, drive.counts().visits_again);
  EXPECT_GE(drive.counts().accepted, 7);
}

// Errors of poses are as large as their covariances say, in all and about each axis.
TEST(PlacesBuiltAlike, InACityHavePosesWhoseCovariancesAreRight) {
  mapping_simulation::CityOptions city;
  city.places = 20;
  city.seed = 21;
  city.random_order = false;
  SensorConfig sensor = mapping_simulation::loadSensor(config("simulator/velodyne_hdl64e.yaml"));
  sensor.columns /= 2;
  sensor.angle_increment *= 2.0;
  const PlaceRecognizer recognizer;
  std::vector<mapping_simulation::PosedScan> first;
  Eigen::Matrix<double, 6, 1> squares = Eigen::Matrix<double, 6, 1>::Zero();
  double all = 0.0;
  int count = 0;
  for (const mapping_simulation::CityVisit& visit : mapping_simulation::cityVisits(city)) {
    const mapping_simulation::Trajectory base({mapping_simulation::TimedPose{0.0, visit.pose}});
    const mapping_simulation::PosedScan scan =
        toPosedScan(sensor, sweep(sensor, cityAt(city, visit), base, 0.0, 900u + count + 100u * visit.visit));
    ++count;
    if (visit.visit == 0) {
      first.push_back(scan);
      continue;
    }
    const mapping_simulation::PosedScan& match = first.at(visit.place);
    const Eigen::Isometry3d truth = match.pose.inverse() * scan.pose;
    Eigen::Isometry3d guess = truth;
    guess.translation() += Eigen::Vector3d(0.1, -0.1, 0.05);
    const Place query = recognizer.describe(scan.cloud), place = recognizer.describe(match.cloud);
    const Registration found = Registrar(query.shape, recognizer.options().registration)(place.shape, guess);
    ASSERT_LT((found.pose.translation() - truth.translation()).norm(), 0.3) << visit.place;
    const Eigen::Isometry3d difference = found.pose * truth.inverse();
    const Eigen::AngleAxisd turn(difference.rotation());
    Eigen::Matrix<double, 6, 1> error;
    error << difference.translation(), turn.angle() * turn.axis();
    squares += error.cwiseAbs2().cwiseQuotient(found.covariance.diagonal()) / city.places;
    all += error.dot(found.covariance.ldlt().solve(error)) / (6.0 * city.places);
  }
  EXPECT_GT(all, 0.5);
  EXPECT_LT(all, 2.0);
  for (int i = 0; i < 6; ++i) {
    EXPECT_GT(squares[i], 0.25) << "axis " << i;
    EXPECT_LT(squares[i], 4.0) << "axis " << i;
  }
}

TEST(PlacesBuiltAlike, InABuildingAreRefused) {
  const mapping_simulation::World world = mapping_simulation::loadWorld(config("worlds/building.yaml"));
  const mapping_simulation::Trajectory way =
      mapping_simulation::loadTrajectory(config("worlds/building.yaml"));
  const SensorConfig sensor = mapping_simulation::loadSensor(config("simulator/velodyne_vlp16_2hz.yaml"));
  Drive drive(3.0, 4);
  for (double stamp = 1.0; stamp < way.endTime() - 1.0; stamp += 4.0)
    drive.add(toPosedScan(sensor, sweep(sensor, world, way, stamp, static_cast<unsigned>(stamp))));
  EXPECT_EQ(0, drive.counts().wrong);
}

}  // namespace
}  // namespace intensity_place_recognition
