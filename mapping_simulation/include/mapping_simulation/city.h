// SPDX-License-Identifier: BSD-3-Clause
//
// A city whose streets are built alike, for the recognition of places: what tells them apart is what their
// houses, signs, roads and lawns reflect. Each place is visited by day and by night.
#pragma once

#include <mapping_simulation/world.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace mapping_simulation {

struct CityOptions {
  int places = 44;           ///< of four kinds of street in turn; those of a kind have the same shape
  int visits = 2;            ///< of each place, the first by day, the second by night and so on
  double shift = 3.0;        ///< m, the farthest that a visit is from the middle of its place
  std::uint32_t seed = 1;    ///< of all that is left to chance
  double occupancy = 0.5;    ///< of the parking lots, which are filled anew for each visit
  bool along = false;        ///< visits look along the road or back, within 10 degrees; false: anywhere
  bool by_day = false;       ///< all visits, not every other one alone
  bool random_order = true;  ///< of the visits; false: all places by day, then all by night
};

struct CityVisit {
  int place = 0, visit = 0;
  bool night = false;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< base_link -> map frame, on the road, level
};

/// Places are 200 m apart in the map, turned as the streets happen to run; visits look in any direction.
/// @throws std::invalid_argument where options are out of range
std::vector<CityVisit> cityVisits(const CityOptions& options);

/// Of the middle of a place, with x along its street, in the map frame.
Eigen::Isometry3d poseOfPlace(const CityOptions& options, int place);

/// The street of a visit in the map frame, 120 m of it, with the cars and people and the light of that time.
World cityAt(const CityOptions& options, const CityVisit& visit);

}  // namespace mapping_simulation
