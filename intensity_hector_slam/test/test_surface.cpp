// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "../src/surface.h"
#include "flat_world.h"

namespace intensity_hector_slam {
namespace {

Scanner noisy() {
  Scanner scanner;
  scanner.range_noise = 0.005;
  scanner.reflectivity_noise = 0.02;
  return scanner;
}

TEST(Surface, NormalsAreThoseOfTheWalls) {
  const std::vector<Wall> wall = {{{-3.0, 2.0}, {3.0, 2.0}}};
  const Scan scan = look(wall, Pose::Zero(), noisy());
  const std::vector<SurfacePiece> pieces = surfacePieces(scan, 0.5);
  EXPECT_GE(pieces.size(), 9u);
  std::size_t next = 0;
  for (const SurfacePiece& piece : pieces) {
    EXPECT_EQ(next, piece.begin);
    next = piece.end;
    EXPECT_NEAR(2.0, piece.centre.y(), 0.005);
    EXPECT_NEAR(1.0, std::abs(piece.normal.y()), 0.001);
    EXPECT_LT(std::abs(piece.normal.x()), 4.0 * std::sqrt(piece.normal_variance) + 1e-3);
  }
  EXPECT_EQ(scan.points.size(), next);
}

TEST(Surface, NothingReachesOverBeamsWithoutReturn) {
  // Between the walls there is nothing: no piece says that there is a wall from one to the other.
  const std::vector<Wall> walls = {{{1.0, -1.0}, {9.0, -1.0}}, {{1.0, 1.0}, {9.0, 1.0}}};
  for (const SurfacePiece& piece : surfacePieces(look(walls, Pose::Zero(), noisy()), 0.5))
    EXPECT_NEAR(1.0, std::abs(piece.centre.y()), 0.05);
}

TEST(Surface, TextureIsWhatNoiseDoesNotExplain) {
  const auto meanTexture = [](const Wall& wall) {
    double sum = 0.0;
    int count = 0;
    for (unsigned seed = 1; seed <= 10; ++seed) {
      const Scan scan = look({wall}, Pose::Zero(), noisy(), seed);
      for (const SurfacePiece& piece : surfacePieces(scan, 0.5)) {
        if (std::isnan(texture(scan, piece))) continue;
        sum += texture(scan, piece);
        ++count;
      }
    }
    return sum / count;
  };
  EXPECT_NEAR(1.0, meanTexture({{-3.0, 2.0}, {3.0, 2.0}}), 0.5);
  EXPECT_GT(meanTexture(stripes({-3.0, 2.0}, {3.0, 2.0}, 3)), 20.0);
}

TEST(Surface, TextureIsUnknownWithoutReflectivityAndAtGrazingAngles) {
  const std::vector<Wall> wall = {stripes({0.5, 0.2}, {8.0, 0.2}, 3)};
  Scan scan = look(wall, Pose::Zero(), noisy());
  for (const SurfacePiece& piece : surfacePieces(scan, 0.5)) {
    if (piece.centre.x() > 3.0) {
      EXPECT_TRUE(std::isnan(texture(scan, piece)));
    }
  }
  scan.reflectivities.clear();
  for (const SurfacePiece& piece : surfacePieces(scan, 0.5)) EXPECT_TRUE(std::isnan(texture(scan, piece)));
}

TEST(Surface, FewPointsAreNone) {
  Scan scan;
  EXPECT_TRUE(surfacePieces(scan, 0.5).empty());
  scan.points = {{1.0f, 0.0f}, {1.0f, 0.1f}};
  EXPECT_TRUE(surfacePieces(scan, 0.5).empty());
  scan.points.assign(3, {1.0f, 0.0f});  // a single place
  for (const SurfacePiece& piece : surfacePieces(scan, 0.5)) EXPECT_TRUE(piece.normal.allFinite());
}

}  // namespace
}  // namespace intensity_hector_slam
