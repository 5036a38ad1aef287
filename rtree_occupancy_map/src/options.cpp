// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/options.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace rtree_occupancy_map {
namespace {

[[noreturn]] void reject(const std::string& name, const std::string& value, const std::string& allowed) {
  throw std::invalid_argument(name + " is " + value + ", allowed is " + allowed);
}

void require(bool holds, const std::string& name, double value, const std::string& allowed) {
  if (holds) return;
  std::ostringstream text;
  text << value;
  reject(name, text.str(), allowed);
}

template <class Enum>
Enum parse(const std::string& parameter, const std::string& name,
           std::initializer_list<std::pair<const char*, Enum>> choices) {
  std::string allowed;
  for (const auto& [choice, value] : choices) {
    if (name == choice) return value;
    allowed += allowed.empty() ? choice : std::string(" | ") + choice;
  }
  reject(parameter, "'" + name + "'", allowed);
}

}  // namespace

void Options::validate() const {
  require(resolution > 0.0 && std::isfinite(resolution), "resolution", resolution, "more than 0 m");
  require(prob_hit >= 0.5 && prob_hit < 1.0, "prob_hit", prob_hit, "0.5 to below 1");
  require(prob_miss > 0.0 && prob_miss <= 0.5, "prob_miss", prob_miss, "above 0 to 0.5");
  require(clamping_min > 0.0 && clamping_min < 0.5, "clamping_min", clamping_min, "above 0 to below 0.5");
  require(clamping_max > 0.5 && clamping_max < 1.0, "clamping_max", clamping_max, "above 0.5 to below 1");
  require(prior >= prob_miss && prior <= prob_hit && prior > clamping_min && prior < clamping_max, "prior",
          prior, "prob_miss to prob_hit, between the clamping thresholds");
  require(occupancy_threshold > clamping_min && occupancy_threshold < clamping_max, "occupancy_threshold",
          occupancy_threshold, "between the clamping thresholds");
  require(min_range >= 0.0, "min_range", min_range, "0 m or more");
  require(max_range > min_range, "max_range", max_range, "more than min_range");
  require(samples_per_metre >= 0.0 && samples_per_metre <= 1000.0, "samples_per_metre", samples_per_metre,
          "0 to 1000");
  std::string sorted = search_order;
  std::sort(sorted.begin(), sorted.end());
  if (sorted != "xyz") reject("search_order", "'" + search_order + "'", "a permutation of xyz");
  tree.validate();
}

SensorModel parseSensorModel(const std::string& name) {
  return parse<SensorModel>("sensor_model", name,
                            {{"beam", SensorModel::kBeam}, {"endpoint", SensorModel::kEndPoint}});
}

FusionRule parseFusionRule(const std::string& name) {
  return parse<FusionRule>("fusion_rule", name,
                           {{"thesis", FusionRule::kThesis}, {"equal", FusionRule::kEqualValue}});
}

FusionStrategy parseFusionStrategy(const std::string& name) {
  return parse<FusionStrategy>("fusion_strategy", name,
                               {{"block", FusionStrategy::kBlock},
                                {"expansion", FusionStrategy::kExpansion},
                                {"none", FusionStrategy::kNone}});
}

SplitMethod parseSplitMethod(const std::string& name) {
  return parse<SplitMethod>("split", name,
                            {{"quadratic", SplitMethod::kQuadratic},
                             {"linear", SplitMethod::kLinear},
                             {"rstar", SplitMethod::kRStar}});
}

}  // namespace rtree_occupancy_map
