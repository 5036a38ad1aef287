// SPDX-License-Identifier: BSD-3-Clause
//
// A street between two rows of random houses, and people who walk there.
#pragma once

#include "scene.h"

namespace ibuild_loop_closure {

constexpr double kStreetLeft = 5.5, kStreetRight = -6.5;  ///< y of the house fronts, m

/// The street goes along x from 0 to `length` (m), z is up, the ground is z = 0.
/// @return the house fronts on the left, those on the right, the ground, the house at the end
std::vector<Surface> makeStreet(double length, cv::RNG& random);

/// A person, seen along x, who stands at (x, y).
Surface makePerson(double x, double y, cv::RNG& random);

}  // namespace ibuild_loop_closure
