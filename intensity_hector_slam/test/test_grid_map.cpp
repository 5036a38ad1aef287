// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "flat_world.h"
#include "intensity_hector_slam/multi_map.h"

namespace intensity_hector_slam {
namespace {

Scan beamTo(const Eigen::Vector2f& end, float reflectivity = 0.5f) {
  Scan scan;
  scan.points = {end};
  scan.reflectivities = {reflectivity};
  return scan;
}

// Its corner is at the origin.
GridMap grid(double resolution, int width, int height) {
  return {resolution, {Eigen::Vector2i(0, 0), Eigen::Vector2i(width - 1, height - 1)}};
}

const Pose kMiddle(1.05, 1.05, 0.0);

// All is known in it.
GridMap randomMap(unsigned seed) {
  GridMap map = grid(0.1, 20, 20);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(0.01f, 0.99f);
  for (int y = 0; y < map.height(); ++y) {
    for (int x = 0; x < map.width(); ++x) map.set(x, y, {value(random), value(random)}, 1);
  }
  return map;
}

Eigen::Vector2d centre(const GridMap& map, int x, int y) {
  return map.resolution() * Eigen::Vector2d(x + 0.5, y + 0.5);
}

TEST(GridMap, InterpolationTakesTheValueOfACellAtItsCentre) {
  const GridMap map = randomMap(1);
  for (const auto& [x, y] : {std::pair(3, 4), std::pair(10, 0), std::pair(0, 12)}) {
    const auto at = map.interpolate(centre(map, x, y) + Eigen::Vector2d::Constant(1e-9));
    EXPECT_NEAR(map.cell(x, y).occupancy, at.value[0], 1e-5);
    EXPECT_NEAR(map.cell(x, y).reflectivity, at.value[1], 1e-5);
  }
}

// The weight of a cell falls with the distance from it, other than section 3.4.1 prints.
TEST(GridMap, InterpolationIsNearerToTheNearerCell) {
  const GridMap map = randomMap(2);
  const float left = map.cell(5, 5).reflectivity, right = map.cell(6, 5).reflectivity;
  const auto at = map.interpolate(centre(map, 5, 5) + Eigen::Vector2d(0.02, 1e-9));
  EXPECT_NEAR(0.8f * left + 0.2f * right, at.value[1], 1e-5);
  const float above = map.cell(5, 6).occupancy, here = map.cell(5, 5).occupancy;
  EXPECT_NEAR(0.3f * here + 0.7f * above,
              map.interpolate(centre(map, 5, 5) + Eigen::Vector2d(1e-9, 0.07)).value[0], 1e-5);
}

TEST(GridMap, DerivativesAreFiniteDifferences) {
  const GridMap map = randomMap(3);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> fraction(0.1, 0.9);
  constexpr double kStep = 0.005;
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector2d p =
        centre(map, i % 17, i % 13) + 0.1 * Eigen::Vector2d(fraction(random), fraction(random));
    const Eigen::Vector2d x(kStep, 0.0), y(0.0, kStep);
    const auto at = map.interpolate(p);
    const Eigen::Array2f dx = (map.interpolate(p + x).value - map.interpolate(p - x).value) / (2.0f * kStep);
    const Eigen::Array2f dy = (map.interpolate(p + y).value - map.interpolate(p - y).value) / (2.0f * kStep);
    EXPECT_LT((at.dx - dx).abs().maxCoeff(), 5e-3f);
    EXPECT_LT((at.dy - dy).abs().maxCoeff(), 5e-3f);
  }
}

TEST(GridMap, BeyondTheMapNothingWasObserved) {
  const GridMap map = randomMap(5);
  for (const Eigen::Vector2d& p : {Eigen::Vector2d(5.0, 0.0), Eigen::Vector2d(-0.1, -0.1),
                                   Eigen::Vector2d(1e30, 0.0), Eigen::Vector2d(0.0, std::nan(""))}) {
    const auto at = map.interpolate(p);
    EXPECT_EQ(0.5f, at.value[0]);
    EXPECT_EQ(0.0f, at.value[1]);
    EXPECT_TRUE((at.dx == 0.0f).all() && (at.dy == 0.0f).all());
    EXPECT_EQ(nullptr, map.find(p));
  }
}

// Eq. 2.6 in section 3.4.1.
TEST(GridMap, OccupancyIsThatOfBayes) {
  MapOptions options;
  options.update_factor_free = 0.3;
  options.update_factor_occupied = 0.8;
  GridMap map = grid(0.1, 20, 20);
  const Scan scan = beamTo({0.5f, 0.0f});
  map.update(scan, kMiddle, options);
  EXPECT_NEAR(0.8f, map.cell(15, 10).occupancy, 1e-6);
  for (int x = 10; x < 15; ++x) EXPECT_NEAR(0.3f, map.cell(x, 10).occupancy, 1e-6) << x;
  EXPECT_FALSE(GridMap::isKnown(map.cell(9, 10)));
  EXPECT_FALSE(GridMap::isKnown(map.cell(16, 10)));
  map.update(scan, kMiddle, options);
  EXPECT_NEAR(0.64 / (0.64 + 0.04), map.cell(15, 10).occupancy, 1e-6);
  for (int i = 0; i < 50; ++i) map.update(scan, kMiddle, options);
  EXPECT_FLOAT_EQ(options.max_probability, map.cell(15, 10).occupancy);
  EXPECT_FLOAT_EQ(options.min_probability, map.cell(12, 10).occupancy);
}

TEST(GridMap, FreeBeamsClearWithoutAHit) {
  MapOptions options;
  GridMap map = grid(0.1, 20, 20);
  Scan scan = beamTo({0.37f, 0.0f});
  scan.free = {{0.77f, 0.0f}, {50.0f, 0.0f}};  // the second ends outside
  map.update(scan, kMiddle, options);
  EXPECT_TRUE(GridMap::isOccupied(map.cell(14, 10)));  // a hit is one, whatever crosses it
  for (int x : {10, 11, 12, 15, 16, 17}) EXPECT_TRUE(GridMap::isFree(map.cell(x, 10))) << x;
  EXPECT_FALSE(GridMap::isKnown(map.cell(18, 10)));
}

TEST(GridMap, TheLastPartOfABeamClearsUnknownCellsAlone) {
  MapOptions options;
  options.clear_margin = 0.25;  // 3 cells along the axis, 2 of the diagonal
  GridMap map = grid(0.1, 20, 20);
  for (int i = 0; i < 20; ++i) {
    for (int j : {10, i}) map.set(i, j, {0.9f, 0.5f}, 1);
  }
  map.set(15, 10, {}, 0);
  map.update(beamTo({0.57f, 0.0f}), kMiddle, options);
  EXPECT_LT(map.cell(12, 10).occupancy, 0.9f);
  for (int x : {13, 14}) EXPECT_EQ(0.9f, map.cell(x, 10).occupancy) << x;
  EXPECT_TRUE(GridMap::isFree(map.cell(15, 10)));  // was unknown
  EXPECT_GT(map.cell(16, 10).occupancy, 0.9f);
  const float once = map.cell(15, 10).occupancy;
  map.update(beamTo({0.57f, 0.0f}), kMiddle, options);
  EXPECT_EQ(once, map.cell(15, 10).occupancy);
  map.update(beamTo({0.57f, 0.57f}), kMiddle, options);
  EXPECT_LT(map.cell(13, 13).occupancy, 0.9f);
  for (int i : {14, 15}) EXPECT_EQ(0.9f, map.cell(i, i).occupancy) << i;
}

TEST(GridMap, AScanUpdatesACellOnce) {
  const MapOptions options;
  GridMap once = grid(0.1, 20, 20), many = once;
  Scan scan = beamTo({0.51f, 0.0f});
  once.update(scan, Pose(1.0, 1.0, 0.0), options);
  for (int i = 0; i < 10; ++i) scan.points.push_back({0.51f, 0.001f * i});
  scan.points.push_back({0.85f, 0.0f});  // crosses the cell of the others
  scan.reflectivities.assign(scan.points.size(), 0.5f);
  many.update(scan, Pose(1.0, 1.0, 0.0), options);
  EXPECT_EQ(once.cell(15, 10).occupancy, many.cell(15, 10).occupancy);
  EXPECT_EQ(once.cell(12, 10).occupancy, many.cell(12, 10).occupancy);
}

TEST(GridMap, ABeamChangesNothingBeyondTheBorder) {
  const MapOptions options;
  const float rare = 0.5f * static_cast<float>(options.min_probability);  // in a map made with other options
  for (int y = 0; y < 4; ++y) {
    GridMap map = grid(1.0, 12, 4);
    for (int x = 0; x < 12; ++x) map.set(x, (y + 1) % 4, {rare, 0.0f}, 0);
    Scan scan = beamTo({3.5f, 0.5f + y});
    scan.origin = {11.5f, 0.5f + y};
    map.update(scan, Pose::Zero(), options);
    EXPECT_TRUE(GridMap::isFree(map.cell(11, y)));
    for (int x = 0; x < 12; ++x) EXPECT_EQ(rare, map.cell(x, (y + 1) % 4).occupancy) << x << ", " << y;
  }
}

TEST(GridMap, AScanIsTheSumOfItsBeams) {
  std::mt19937 random(1);
  const auto below = [&](int n) { return static_cast<int>(random() % n); };
  MapOptions options;
  options.clear_margin = 0.0;
  options.update_factor_free = 0.4;  // and back to 0.5
  options.update_factor_occupied = 0.6;
  for (int i = 0; i < 50; ++i) {
    const GridMap empty = grid(1.0, 2 + below(30), 2 + below(100));
    const auto somewhere = [&] {
      return Eigen::Vector2f(0.5f + below(empty.width()), 0.5f + below(empty.height()));
    };
    GridMap map = empty;
    for (int j = 0; j < 20; ++j) {
      Scan scan;
      scan.origin = somewhere();
      const std::size_t cells = static_cast<std::size_t>(empty.width()) * empty.height();
      std::vector<int> hits(cells, 0), crosses = hits;
      const auto at = [&](std::size_t cell) {
        return std::pair<int, int>(cell % empty.width(), cell / empty.width());
      };
      for (int k = 0; k < 10; ++k) {
        Scan beam = beamTo(somewhere(), 0.1f * k);
        beam.origin = scan.origin;
        GridMap alone = empty;
        alone.update(beam, Pose::Zero(), options);
        for (std::size_t i = 0; i < cells; ++i) {
          const auto [x, y] = at(i);
          hits[i] += GridMap::isOccupied(alone.cell(x, y));
          crosses[i] += GridMap::isFree(alone.cell(x, y));
        }
        scan.points.push_back(beam.points[0]);
        scan.reflectivities.push_back(beam.reflectivities[0]);
      }
      const GridMap before = map;
      map.update(scan, Pose::Zero(), options);
      for (std::size_t i = 0; i < cells; ++i) {
        const auto [x, y] = at(i);
        const double odds = hits[i] > 0 ? 1.5 : crosses[i] > 0 ? 1.0 / 1.5 : 1.0;
        const double p = before.cell(x, y).occupancy;
        const GridMap::Cell& cell = map.cell(x, y);
        ASSERT_NEAR(std::clamp(odds * p / (odds * p + 1.0 - p), 0.02, 0.98), cell.occupancy, 1e-6);
        const bool occupied = GridMap::isOccupied(cell);
        ASSERT_EQ(occupied ? before.count(x, y) + hits[i] : 0, map.count(x, y));
        ASSERT_EQ(occupied ? cell.reflectivity : 0.0f, cell.reflectivity);
      }
    }
  }
}

TEST(GridMap, ReflectivityIsTheMeanOfTheHits) {
  MapOptions options;
  GridMap map = grid(0.1, 20, 20);
  float sum = 0.0f;
  for (int i = 1; i <= 9; ++i) {
    map.update(beamTo({0.51f, 0.01f}, 0.1f * i), Pose(1.0, 1.0, 0.0), options);
    sum += 0.1f * i;
    EXPECT_NEAR(sum / i, map.cell(15, 10).reflectivity, 1e-6);
    EXPECT_EQ(i, map.count(15, 10));
  }
  map.update(beamTo({0.51f, 0.01f}, std::nanf("")), Pose(1.0, 1.0, 0.0), options);
  EXPECT_EQ(9, map.count(15, 10));
  options.max_count = 9;
  map.update(beamTo({0.51f, 0.01f}, 1.4f), Pose(1.0, 1.0, 0.0), options);
  EXPECT_NEAR(0.5f + 0.1f, map.cell(15, 10).reflectivity, 1e-6);
}

TEST(GridMap, WhatMovedAwayIsForgotten) {
  const MapOptions options;
  GridMap map = grid(0.1, 20, 20);
  map.update(beamTo({0.51f, 0.01f}, 0.9f), Pose(1.0, 1.0, 0.0), options);
  for (int i = 0; i < 40; ++i) map.update(beamTo({0.81f, 0.01f}), Pose(1.0, 1.0, 0.0), options);
  EXPECT_TRUE(GridMap::isFree(map.cell(15, 10)));
  EXPECT_EQ(0.0f, map.cell(15, 10).reflectivity);
  EXPECT_EQ(0, map.count(15, 10));
}

TEST(GridMap, TilesHaveNoSeams) {
  const Eigen::Vector2i first(-70, -5), last(70, 130);
  GridMap map(0.125, {first, last});
  std::mt19937 random(6);
  std::uniform_real_distribution<float> value(0.01f, 0.99f);
  for (int y = first.y(); y <= last.y(); ++y) {
    for (int x = first.x(); x <= last.x(); ++x) map.set(x, y, {value(random), value(random)}, 1);
  }
  for (int y = first.y(); y < last.y(); ++y) {
    for (int x = first.x(); x < last.x(); ++x) {
      const Eigen::Array2f between = map.interpolate(0.125 * Eigen::Vector2d(x + 1.0, y + 1.0)).value;
      const auto mean = [&](auto channel) {
        return 0.25f * (map.cell(x, y).*channel + map.cell(x + 1, y).*channel + map.cell(x, y + 1).*channel +
                        map.cell(x + 1, y + 1).*channel);
      };
      ASSERT_NEAR(mean(&GridMap::Cell::occupancy), between[0], 1e-6) << x << ", " << y;
      ASSERT_NEAR(mean(&GridMap::Cell::reflectivity), between[1], 1e-6);
    }
  }
  EXPECT_EQ(first, map.knownCells().min());
  EXPECT_EQ(last, map.knownCells().max());
}

TEST(GridMap, SquaresAreTheCellsAroundPoints) {
  const Eigen::Vector2i first(-200, -100), last(130, 70);
  GridMap map(0.1, {first, last});
  std::mt19937 random(8);
  const auto between = [&](float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random);
  };
  for (int y = first.y(); y <= last.y(); ++y) {
    for (int x = first.x(); x <= last.x(); ++x) {
      if (x < 0 || y < 0) map.set(x, y, {between(0.01f, 0.99f), between(0.1f, 1.0f)}, 1);
    }
  }
  GridMap::Seams seams;
  for (int i = 0; i < 20000; ++i) {
    Eigen::Array4f u, v, fx, fy;
    for (int k = 0; k < 4; ++k) {
      u[k] = i % 3 == 0 ? std::round(between(-210.0f, 140.0f)) : between(-210.0f, 140.0f);
      v[k] = between(-110.0f, 80.0f);
    }
    if (i % 100 == 0) u[1] = 1e30f, v[2] = -1e30f;
    const GridMap::Squares squares = map.squares(u, v, fx, fy, seams);
    for (int k = 0; k < 4; ++k) {
      const int x = std::floor(std::clamp(u[k], -1e9f, 1e9f)), y = std::floor(std::clamp(v[k], -1e9f, 1e9f));
      for (int right : {0, 1}) {
        ASSERT_EQ(map.cell(x + right, y).occupancy, squares[k].lower[right].occupancy)
            << u[k] << ", " << v[k];
        ASSERT_EQ(map.cell(x + right, y + 1).occupancy, squares[k].upper[right].occupancy)
            << u[k] << ", " << v[k];
        ASSERT_EQ(map.cell(x + right, y + 1).reflectivity, squares[k].upper[right].reflectivity);
      }
      if (i % 100 == 0) continue;
      ASSERT_EQ(u[k] - std::floor(u[k]), fx[k]);
      ASSERT_EQ(v[k] - std::floor(v[k]), fy[k]);
    }
  }
}

// By whole cells, wherever the borders of tiles are then.
TEST(GridMap, WhatIsElsewhereIsMappedAlike) {
  const Scan scan = look(furnishedRoom(), Pose::Zero(), {});
  const auto mapAt = [&](const Eigen::Vector2i& shift) {
    const Eigen::Vector2i half(100, 100);
    GridMap map(0.0625, {shift - half, shift + half});
    for (int i = 0; i < 3; ++i)
      map.update(scan, Pose(0.0625 * (shift.x() + 0.5), 0.0625 * (shift.y() + 0.5), 0.0), {});
    return map;
  };
  const GridMap here = mapAt({0, 0});
  for (const Eigen::Vector2i& shift : {Eigen::Vector2i(1, 0), {8, 8}, {63, -64}, {-1000, 77}}) {
    const GridMap there = mapAt(shift);
    for (int y = -100; y <= 100; ++y) {
      for (int x = -100; x <= 100; ++x) {
        const GridMap::Cell &a = here.cell(x, y), &b = there.cell(x + shift.x(), y + shift.y());
        ASSERT_EQ(a.occupancy, b.occupancy) << x << ", " << y << ", shifted by " << shift.transpose();
        ASSERT_EQ(a.reflectivity, b.reflectivity);
        ASSERT_EQ(here.count(x, y), there.count(x + shift.x(), y + shift.y()));
      }
    }
  }
}

TEST(GridMap, MapsAreTheSameWhereverTheirBordersAre) {
  GridMap map = randomMap(7), same = map;
  same.growTo({Eigen::Vector2i(-200, -300), Eigen::Vector2i(5, 5)});
  EXPECT_EQ(Eigen::Vector2i(-200, -300), same.box().min());
  EXPECT_EQ(map.box().max(), same.box().max());
  EXPECT_TRUE(map == same);
  same.set(-200, -300, {0.4f, 0.0f}, 0);
  EXPECT_FALSE(map == same);
  EXPECT_FALSE(same == map);
  map.clear();
  EXPECT_TRUE(map.knownCells().isEmpty());
}

TEST(MultiMap, TakesMemoryForWhatItKnows) {
  MultiMap map;
  const Scan scan = look(furnishedRoom(), Pose::Zero(), {});
  map.update(scan, Pose::Zero());
  const std::size_t one = map.bytes();
  EXPECT_LT(one, 10e6);
  map.update(scan, {180.0, 180.0, 0.0});  // 60 million cells between them
  EXPECT_LT(map.bytes(), 3 * one);
  EXPECT_GT(map.level(0).width(), 180 / 0.025);
}

TEST(MultiMap, LevelsHaveTheSameBorders) {
  MapOptions options;
  options.levels = 4;
  options.start_x = 0.3;
  const MultiMap map(options);
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(0.025 * (1 << i), map.level(i).resolution(), 1e-12);
    EXPECT_LT((map.level(0).origin() - map.level(i).origin()).norm(), 1e-9);
    EXPECT_EQ(map.level(0).width(), map.level(i).width() << i);
    EXPECT_EQ(map.level(0).height(), map.level(i).height() << i);
  }
}

TEST(MultiMap, GrowsWithWhatIsSeen) {
  MapOptions options;
  options.size = 128;
  MultiMap map(options);
  const Scan scan = look(furnishedRoom(), Pose::Zero(), {});
  map.update(scan, Pose::Zero());
  for (int i = 0; i < map.levels(); ++i) {
    for (const Eigen::Vector2f& point : scan.points) {
      const GridMap::Cell* cell = map.level(i).find(point.cast<double>());
      ASSERT_NE(nullptr, cell);
      EXPECT_TRUE(GridMap::isOccupied(*cell));
    }
  }
  // The same as in a map that was large enough before.
  options.size = 1024;
  MultiMap large(options);
  large.update(scan, Pose::Zero());
  EXPECT_TRUE(large == map);
}

TEST(MultiMap, DoesNotGrowBeyondItsLimit) {
  MapOptions options;
  options.size = 128;
  options.max_size = 6.4;
  MultiMap map(options);
  Scan scan = beamTo({500.0f, 0.0f});
  map.update(scan, Pose::Zero());
  EXPECT_LE(map.level(0).width() * 0.025, 6.4 + 1e-9);
  options.grow = false;
  MultiMap fixed(options);
  fixed.update(scan, Pose::Zero());
  EXPECT_EQ(128, fixed.level(0).width());
}

TEST(MapOptions, SayWhatIsWrong) {
  MapOptions options;
  options.update_factor_free = 0.7;
  try {
    MultiMap map(options);
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_EQ("update_factor_free is 0.7, allowed is 0.001 to 0.499", std::string(e.what()));
  }
}

// Someone steps into a room whose middle was seen to be free, and stays or walks on.
TEST(MultiMap, WhatAppearsInFreeSpaceMustStayToBeKnown) {
  Scan empty = look(box({-3.0, -3.0}, {3.0, 3.0}), Pose::Zero(), Scanner{});
  Scan person = empty;
  std::vector<std::size_t> hidden;
  for (std::size_t i = 0; i < person.points.size(); ++i) {
    if (person.points[i].x() < 0.0f || std::abs(person.points[i].y()) > 0.3f) continue;
    person.points[i] *= 1.52f / person.points[i].x();
    hidden.push_back(i);
  }
  ASSERT_GT(hidden.size(), 10u);
  for (const double sure_free : {0.0, 0.3}) {
    MapOptions options;
    options.sure_free = sure_free;
    MultiMap map(options);
    for (int i = 0; i < 40; ++i) map.update(empty, Pose::Zero());
    const auto shown = [&] {
      std::size_t count = 0;
      for (const std::size_t i : hidden) {
        const GridMap::Cell& cell = *map.level(0).find(person.points[i].cast<double>());
        count += GridMap::isOccupied(cell);
        EXPECT_TRUE(GridMap::isOccupied(cell) || cell.reflectivity == 0.0f);
      }
      return static_cast<double>(count) / hidden.size();
    };
    for (int i = 0; i < 5; ++i) map.update(person, Pose::Zero());
    EXPECT_EQ(sure_free > 0.0 ? 0.0 : 1.0, shown());
    for (int i = 0; i < 40; ++i) map.update(person, Pose::Zero());
    EXPECT_EQ(1.0, shown());
  }
}

}  // namespace
}  // namespace intensity_hector_slam
