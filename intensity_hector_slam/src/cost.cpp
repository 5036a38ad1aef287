// SPDX-License-Identifier: BSD-3-Clause
#include "cost.h"

#include "costs/auto.h"
#include "costs/occupancy.h"
#include "costs/reflectivity.h"

namespace intensity_hector_slam {
namespace {

template <class T>
std::unique_ptr<Cost> make(const MatcherOptions& options) {
  return std::make_unique<T>(options);
}

}  // namespace

const mapping_common::Table<MakeCost>& costs() {
  static const mapping_common::Table<MakeCost> table{
      {"occupancy", make<CostOf<Occupancy>>, "1 - M(S_i), Hector SLAM's"},
      {"reflectivity", make<CostOf<Hits, Reflectivity>>, "rho_i - R(S_i), Eq. 3.6"},
      {"combined", make<CostOf<Occupancy, Reflectivity>>, "both, weighted"},
      {"auto", make<AutoCost>, "occupancy where reflectivity is unknown or too sparse, else both"}};
  return table;
}

std::shared_ptr<const Cost> makeCost(const std::string& name, const MatcherOptions& options) {
  const std::shared_ptr<Cost> cost = mapping_common::valueOf(costs(), name)(options);
  cost->name_ = name;
  return cost;
}

}  // namespace intensity_hector_slam
