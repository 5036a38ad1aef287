// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/geometry.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <random>

namespace ibuild_loop_closure {
namespace {

constexpr std::size_t kLayoutPoints = 2, kEpipolarPoints = 8, kPosePoints = 4;
// By which placements that are alike differ at most: rad, logarithm of the scale, widths of the image. Where
// they are known, descriptors may differ by so much more.
constexpr double kLikeRotation = 0.25, kLikeScale = 0.35, kLikeShift = 0.2, kLikeDelta = 1.15;

struct PointPairs {
  std::vector<cv::Point2f> query, match;
};

PointPairs pointsOf(const Features& query, const Features& match, const std::vector<Match>& pairs) {
  PointPairs points;
  for (const Match& pair : pairs) {
    points.query.push_back(query.points[pair.a]);
    points.match.push_back(match.points[pair.b]);
  }
  return points;
}

// q = (c, -s; s, c) p + offset
struct Layout {
  cv::Point2f rotation{1.0f, 0.0f}, offset;
  cv::Point2f operator()(const cv::Point2f& p) const {
    return {rotation.x * p.x - rotation.y * p.y + offset.x, rotation.y * p.x + rotation.x * p.y + offset.y};
  }
  double scale() const { return std::hypot(rotation.x, rotation.y); }
};

Placement placementOf(const Layout& layout, cv::Size query, cv::Size match) {
  const cv::Point2f middle = layout({0.5f * query.width, 0.5f * query.height});
  return {layout.scale(),
          std::atan2(layout.rotation.y, layout.rotation.x),
          {middle.x / match.width - 0.5, (middle.y - 0.5 * match.height) / match.width}};
}

bool alike(const Placement& a, const Placement& b) {
  return std::abs(std::remainder(a.rotation - b.rotation, 2.0 * CV_PI)) < kLikeRotation &&
         std::abs(std::log(a.scale / b.scale)) < kLikeScale && cv::norm(a.shift - b.shift) < kLikeShift;
}

// Share of the layouts made by chance that are like a given one, by their rotation, scale and shift.
double shareOfAlike(cv::Size match, double max_scale) {
  const double scales = std::min(1.0, kLikeScale / std::log(std::max(max_scale, 1.0 + 1e-9)));
  const double shifts = std::min(1.0, CV_PI * kLikeShift * kLikeShift * match.width / match.height);
  return kLikeRotation / CV_PI * scales * shifts;
}

std::optional<Layout> layoutOf(const PointPairs& p, std::size_t i, std::size_t j, float min_distance,
                               double max_scale) {
  const cv::Point2f from = p.query[j] - p.query[i], to = p.match[j] - p.match[i];
  const float length = from.dot(from);
  if (length < min_distance * min_distance) return {};
  Layout layout;
  layout.rotation = {from.dot(to) / length, static_cast<float>(from.cross(to)) / length};
  const double scale = layout.scale();
  if (!(scale <= max_scale && scale * max_scale >= 1.0)) return {};
  layout.offset = p.match[i] - layout(p.query[i]);
  return layout;
}

// That of least squares over all given pairs (Umeyama 1991).
Layout refined(const PointPairs& p, const std::vector<std::size_t>& used) {
  cv::Point2f from(0, 0), to(0, 0);
  for (std::size_t k : used) {
    from += p.query[k];
    to += p.match[k];
  }
  from *= 1.0f / used.size();
  to *= 1.0f / used.size();
  double along = 0.0, across = 0.0, squares = 0.0;
  for (std::size_t k : used) {
    const cv::Point2f a = p.query[k] - from, b = p.match[k] - to;
    along += a.dot(b);
    across += a.cross(b);
    squares += a.dot(a);
  }
  Layout layout;
  layout.rotation = cv::Point2d(along / squares, across / squares);
  layout.offset = to - layout(from);
  return layout;
}

// Features that are drawn from one spot are no independent evidence: counts those at least that far apart.
int distinct(const std::vector<cv::Point2f>& points, float distance) {
  std::vector<cv::Point2f> kept;
  for (const cv::Point2f& p : points) {
    const auto near = [&](const cv::Point2f& k) { return (k - p).dot(k - p) < distance * distance; };
    if (std::none_of(kept.begin(), kept.end(), near)) kept.push_back(p);
  }
  return static_cast<int>(kept.size());
}

double log10Choose(int n, int k) {
  return (std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0)) / std::log(10.0);
}

double significanceOf(int matches, int inliers, double probability) {
  if (inliers <= static_cast<int>(kLayoutPoints)) return 0.0;
  return -(log10Choose(matches, inliers) + log10Choose(inliers, kLayoutPoints) +
           static_cast<double>(inliers - kLayoutPoints) * std::log10(probability));
}

struct FoundLayout {
  Layout layout;
  std::vector<std::size_t> inliers;
  double significance = 0.0;
};

// The layout that most pairs fit, and its least squares.
FoundLayout findLayout(const PointPairs& points, cv::Size query, cv::Size match,
                       const GeometryOptions& options, const std::optional<Placement>& like = {}) {
  const std::size_t count = points.query.size();
  const auto tolerance = static_cast<float>(options.layout_tolerance * match.width);
  FoundLayout found;
  if (count <= kLayoutPoints) return found;
  std::vector<std::size_t> fitting;
  std::mt19937 random(1);  // the same images always give the same result
  // Those that are not like the given one cost next to nothing.
  const int iterations = like ? 10 * options.iterations : options.iterations;
  for (int i = 0; i < iterations; ++i) {
    const std::size_t a = random() % count, b = random() % count;
    const auto layout = layoutOf(points, a, b, tolerance, options.max_scale);
    if (!layout || (like && !alike(placementOf(*layout, query, match), *like))) continue;
    fitting.clear();
    for (std::size_t k = 0; k < count; ++k) {
      const cv::Point2f error = (*layout)(points.query[k]) - points.match[k];
      if (error.dot(error) < tolerance * tolerance) fitting.push_back(k);
    }
    if (fitting.size() <= found.inliers.size()) continue;
    found.inliers = fitting;
  }
  if (found.inliers.size() <= kLayoutPoints) return {};
  found.layout = refined(points, found.inliers);
  std::vector<cv::Point2f> spots;
  for (std::size_t k : found.inliers) spots.push_back(points.query[k]);
  found.significance =
      significanceOf(static_cast<int>(count), distinct(spots, static_cast<float>(options.spot * query.width)),
                     std::min(0.5, CV_PI * tolerance * tolerance / match.area()));
  if (like) found.significance -= std::log10(shareOfAlike(match, options.max_scale));
  return found;
}

// Share of a grid over the query's image that falls into the other's.
double overlapOf(const Layout& layout, cv::Size query, cv::Size match) {
  constexpr int kSteps = 20;
  int inside = 0;
  for (int i = 0; i < kSteps * kSteps; ++i) {
    const cv::Point2f p =
        layout({(i % kSteps + 0.5f) * query.width / kSteps, (i / kSteps + 0.5f) * query.height / kSteps});
    inside += p.x >= 0 && p.y >= 0 && p.x < match.width && p.y < match.height;
  }
  return static_cast<double>(inside) / (kSteps * kSteps);
}

cv::Matx33d matrixOf(const Camera& c) {
  return {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1};
}

// Pose from the match's points in space and the query's pixels. Its information is J^T J / sigma^2 of the
// projected points, sigma a pixel's error estimated from the residuals.
std::optional<RelativePose> relativePose(const View& query, const View& match, const Camera& camera,
                                         double tolerance, std::vector<Match>& pairs) {
  std::vector<cv::Point3d> space;
  std::vector<cv::Point2d> pixels;
  std::vector<Match> used;
  for (const Match& pair : pairs) {
    const double z = match.depths[pair.b];
    if (!(z > 0.0 && std::isfinite(z))) continue;
    const cv::Point2f p = match.features.points[pair.b];
    space.emplace_back((p.x - camera.cx) / camera.fx * z, (p.y - camera.cy) / camera.fy * z, z);
    pixels.emplace_back(query.features.points[pair.a]);
    used.push_back(pair);
  }
  cv::Mat rotation, translation;
  std::vector<int> inliers;
  if (space.size() < kPosePoints ||
      !cv::solvePnPRansac(space, pixels, matrixOf(camera), cv::noArray(), rotation, translation, false, 100,
                          static_cast<float>(tolerance), 0.99, inliers)) {
    return {};
  }
  std::vector<cv::Point3d> good_space;
  std::vector<cv::Point2d> good_pixels;
  std::vector<Match> good;
  for (int i : inliers) {
    good_space.push_back(space[i]);
    good_pixels.push_back(pixels[i]);
    good.push_back(used[i]);
  }
  if (good.size() < kPosePoints) return {};
  cv::solvePnP(good_space, good_pixels, matrixOf(camera), cv::noArray(), rotation, translation, true,
               cv::SOLVEPNP_ITERATIVE);

  cv::Mat matrix;
  cv::Rodrigues(rotation, matrix);
  Eigen::Matrix3d r;
  Eigen::Vector3d t;
  cv::cv2eigen(matrix, r);
  cv::cv2eigen(translation, t);
  RelativePose pose;
  Eigen::Isometry3d query_from_match = Eigen::Isometry3d::Identity();
  query_from_match.linear() = r;
  query_from_match.translation() = t;
  pose.transform = query_from_match.inverse();
  pose.inliers = static_cast<int>(good.size());

  double squares = 0.0;
  for (std::size_t i = 0; i < good.size(); ++i) {
    const Eigen::Vector3d x =
        query_from_match * Eigen::Vector3d(good_space[i].x, good_space[i].y, good_space[i].z);
    if (x.z() <= 0.0) return {};
    Eigen::Matrix<double, 2, 3> project;
    project << camera.fx / x.z(), 0, -camera.fx * x.x() / (x.z() * x.z()), 0, camera.fy / x.z(),
        -camera.fy * x.y() / (x.z() * x.z());
    // A small motion (v, w) of the query's camera in its own frame moves the point by -v + x cross w.
    Eigen::Matrix3d cross;
    cross << 0, -x.z(), x.y(), x.z(), 0, -x.x(), -x.y(), x.x(), 0;
    Eigen::Matrix<double, 2, 6> jacobian;
    jacobian << -project, project * cross;
    pose.information += jacobian.transpose() * jacobian;
    const double du = camera.fx * x.x() / x.z() + camera.cx - good_pixels[i].x;
    const double dv = camera.fy * x.y() / x.z() + camera.cy - good_pixels[i].y;
    squares += du * du + dv * dv;
  }
  const double freedom = std::max(1.0, 2.0 * static_cast<double>(good.size()) - 6.0);
  pose.information /= std::max(0.25, squares / freedom);  // no better than half a pixel
  pairs = std::move(good);
  return pose;
}

}  // namespace

GeometryResult checkLayout(const View& query, const View& match, const GeometryOptions& options,
                           const std::optional<Placement>& like) {
  GeometryResult result;
  const int delta = like ? cvRound(kLikeDelta * options.delta) : options.delta;
  const std::vector<Match> pairs =
      matchDescriptors(query.features.descriptors, match.features.descriptors, delta, options.ratio);
  result.matches = static_cast<int>(pairs.size());
  const FoundLayout found =
      findLayout(pointsOf(query.features, match.features, pairs), query.size, match.size, options, like);
  for (std::size_t k : found.inliers) result.pairs.push_back(pairs[k]);
  if (found.inliers.empty()) return result;
  result.placement = placementOf(found.layout, query.size, match.size);
  const double overlap = overlapOf(found.layout, query.size, match.size);
  const double scale = result.placement.scale;
  const double of_match = overlap * scale * scale * query.size.area() / match.size.area();
  result.overlap = std::min(overlap, of_match);
  if (result.overlap >= options.min_overlap) result.significance = found.significance;
  return result;
}

std::optional<ImageMotion> motionSince(const Features& last, const View& view,
                                       const std::vector<Match>& matches, const GeometryOptions& options) {
  constexpr double kSignificance = 4.0;
  const FoundLayout found = findLayout(pointsOf(view.features, last, matches), view.size, view.size, options);
  if (found.significance < kSignificance) return {};
  const cv::Point2f middle(0.5f * view.size.width, 0.5f * view.size.height);
  return ImageMotion{(found.layout(middle).x - middle.x) / view.size.width, -std::log(found.layout.scale())};
}

View firstFeatures(const View& view, std::size_t count) {
  View first = view;
  if (view.features.size() <= count) return first;
  first.features.points.resize(count);
  first.features.descriptors.resize(count);
  if (!first.depths.empty()) first.depths.resize(count);
  return first;
}

void verify(const View& query, const View& match, const std::optional<Camera>& camera,
            const GeometryOptions& options, GeometryResult& result) {
  result.inliers = 0;
  result.verified = false;
  const double tolerance = options.epipolar_tolerance * query.size.width;
  if (camera && !match.depths.empty()) {
    std::vector<Match> pairs = result.pairs;
    result.pose = relativePose(query, match, *camera, tolerance, pairs);
    if (result.pose && result.pose->inliers >= options.min_inliers) {
      result.inliers = result.pose->inliers;
      result.verified = true;
      result.pairs = std::move(pairs);
      return;
    }
    result.pose.reset();  // too few depths: the images alone may still do
  }
  if (result.pairs.size() < kEpipolarPoints) return;
  const PointPairs points = pointsOf(query.features, match.features, result.pairs);
  cv::Mat mask;
  if (camera) {
    cv::findEssentialMat(points.query, points.match, matrixOf(*camera), cv::RANSAC, 0.99, tolerance, mask);
  } else {
    cv::findFundamentalMat(points.query, points.match, cv::FM_RANSAC, tolerance, 0.99, mask);
  }
  if (mask.empty()) return;
  std::vector<Match> pairs;
  std::vector<cv::Point2f> spots;
  for (std::size_t i = 0; i < result.pairs.size(); ++i) {
    if (mask.at<unsigned char>(static_cast<int>(i)) == 0) continue;
    pairs.push_back(result.pairs[i]);
    spots.push_back(points.query[i]);
  }
  result.inliers = distinct(spots, static_cast<float>(options.spot * query.size.width));
  result.verified = result.inliers >= options.min_inliers;
  result.pairs = std::move(pairs);
}

}  // namespace ibuild_loop_closure
