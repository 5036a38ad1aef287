// SPDX-License-Identifier: BSD-3-Clause
//
// What SLAM is started with, and how each changes the result.
#pragma once

#include <mapping_common/options.h>

#include <memory>
#include <string>

namespace intensity_hector_slam {

struct MapOptions {
  double resolution = 0.025;
  int levels = 3;
  int size = 1024;
  double start_x = 0.5, start_y = 0.5;
  bool grow = true;
  double max_size = 400.0;
  double update_factor_free = 0.48, update_factor_occupied = 0.7;
  double clear_margin = 0.2;
  double sure_free = 0.3;
  double min_probability = 0.02, max_probability = 0.98;
  int max_count = 1000;

  void describe(mapping_common::OptionList& o) {
    o("map_resolution", resolution, "m",
      "edge of a cell of the finest level. Coarser is faster and forgives sparse scanners")
        .within(0.001, 10.0);
    o("map_size", size, "",
      "cells of the finest level along each side, at the start; what comes out doesn't depend on it")
        .within(2, 32768);
    o("map_start_x", start_x, "", "where the origin of map_frame is in the map, from left to right")
        .within(0.0, 1.0);
    o("map_start_y", start_y, "", "the same from below to above").within(0.0, 1.0);
    o("map_grow", grow, "", "true: the map grows with what is seen; false: what is outside is ignored");
    o("max_size", max_size, "m", "longest side that the map grows to, if it isn't larger from the start")
        .above(0.0)
        .atMost(1e5);
    o("map_multi_res_levels", levels, "",
      "grids, each with cells twice as large as the one before: more forgive larger motions, but cells of "
      "more than "
      "0.2 m blur rooms")
        .within(1, 10);
    o("update_factor_free", update_factor_free, "",
      "P(g | z), the probability of a cell that a beam crosses: lower clears sooner, but wears walls away "
      "that are "
      "seen at grazing angles")
        .within(0.001, 0.499);
    o("update_factor_occupied", update_factor_occupied, "",
      "the same of a cell that a beam ends in: higher settles sooner")
        .within(0.501, 0.999);
    o("clear_margin", clear_margin, "m",
      "the last part of a beam, which clears unknown cells alone: a wall seen at a grazing angle lies along "
      "it, and "
      "would wear away between the few beams that hit it, so that loops don't close")
        .within(0.0, 1000.0);
    o("sure_free", sure_free, "",
      "occupancy below which a cell of the coarsest level is surely free: what appears there, away from all "
      "that is "
      "occupied, counts as 1 - update_factor_free, so that it gets into the map only where it stays. 0: at "
      "once")
        .within(0.0, 0.5);
    o("min_probability", min_probability, "",
      "occupancy stays in these bounds, so that what comes and goes is noticed soon")
        .within(0.0001, 0.499);
    o("max_probability", max_probability, "", "the upper one").within(0.501, 0.9999);
    o("max_count", max_count, "",
      "observations that the mean reflectivity of a cell goes over; then the latest count 1 / max_count")
        .within(1, 65535);
    o.require(levels < 1 || levels > 10 || size >= 2 << levels, "map_size",
              "at least two cells of the coarsest level");
  }
};

class Cost;
struct MatcherOptions;
using MakeCost = std::unique_ptr<Cost> (*)(const MatcherOptions& options);
/// What a pose can minimise the squares of, for beams i with the end points S_i, by the names that
/// MatcherOptions::cost has for it.
const mapping_common::Table<MakeCost>& costs();

/// Weight of a residual e against moving objects, with the scale s.
enum class RobustKernel { kNone, kHuber, kCauchy, kTukey };
constexpr auto choicesOf(RobustKernel) {
  return mapping_common::choices<RobustKernel>(
      {{"none", RobustKernel::kNone, "1"},
       {"huber", RobustKernel::kHuber, "s / |e| beyond s"},
       {"cauchy", RobustKernel::kCauchy, "1 / (1 + (e / s)^2)"},
       {"tukey", RobustKernel::kTukey, "(1 - (e / s)^2)^2, 0 beyond s"}});
}

/// When a window around the first guess is searched for the best start of the iterations.
enum class Search { kNever, kWhenUnsure, kAlways };
constexpr auto choicesOf(Search) {
  return mapping_common::choices<Search>(
      {{"never", Search::kNever, "not at all"},
       {"when_unsure", Search::kWhenUnsure,
        "without odometry and with scans search_gap apart, after a way or turn beyond search_motion, at the "
        "start, "
        "after a pause, or where a match is rejected or, once per update of the map, contradicts it"},
       {"always", Search::kAlways, "for each scan"}});
}

struct MatcherOptions {
  std::string cost = "combined";  ///< a name of costs()
  double occupancy_weight = 1.0, reflectivity_weight = 0.1;
  double auto_max_spacing = 0.1, auto_min_known = 0.3;
  RobustKernel robust_kernel = RobustKernel::kCauchy;
  double robust_scale = 0.5, robust_scale_reflectivity = 0.1;
  int max_iterations = 12, max_halvings = 3;
  double max_step_distance = 0.1, max_step_angle = 0.1;
  double min_step_distance = 2e-4, min_step_angle = 1e-4;
  double coarse_step = 0.05;
  double min_cost_change = 3e-4;
  double coarse_spacing = 0.75;
  int coarse_points = 250;

  Search search = Search::kWhenUnsure;
  double search_gap = 0.09;
  double search_motion_distance = 0.3, search_motion_angle = 0.2;
  double search_contradiction = 0.2, search_min_gain = 0.25;
  double search_distance = 0.3, search_angle = 0.35;
  double search_prior = 0.05;
  int search_points = 200;
  double near_distance = 0.05, new_margin = 0.3;

  double surface_length = 0.6, surface_noise = 0.02;
  double min_observability = 0.002, min_texture = 10.0, min_geometry = 0.02;
  double covariance_scale = 0.8, covariance_floor = 0.1;
  double unobservable_distance = 1.0, unobservable_angle = 0.5;

  void describe(mapping_common::OptionList& o) {
    o("cost", cost, "", "what a pose minimises the squares of").oneOf(costs()).dynamic();
    o("occupancy_weight", occupancy_weight, "", "combined: of the squared residuals of the occupancy")
        .within(0.0, 1e6)
        .dynamic();
    o("reflectivity_weight", reflectivity_weight, "",
      "combined: of those of the reflectivity, beyond the ratio of the variances of both, which is found "
      "from the "
      "residuals. Less than 1, as errors of neighbouring reflectivities aren't independent")
        .within(0.0, 1e6)
        .dynamic();
    o("auto_max_spacing", auto_max_spacing, "m",
      "auto: with the median distance of neighbouring points beyond, reflectivity has no good normals, and "
      "is used "
      "only where occupancy leaves a direction open")
        .within(0.0, 1000.0);
    o("auto_min_known", auto_min_known, "", "auto: share of points with known reflectivity for it to be used")
        .within(0.0, 1.0);
    o("robust_kernel", robust_kernel, "",
      "weight of a residual e against moving objects, with s = robust_scale")
        .dynamic();
    o("robust_scale", robust_scale, "", "residuals of the occupancy beyond count less; they are 0 to 1")
        .within(0.001, 1000.0)
        .dynamic();
    o("robust_scale_reflectivity", robust_scale_reflectivity, "", "the same of the reflectivity")
        .within(0.001, 1000.0)
        .dynamic();
    o("max_iterations", max_iterations, "", "of Gauss-Newton on each level").within(1, 1000);
    o("max_halvings", max_halvings, "",
      "of a step that doesn't lower the cost; 0: each step is taken, as in Hector SLAM")
        .within(0, 20);
    o("max_step_distance", max_step_distance, "m", "of one iteration").within(0.0001, 100.0);
    o("max_step_angle", max_step_angle, "rad", "of one iteration").within(0.0001, 3.15);
    o("min_step_distance", min_step_distance, "m", "an iteration that moves less ...").atLeast(0.0);
    o("min_step_angle", min_step_angle, "rad", "and turns less is the last").atLeast(0.0);
    o("coarse_step", coarse_step, "cells",
      "an iteration that moves less is the last on all levels but the finest")
        .within(0.0, 1.0);
    o("min_cost_change", min_cost_change, "", "of the cost, an iteration that lowers it by less is the last")
        .within(0.0, 1.0);
    o("coarse_spacing", coarse_spacing, "cells",
      "of the finest level: on all others, neighbouring points within this count as one, so that people near "
      "by, who "
      "get the most beams, don't hold the pose more than the walls. 0: each counts")
        .within(0.0, 100.0);
    o("coarse_points", coarse_points, "", "of those, 1 / 2^k are used on level k > 0, but no fewer than this")
        .within(1, 1e6);
    o("search", search, "", "whether the coarsest level is searched around the first guess before").dynamic();
    o("search_gap", search_gap, "s", "between scans").atLeast(0.0);
    o("search_motion_distance", search_motion_distance, "m", "between scans, by the first guess")
        .atLeast(0.0);
    o("search_motion_angle", search_motion_angle, "rad", "the same").atLeast(0.0);
    o("search_contradiction", search_contradiction, "",
      "share of points in free space; the search is repeated once per way or turn beyond map_update_*_thresh")
        .within(0.0, 1.0);
    o("search_min_gain", search_min_gain, "",
      "what it must gain in points on what is occupied less points in free space (shares)")
        .within(0.0, 2.0);
    o("search_distance", search_distance, "m", "half the width of the window").within(0.0, 100.0);
    o("search_angle", search_angle, "rad", "half its range of angles").within(0.0, 3.15);
    o("search_prior", search_prior, "",
      "by which the mean square of the residuals must be less at the border of the window, along one side or "
      "turned, than at the guess, and the less the nearer to it")
        .within(0.0, 10.0);
    o("search_points", search_points, "", "of the scan, evenly spread: more take more time").within(1, 1e6);

    o("near_distance", near_distance, "m",
      "a scan within search_gap of the last that fits to the map at the first guess is matched on the finest "
      "level alone, if that moves the guess by less: on coarser ones a wall's other side is the wall. 0: "
      "coarse to fine, always")
        .atLeast(0.0);
    o("new_margin", new_margin, "m",
      "the same scans, without odometry: points so far behind what the map knows on their beams have just "
      "come into view, aren't in the map, and aren't matched. 0: all are")
        .atLeast(0.0);

    o.section("what isn't known");
    o("surface_length", surface_length, "m",
      "of lines through neighbouring points, by which a scan is judged: the matcher's H holds the noise of "
      "the grid, "
      "too")
        .within(0.001, 100.0);
    o("surface_noise", surface_noise, "m",
      "standard deviation of points from even surfaces, by which a pose without odometry is the surer of a "
      "direction "
      "the more of them face it")
        .within(0.0, 10.0);
    o("min_observability", min_observability, "",
      "where their normals tell less in some direction than this share of what they tell in the best (angles "
      "times the "
      "scan's mean range), occupancy doesn't observe the pose there. 0: it always does, as in Hector SLAM")
        .within(0.0, 1.0);
    o("min_texture", min_texture, "",
      "where reflectivity's slopes along them differ from what noise alone would give by less than this, in "
      "standard deviations of all of them together, reflectivity doesn't, either: the pose stays where the "
      "first "
      "guess is")
        .within(0.0, 1e9);
    o("min_geometry", min_geometry, "",
      "as min_observability, where there is texture: reflectivity alone tells there")
        .within(0.0, 1.0);
    o("covariance_scale", covariance_scale, "",
      "factor on the covariance that follows from how unevenly the pieces of a scan pull at its pose")
        .within(0.001, 1e6);
    o("covariance_floor", covariance_floor, "cells",
      "of the finest level: standard deviation by what the grid makes of surfaces along its lines, at the "
      "scan's mean range for the angle; noise of the points blurs it away")
        .within(1e-4, 1000.0);
    o("unobservable_distance", unobservable_distance, "m",
      "standard deviation in a direction that isn't observable")
        .within(0.001, 1e6);
    o("unobservable_angle", unobservable_angle, "rad", "and of an angle").within(0.001, 1000.0);
    o.require(occupancy_weight + reflectivity_weight >= 1e-6, "occupancy_weight",
              "more than 0, or reflectivity_weight is");
    o.require(min_step_distance <= max_step_distance, "min_step_distance", "0 to max_step_distance");
    o.require(min_step_angle <= max_step_angle, "min_step_angle", "0 to max_step_angle");
  }
};

/// Of the search of a scan in all of the map, or a large part of it.
struct SearchOptions {
  double cell = 0.1;
  int points = 150, min_points = 40;
  double reflectivity_share = 0.6, reflectivity_scale = 0.3;
  double min_score = 0.6, min_agreement = 0.82, min_agreement_around = 0.6, min_lead = 0.06;
  double apart_distance = 0.7, apart_angle = 0.35;

  void describe(mapping_common::OptionList& o) {
    o("place_search_cell", cell, "m",
      "the coarsest level whose cells aren't larger is searched: finer takes more time")
        .within(0.001, 10.0);
    o("place_search_points", points, "", "of the scan, evenly spread").within(3, 1e6);
    o("place_min_points", min_points, "",
      "that a scan has at least, place_search_cell apart: a corner or a wall alone is in many places")
        .within(0, 1e6);
    o("place_reflectivity_share", reflectivity_share, "",
      "of a point's score, that a difference of place_reflectivity_scale or more from the map's takes")
        .within(0.0, 1.0);
    o("place_reflectivity_scale", reflectivity_scale, "", "see place_reflectivity_share")
        .within(0.001, 1000.0);
    o("place_min_score", min_score, "",
      "mean over the points, 1 for those on what is occupied, half beside: poses on the grid with less "
      "aren't looked at")
        .within(0.0, 1.0);
    o("place_min_agreement", min_agreement, "",
      "share of the beams that end on what is occupied, less that of those that end where it is free or "
      "cross what is occupied, less for reflectivities as above: a place has this at least")
        .within(0.0, 1.0);
    o("place_min_agreement_around", min_agreement_around, "",
      "the same where a place is sought around a pose, as of loops and after a rejected scan: the map may "
      "lack a part of what the scan sees")
        .within(0.0, 1.0);
    o("place_min_lead", min_lead, "",
      "by which the agreement of a place must be above that of any other; with less it is ambiguous")
        .within(0.0, 1.0);
    o("place_apart_distance", apart_distance, "m", "places this far from each other are two").atLeast(0.0);
    o("place_apart_angle", apart_angle, "rad", "or turned by this").within(0.0, 3.15);
  }
};

/// Of the search for loops among key poses.
struct LoopOptions {
  double max_distance = 10.0, max_angle = 0.7;
  double min_travel = 10.0, spacing = 2.5;
  double submap_length = 10.0, resolution = 0.05;
  double sure_distance = 0.5, confirmation = 0.7;
  double sigma_distance = 0.02, sigma_angle = 0.005;
  double memory = 200.0;

  void describe(mapping_common::OptionList& o) {
    o("loop_max_distance", max_distance, "m",
      "half the width of the region that is searched, at most: larger takes more time, and more places look "
      "alike")
        .within(0.0, 1000.0);
    o("loop_max_angle", max_angle, "rad", "and half its range of angles").within(0.0, 3.15);
    o("loop_min_travel", min_travel, "m",
      "travelled between the key poses of a loop; turns count half a metre for each rad. No less than "
      "loop_submap_length")
        .within(0.1, 1e6);
    o("loop_spacing", spacing, "m",
      "travelled from a loop to the next; behind a jump of the pose one is sought at once")
        .within(0.0, 1e6);
    o("loop_submap_length", submap_length, "m",
      "travelled by the key scans that make the map in which a scan is sought")
        .within(0.1, 1000.0);
    o("loop_resolution", resolution, "m", "of that map, or map_resolution where that is coarser")
        .within(0.001, 10.0);
    o("loop_sure_distance", sure_distance, "m",
      "in a region up to this half width, a sure place is a loop; in a larger one, once it is confirmed")
        .atLeast(0.0);
    o("loop_confirmation", confirmation, "m", "travelled between the places that confirm each other")
        .atLeast(0.0);
    o("loop_sigma_distance", sigma_distance, "m",
      "standard deviation of a loop's transform, beyond the match's: of the map of key scans")
        .within(1e-6, 10.0);
    o("loop_sigma_angle", sigma_angle, "rad", "the same of the angle").within(1e-6, 1.0);
    o("loop_memory", memory, "MB", "for key scans; beyond it, the oldest are forgotten")
        .above(0.0)
        .atMost(1e6);
    o.require(min_travel >= submap_length, "loop_min_travel", "loop_submap_length or more");
  }
};

/// Where the iterations start.
enum class Guess { kLastPose, kConstantVelocity, kOdometry };
constexpr auto choicesOf(Guess) {
  return mapping_common::choices<Guess>(
      {{"last_pose", Guess::kLastPose, "the body stands"},
       {"constant_velocity", Guess::kConstantVelocity, "that of the last two poses"},
       {"odometry", Guess::kOdometry, "moves the last pose on; without any, constant velocity"}});
}

struct SlamOptions {
  MapOptions map;
  MatcherOptions matcher;
  bool localization = false;
  double update_distance = 0.4, update_angle = 0.9, update_period = 0.5;
  bool deskew = true;
  int min_points = 20;
  Guess guess = Guess::kOdometry;
  double max_contradiction = 0.6;
  double max_correction_distance = 0.5, max_correction_angle = 0.7;
  double max_speed = 5.0, max_turn_rate = 10.0;
  double max_acceleration = 5.0, max_angular_acceleration = 15.0;
  double acceleration_noise = 0.5, angular_acceleration_noise = 2.0;
  double max_gap = 1.0;
  bool relocalize = true;
  SearchOptions place;

  void describe(mapping_common::OptionList& o) {
    o.section("map");
    map.describe(o);
    o("map_update_distance_thresh", update_distance, "m", "travelled before another scan goes into the map")
        .within(0.0, 1000.0)
        .dynamic();
    o("map_update_angle_thresh", update_angle, "rad", "or turned").within(0.0, 1000.0).dynamic();
    o("map_update_period", update_period, "s",
      "or that went by: what moves on doesn't stay in the map of a robot that stands")
        .atLeast(0.0);
    o("localization", localization, "", "true: the map stays as it is. At the start it needs a map_file")
        .dynamic();
    o.section("matching");
    o("deskew", deskew, "", "true: points are moved to where they are seen from at the scan's stamp");
    o("min_points", min_points, "", "a scan with fewer points is empty").within(3, 1e6);
    o("guess", guess, "", "where the iterations start");
    matcher.describe(o);
    o("max_contradiction", max_contradiction, "",
      "share of points in free space beyond which a match is rejected")
        .within(0.0, 1.0)
        .dynamic();
    o("max_correction_distance", max_correction_distance, "m",
      "by which a match may differ from the first guess")
        .atLeast(0.0);
    o("max_correction_angle", max_correction_angle, "rad", "the same").within(0.0, 6.3);
    o("max_speed", max_speed, "m/s",
      "odometry that moves faster may have jumped. Neither it nor one that moves by more than half of the "
      "search "
      "window is the first guess for a scan that fits to the map better by search_min_gain without")
        .atLeast(0.001);
    o("max_turn_rate", max_turn_rate, "rad/s", "or turns faster").atLeast(0.001);
    o("max_acceleration", max_acceleration, "m/s^2",
      "by which the velocity of the first guess changes at most: a pose that jumps doesn't lead away")
        .atLeast(0.001);
    o("max_angular_acceleration", max_angular_acceleration, "rad/s^2", "the same").atLeast(0.001);
    o("acceleration_noise", acceleration_noise, "m/s",
      "without odometry: by which the velocity changes in a second, at random, on wheels or carried. Less "
      "believes more "
      "in a steady motion where a scan tells little")
        .within(0.001, 1000.0);
    o("angular_acceleration_noise", angular_acceleration_noise, "rad/s", "the same of the rate of turn")
        .within(0.001, 1000.0);
    o("max_gap", max_gap, "s", "between scans; longer is a pause, over which no velocity holds").atLeast(0.0);
    o.section("places");
    o("relocalize", relocalize, "",
      "true: a scan after one that was rejected is sought where the body may be by odometry; without "
      "odometry, "
      "after more than max_gap blind or rejected, by max_speed and max_turn_rate; at last in all of the map. "
      "Only a "
      "place that is sure is gone on from")
        .dynamic();
    place.describe(o);
  }
};

}  // namespace intensity_hector_slam
