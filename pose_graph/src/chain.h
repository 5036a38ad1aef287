// SPDX-License-Identifier: BSD-3-Clause
//
// Poses along chains of consecutive edges, how sure they are of each other, and what loops say about them.
#pragma once

#include <cstddef>

#include "pose_graph/graph.h"

namespace pose_graph {

/// Takes a small motion (translation, rotation vector), seen from the pose, to the frame that the pose is in.
Matrix6 adjoint(const Pose& pose);

/// Covariance from information, and back; in the plane of x, y and the turn about z alone. Where one is 0,
/// the other is large, not infinite.
Matrix6 inverseOf(const Matrix6& symmetric, bool planar);

/// The same measurement, seen from the other end.
Edge turned(const Edge& edge);

/// A pose by odometry alone.
struct ChainPose {
  std::size_t chain = 0, position = 0;  ///< which chain, and how many poses before on it
  Pose pose;                            ///< seen from the first of the chain
  /// The sum of all covariances up to here, seen from the first of the chain, so that the difference of two
  /// is what lies between them.
  Matrix6 covariance = Matrix6::Zero();

  /// The next one of the chain. @param step an edge from this one to it
  ChainPose then(const Edge& step, bool planar) const;
};

/// What a loop says about odometry: how far it moves one chain over the other, or a later part of a chain
/// over an earlier one. Two loops agree where they move it alike, but for the drift between them (Mangelson
/// et al., ICRA 2018).
class Shift {
 public:
  Shift(const Edge& loop, const ChainPose& from, const ChainPose& to, bool planar);

  /// Whether they are of the same chains. Others don't contradict each other.
  bool comparable(const Shift& other) const {
    return from_.chain == other.from_.chain && to_.chain == other.to_.chain;
  }
  /// chi2 of the cycle over both loops and odometry between their ends.
  double disagreement(const Shift& other) const;

 private:
  template <int N>
  double disagreement(const Shift& other) const;

  bool planar_;
  ChainPose from_, to_;
  Pose shift_, inverse_;
  Matrix6 covariance_, adjoint_;
};

}  // namespace pose_graph
