// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/appearance.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "chain.h"
#include "pose_graph/maps.h"
#include "pose_graph/trajectory.h"

namespace pose_graph {
namespace {

namespace slam = intensity_hector_slam;

constexpr int kRows[] = {0, 1, 5};  // of x, y and the angle about z in six dimensions

slam::Pose planar(const Pose& pose) {
  return {pose.translation.x(), pose.translation.y(), pose.yaw()};
}

// Seeks the scan of `to` in a map of the scans around `from`.
ScanMatch matchOneWay(const Session& session, const Graph& graph, std::int64_t from, std::int64_t to,
                      const std::optional<Matrix6>& drift, const slam::SlamOptions& options,
                      const slam::LoopOptions& loop, const AppearanceOptions& appearance) {
  ScanMatch result;
  const auto from_node = graph.find(from), to_node = graph.find(to);
  const std::vector<KeyData> sought = session.dataAt(to, DataKind::kScan);
  if (!from_node || !to_node || sought.empty()) {
    result.why = "there is no scan at one of the poses";
    return result;
  }
  // Neighbours in time: what is near by the graph alone may have come there by a wrong loop, and the scans
  // around the pose that is sought must not be in it.
  const Pose origin = graph.nodes()[*from_node].pose;
  const Pose to_origin = origin.inverse();
  slam::SlamOptions of_map = options;
  of_map.update_distance = of_map.update_angle = of_map.update_period = 0.0;
  of_map.localization = false;
  slam::Slam map(of_map);
  const auto reach = static_cast<std::size_t>(appearance.scans) / 2;
  const std::size_t first = *from_node - std::min(*from_node, reach),
                    last = std::min(*from_node + reach, graph.nodes().size() - 1);
  int scans = 0;
  for (std::size_t i = first; i <= last; ++i) {
    if (i + reach >= *to_node && *to_node + reach >= i) continue;
    for (const KeyData& data : session.dataAt(graph.nodes()[i].id, DataKind::kScan)) {
      const Pose pose = to_origin * graph.nodes()[i].pose * data.sensor;
      map.insert(toScan(data), planar(pose));
      ++scans;
    }
  }
  if (scans == 0) {
    result.why = "there are no scans around one of the poses";
    return result;
  }
  slam::SearchRegion region =
      slam::SearchRegion::around(slam::Pose::Zero(), appearance.distance, appearance.angle);
  if (drift) {
    constexpr double kSigmas = 3.0;
    const double metres = kSigmas * std::sqrt(std::max((*drift)(0, 0), (*drift)(1, 1))),
                 turn = kSigmas * std::sqrt((*drift)(5, 5));
    if (metres < appearance.distance)
      region = slam::SearchRegion::around(planar(to_origin * graph.nodes()[*to_node].pose),
                                          metres + 2.0 * options.place.cell,
                                          std::min(std::max(turn, 0.1), appearance.angle));
  }
  const slam::Place place = map.findPlace(toScan(sought.front()), region);
  result.sure = place.sure;
  result.why = place.why;
  if (!place.sure) return result;
  // The scan's frame is that of the body but for the time between.
  result.transform =
      planarPose(place.pose.x(), place.pose.y(), place.pose.z()) * sought.front().sensor.inverse();
  result.information.setZero();
  const Eigen::Matrix3d information = slam::inverseOf(slam::loopCovariance(place.covariance, loop));
  // The covariance is of x, y in the map, the information of the error seen from the pose.
  Eigen::Matrix3d turned = Eigen::Matrix3d::Identity();
  turned.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(place.pose.z()).toRotationMatrix();
  const Eigen::Matrix3d seen = turned.transpose() * information * turned;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) result.information(kRows[r], kRows[c]) = 0.5 * (seen(r, c) + seen(c, r));
  return result;
}

}  // namespace

void AppearanceOptions::describe(mapping_common::OptionList& o) {
  o("distance", distance, "m", "how far apart poses may be that see the same").within(0.1, 1000.0);
  o("angle", angle, "rad", "and turned").within(0.01, 3.15);
  o("scans", scans, "", "key scans around each pose that a map is made of").within(1, 1000);
}

ScanMatch matchScans(const Session& session, const Graph& graph, std::int64_t from, std::int64_t to,
                     const std::optional<Matrix6>& drift, const slam::SlamOptions& options,
                     const slam::LoopOptions& loop, const AppearanceOptions& appearance) {
  ScanMatch match = matchOneWay(session, graph, from, to, drift, options, loop, appearance);
  if (!match.sure) return match;
  // Where little tells a position, each way finds another.
  const ScanMatch back = matchOneWay(session, graph, to, from, drift, options, loop, appearance);
  match.sure = false;
  if (!back.sure) {
    match.why = "the other way round: " + back.why;
    return match;
  }
  Edge edge;
  edge.transform = back.transform;
  edge.information = back.information;
  edge = turned(edge);
  const Pose difference = match.transform.inverse() * edge.transform;
  const Matrix6 covariance = inverseOf(match.information, true) + inverseOf(edge.information, true);
  Vector6 error = Vector6::Zero();
  const slam::Pose in_plane = planar(difference);
  for (int i = 0; i < 3; ++i) error(kRows[i]) = in_plane(i);
  constexpr double kChi2 = 11.34;  // 99 %, three dimensions
  if (error.dot(inverseOf(covariance, true) * error) > kChi2) {
    match.why = "the two ways round differ by " + std::to_string(difference.translation.norm()) + " m";
    return match;
  }
  match.sure = true;
  match.transform = interpolate(match.transform, edge.transform, 0.5);
  return match;
}

}  // namespace pose_graph
