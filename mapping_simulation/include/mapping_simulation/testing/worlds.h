// SPDX-License-Identifier: BSD-3-Clause
//
// For tests: shapes in one line, and what a call throws.
#pragma once

#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>
#include <mapping_simulation/world.h>

#include <exception>
#include <string>

namespace mapping_simulation {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

/// Expects `call` to throw something whose message contains `part`.
template <typename Call>
void expectError(Call call, const std::string& part) {
  try {
    call();
    ADD_FAILURE() << "no exception; expected: " << part;
  } catch (const std::exception& e) {
    EXPECT_NE(std::string(e.what()).find(part), std::string::npos)
        << "expected: " << part << "\nis: " << e.what();
  }
}

/// A world or sensor of this package, for the tests of any package of the workspace.
inline std::string configFile(const std::string& name) {
  return PACKAGE_DIR "/../mapping_simulation/config/" + name;
}

inline Shape makeShape(Shape::Type type, const Eigen::Vector3d& size,
                       const Eigen::Isometry3d& pose = Eigen::Isometry3d::Identity(),
                       double reflectivity = 0.5) {
  Shape shape;
  shape.type = type;
  shape.size = size;
  shape.pose = pose;
  shape.texture.values = {reflectivity};
  return shape;
}

inline Eigen::Isometry3d makePose(double x, double y, double z, double yaw = 0.0) {
  return Eigen::Translation3d(x, y, z) * Eigen::Isometry3d(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
}

}  // namespace mapping_simulation
