// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_simulation/camera.h>
#include <mapping_simulation/city.h>
#include <mapping_simulation/testing/worlds.h>
#include <mapping_simulation/yaml_map.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

namespace mapping_simulation {
namespace {

// What a lidar sees, in axes of its own.
std::vector<Hit> look(const World& world, const Eigen::Vector3d& base,
                      const Eigen::Matrix3d& axes = Eigen::Matrix3d::Identity()) {
  const Scene scene = world.at(0.0);
  const Eigen::Vector3d origin = base + Eigen::Vector3d(0.0, 0.0, 1.73);
  std::vector<Hit> hits;
  for (int i = 0; i < 360; ++i) {
    for (int j = -10; j <= 10; ++j) {
      const double azimuth = i * M_PI / 180.0, elevation = 2.0 * j * M_PI / 180.0;
      const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                      std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      hits.push_back(scene.cast({origin, axes * direction}, 55.0));
    }
  }
  return hits;
}

TEST(City, IsVisitedAlongTheRoadWhereToldSo) {
  CityOptions options;
  options.shift = 0.0;
  options.along = true;
  int back = 0;
  const std::vector<CityVisit> visits = cityVisits(options);
  std::vector<const CityVisit*> first(options.places, nullptr);
  for (const CityVisit& v : visits) {
    const CityVisit*& other = first[v.place];
    if (!other) {
      other = &v;
      continue;
    }
    const double turn = Eigen::AngleAxisd((other->pose.inverse() * v.pose).rotation()).angle();
    back += turn > M_PI / 2.0;
    EXPECT_LT(std::min(turn, M_PI - turn), 0.35);
  }
  EXPECT_GT(back, options.places / 4);
  EXPECT_LT(back, 3 * options.places / 4);
}

// The part of the rays that meet something as far away, and what reflects as much.
std::pair<double, double> alike(const std::vector<Hit>& a, const std::vector<Hit>& b) {
  int ranges = 0, reflectivities = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const bool range = (!a[i] && !b[i]) || std::abs(a[i].range - b[i].range) < 0.05;
    ranges += range;
    reflectivities += range && std::abs(a[i].reflectivity - b[i].reflectivity) < 0.02;
  }
  return {static_cast<double>(ranges) / a.size(), static_cast<double>(reflectivities) / a.size()};
}

TEST(City, VisitsAreByDayAloneWhereAskedFor) {
  CityOptions options;
  const std::vector<CityVisit> both = cityVisits(options);
  options.by_day = true;
  const std::vector<CityVisit> by_day = cityVisits(options);
  ASSERT_EQ(both.size(), by_day.size());
  for (std::size_t i = 0; i < both.size(); ++i) {
    EXPECT_FALSE(by_day[i].night);
    EXPECT_TRUE(both[i].pose.isApprox(by_day[i].pose)) << "the same visits otherwise";
  }
}

TEST(City, VisitsEachPlaceByDayAndByNightInRandomOrder) {
  CityOptions options;
  const std::vector<CityVisit> visits = cityVisits(options);
  ASSERT_EQ(88u, visits.size());
  std::set<std::pair<int, int>> seen;
  std::vector<Eigen::Vector3d> middles(options.places);
  std::vector<int> order;
  for (const CityVisit& v : visits) {
    seen.insert({v.place, v.visit});
    EXPECT_EQ(v.visit == 1, v.night);
    order.push_back(v.place);
  }
  EXPECT_EQ(88u, seen.size());
  EXPECT_FALSE(std::is_sorted(order.begin(), order.end()));
  double farthest = 0.0, turned = 0.0;
  for (const CityVisit& a : visits) {
    for (const CityVisit& b : visits) {
      const double distance = (a.pose.translation() - b.pose.translation()).norm();
      if (a.place == b.place) {
        farthest = std::max(farthest, distance);
        turned = std::max(turned, Eigen::AngleAxisd(a.pose.linear().transpose() * b.pose.linear()).angle());
      } else {
        EXPECT_GT(distance, 150.0);
      }
    }
  }
  EXPECT_GT(farthest, 2.5);
  EXPECT_LT(farthest, 2.0 * options.shift);
  EXPECT_GT(turned, 3.0);
  // The same again, and other places by another seed.
  EXPECT_EQ(visits[5].place, cityVisits(options)[5].place);
  options.seed = 2;
  EXPECT_FALSE(visits[5].pose.isApprox(cityVisits(options)[5].pose));
}

TEST(City, HasStreetsOfOneShapeThatReflectDifferently) {
  CityOptions options;
  options.occupancy = 0.0;
  options.random_order = false;
  options.shift = 0.0;
  const std::vector<CityVisit> visits = cityVisits(options);
  const auto lookAlong = [&](int place) {
    const World world = cityAt(options, visits[place]);
    const auto pavement = std::find_if(world.shapes().begin(), world.shapes().end(),
                                       [](const Shape& s) { return s.name == "pavement"; });
    return look(world, visits[place].pose.translation(), pavement->pose.linear());
  };
  for (int place = 0; place < 4; ++place) {
    const std::vector<Hit> here = lookAlong(place);
    const auto [ranges, reflectivities] = alike(here, lookAlong(place + 4));
    EXPECT_GT(ranges, 0.95) << place;
    EXPECT_LT(reflectivities, 0.4) << place;
    EXPECT_LT(alike(here, lookAlong(place + 1)).first, ranges - 0.02) << place;  // another kind of street
  }
}

TEST(City, ChangesItsCarsAndNotItsHousesBetweenVisits) {
  CityOptions options;
  options.random_order = false;
  const std::vector<CityVisit> visits = cityVisits(options);
  for (const int place : {0, 5, 10, 15}) {
    const CityVisit &day = visits[place], &night = visits[place + options.places];
    const auto [ranges, reflectivities] = alike(look(cityAt(options, day), day.pose.translation()),
                                                look(cityAt(options, night), day.pose.translation()));
    EXPECT_GT(ranges, 0.6) << place;
    EXPECT_LT(ranges, 0.95) << place;
    EXPECT_GT(reflectivities, 0.9 * ranges) << place;
  }
}

TEST(City, KeepsTheRoadFreeWhereItsVisitorsStand) {
  const CityOptions options;
  for (const CityVisit& visit : cityVisits(options)) {
    double nearest = 100.0;
    for (const Hit& hit : look(cityAt(options, visit), visit.pose.translation()))
      if (hit) nearest = std::min(nearest, hit.range);
    EXPECT_GT(nearest, 0.6) << visit.place;
  }
}

TEST(City, IsDarkAtNightButForItsLamps) {
  CityOptions options;
  options.random_order = false;
  const std::vector<CityVisit> visits = cityVisits(options);
  CameraModel camera;
  camera.width = camera.height = 60;
  camera.fx = camera.fy = 30.0;
  camera.cx = camera.cy = 29.5;
  const Eigen::Isometry3d optical =
      Eigen::Translation3d(0.0, 0.0, 1.73) * Eigen::Isometry3d(fromRpyDegrees(-90.0, 0.0, -90.0));
  const auto brightness = [&](const CityVisit& visit) {
    const Image image = renderImage(camera, cityAt(options, visit).at(0.0), visits[0].pose * optical, 1, 1);
    return std::accumulate(image.data.begin(), image.data.end(), 0.0) / image.data.size();
  };
  const double day = brightness(visits[0]), night = brightness(visits[options.places]);
  EXPECT_GT(day, 60.0);
  EXPECT_GT(night, 2.0);
  EXPECT_LT(night, 0.4 * day);
}

TEST(City, SaysWhatIsOutOfRange) {
  CityOptions options;
  options.places = 0;
  expectError([&] { cityVisits(options); }, "1 to a million visits");
  options = {};
  options.shift = 6.0;
  expectError([&] { cityVisits(options); }, "0 to 5 m");
  options = {};
  options.occupancy = 1.5;
  expectError([&] { cityVisits(options); }, "parking lots");
}

}  // namespace
}  // namespace mapping_simulation
