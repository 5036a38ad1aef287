// SPDX-License-Identifier: BSD-3-Clause
//
// What a pose minimises. A cost is a class with its residual and its weight in a header of costs/, and a row
// of the table in cost.cpp. Parameters, command lines, documents and tests know it from there.
#pragma once

#include <memory>
#include <string>

#include "intensity_hector_slam/beams.h"
#include "intensity_hector_slam/grid_map.h"
#include "intensity_hector_slam/scan_matcher.h"

namespace intensity_hector_slam {

/// Calls are few, one for each iteration on a level; loops over beams are below them: see CostOf.
class Cost {
 public:
  virtual ~Cost() = default;

  /// Its name in costs().
  const std::string& name() const { return name_; }
  /// Whether it has residuals of that channel.
  virtual bool uses(Channel channel) const = 0;
  /// What a scan is matched by: this cost, or another one that suits the scan and the map better.
  /// @param map the coarsest level
  virtual const Cost& choose(const GridMap& /*map*/, const Scan& /*scan*/, const Beams& /*beams*/,
                             const Pose& /*guess*/) const {
    return *this;
  }
  /// The residuals of this cost that tell where surfaces are, alone; this, where there are no others.
  virtual const Cost& geometry() const { return *this; }
  /// Over the beams from one, a multiple of kLanes, up to another.
  virtual Linearization linearize(const GridMap& map, const Beams& beams, const Pose& pose, std::size_t end,
                                  std::size_t begin = 0) const = 0;
  /// The best of the poses around a guess, see searchWindow.
  virtual Pose search(const GridMap& map, const Beams& beams, const Pose& guess) const = 0;

 private:
  friend std::shared_ptr<const Cost> makeCost(const std::string& name, const MatcherOptions& options);
  std::string name_;
};

/// @throws std::invalid_argument if costs() has none of that name
std::shared_ptr<const Cost> makeCost(const std::string& name, const MatcherOptions& options);

}  // namespace intensity_hector_slam
