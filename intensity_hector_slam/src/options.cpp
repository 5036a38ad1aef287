// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/options.h"

#include <cmath>
#include <initializer_list>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace intensity_hector_slam {
namespace {

// Throws unless the value is in [min, max].
void require(const char* name, double value, double min, double max) {
  if (value >= min && value <= max) return;
  std::ostringstream text;
  text << name << " is " << value << ", allowed is " << min << " to " << max;
  throw std::invalid_argument(text.str());
}

template <class Enum>
using Names = std::initializer_list<std::pair<const char*, Enum>>;

template <class Enum>
Enum parse(const char* option, const std::string& name, Names<Enum> choices) {
  std::string allowed;
  for (const auto& [choice, value] : choices) {
    if (name == choice) return value;
    allowed += (allowed.empty() ? "" : " | ") + std::string(choice);
  }
  throw std::invalid_argument(std::string(option) + " is '" + name + "', allowed is " + allowed);
}

constexpr Names<Cost> kCosts = {{"occupancy", Cost::kOccupancy},
                                {"reflectivity", Cost::kReflectivity},
                                {"combined", Cost::kCombined},
                                {"auto", Cost::kAuto}};

}  // namespace

void MapOptions::validate() const {
  require("map_resolution", resolution, 0.001, 10.0);
  require("map_multi_res_levels", levels, 1, 10);
  require("max_size", max_size, 2.0 * resolution * (1 << levels), 1e5);
  require("size_x", size_x, 2.0 * resolution * (1 << levels), max_size);
  require("size_y", size_y, 2.0 * resolution * (1 << levels), max_size);
  require("map_start_x", start_x, 0.0, 1.0);
  require("map_start_y", start_y, 0.0, 1.0);
  require("update_factor_free", update_factor_free, 0.001, 0.499);
  require("update_factor_occupied", update_factor_occupied, 0.501, 0.999);
  require("clear_margin", clear_margin, 0.0, 1e3);
  require("sure_free", sure_free, 0.0, 0.5);
  require("min_probability", min_probability, 0.0001, 0.499);
  require("max_probability", max_probability, 0.501, 0.9999);
  require("max_count", max_count, 1, 65535);
}

void MatcherOptions::validate() const {
  require("occupancy_weight", occupancy_weight, 0.0, 1e6);
  require("reflectivity_weight", reflectivity_weight, 0.0, 1e6);
  require("the sum of occupancy_weight and reflectivity_weight", occupancy_weight + reflectivity_weight, 1e-6,
          2e6);
  require("robust_scale", robust_scale, 1e-3, 1e3);
  require("max_iterations", max_iterations, 1, 1000);
  require("max_halvings", max_halvings, 0, 20);
  require("max_step_distance", max_step_distance, 1e-4, 100.0);
  require("max_step_angle", max_step_angle, 1e-4, M_PI);
  require("min_step_distance", min_step_distance, 0.0, max_step_distance);
  require("min_step_angle", min_step_angle, 0.0, max_step_angle);
  require("coarse_step", coarse_step, 0.0, 1.0);
  require("coarse_spacing", coarse_spacing, 0.0, 100.0);
  require("min_cost_change", min_cost_change, 0.0, 1.0);
  require("coarse_points", coarse_points, 1, 1e6);
  require("surface_length", surface_length, 1e-3, 100.0);
  require("min_observability", min_observability, 0.0, 1.0);
  require("min_texture", min_texture, 0.0, 1e9);
  require("min_geometry", min_geometry, 0.0, 1.0);
  require("auto_max_spacing", auto_max_spacing, 0.0, 1e3);
  require("auto_min_known", auto_min_known, 0.0, 1.0);
  require("sigma", sigma, 0.0, 1e3);
  require("covariance_scale", covariance_scale, 1e-3, 1e6);
  require("covariance_floor", covariance_floor, 0.0, 1e3);
  require("unobservable_distance", unobservable_distance, 1e-3, 1e6);
  require("unobservable_angle", unobservable_angle, 1e-3, 1e3);
  require("search_gap", search_gap, 0.0, 1e9);
  require("search_motion_distance", search_motion_distance, 0.0, 1e9);
  require("search_motion_angle", search_motion_angle, 0.0, 1e9);
  require("search_contradiction", search_contradiction, 0.0, 1.0);
  require("search_min_gain", search_min_gain, 0.0, 2.0);
  require("search_distance", search_distance, 0.0, 100.0);
  require("search_angle", search_angle, 0.0, M_PI);
  require("search_points", search_points, 1, 1e6);
}

void SlamOptions::validate() const {
  map.validate();
  matcher.validate();
  require("map_update_distance_thresh", update_distance, 0.0, 1e3);
  require("map_update_angle_thresh", update_angle, 0.0, 1e3);
  require("map_update_period", update_period, 0.0, 1e9);
  require("min_points", min_points, 3, 1e6);
  require("max_contradiction", max_contradiction, 0.0, 1.0);
  require("max_correction_distance", max_correction_distance, 0.0, 1e6);
  require("max_correction_angle", max_correction_angle, 0.0, 2.0 * M_PI);
  require("max_speed", max_speed, 1e-3, 1e9);
  require("max_turn_rate", max_turn_rate, 1e-3, 1e9);
  require("max_acceleration", max_acceleration, 1e-3, 1e9);
  require("max_angular_acceleration", max_angular_acceleration, 1e-3, 1e9);
  require("max_gap", max_gap, 0.0, 1e9);
}

Cost parseCost(const std::string& name) {
  return parse("cost", name, kCosts);
}

RobustKernel parseRobustKernel(const std::string& name) {
  return parse<RobustKernel>("robust_kernel", name,
                             {{"none", RobustKernel::kNone},
                              {"huber", RobustKernel::kHuber},
                              {"cauchy", RobustKernel::kCauchy},
                              {"tukey", RobustKernel::kTukey}});
}

Search parseSearch(const std::string& name) {
  return parse<Search>(
      "search", name,
      {{"never", Search::kNever}, {"when_unsure", Search::kWhenUnsure}, {"always", Search::kAlways}});
}

Guess parseGuess(const std::string& name) {
  return parse<Guess>("guess", name,
                      {{"last_pose", Guess::kLastPose},
                       {"constant_velocity", Guess::kConstantVelocity},
                       {"odometry", Guess::kOdometry}});
}

std::string toString(Cost cost) {
  for (const auto& [name, value] : kCosts) {
    if (value == cost) return name;
  }
  return "";
}

}  // namespace intensity_hector_slam
