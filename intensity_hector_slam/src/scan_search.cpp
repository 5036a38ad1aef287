// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/scan_search.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace intensity_hector_slam {
namespace {

constexpr int kLevels = 7;            // windows of up to 64 x 64 cells
constexpr std::int32_t kFull = 1000;  // score of a point on what is occupied
constexpr int kUnknown = -1;          // reflectivity
constexpr int kMargin = 1;            // cells beside what is occupied
constexpr double kAngleShare = 1.5;   // of the mean range: points there move by a cell with each angle

int quantized(float reflectivity) {
  return std::isfinite(reflectivity)
             ? static_cast<int>(std::lround(255.0f * std::clamp(reflectivity, 0.0f, 1.0f)))
             : kUnknown;
}

double meanRange(const std::vector<Eigen::Vector2f>& points) {
  double sum = 0.0;
  for (const auto& point : points) sum += point.norm();
  return points.empty() ? 1.0 : std::max(0.1, sum / points.size());
}

}  // namespace

SearchRegion SearchRegion::around(const Pose& pose, double distance, double half_range) {
  const Eigen::Vector2d half = Eigen::Vector2d::Constant(distance);
  return {{pose.head<2>() - half, pose.head<2>() + half}, pose.z(), half_range};
}

// The scan, turned: where points end, in cells from that of the scanner.
struct ScanSearch::Turned {
  double angle;
  std::vector<Eigen::Vector2i> ends;
  std::vector<int> reflectivities;
};

struct ScanSearch::Window {
  std::int32_t bound;
  int turn, level;
  Eigen::Vector2i at;  // its first cell
};

ScanSearch::ScanSearch(const GridMap& map, const SearchOptions& options, bool reflectivity,
                       const Eigen::AlignedBox2d& looked_at)
    : options_(mapping_common::validate(options)), cell_(map.resolution()) {
  for (int i = 0; i < 256; ++i) {
    const double difference = std::min(1.0, i / 255.0 / options_.reflectivity_scale);
    factors_[i] = std::lround(0.5 * kFull * (1.0 - options_.reflectivity_share * difference));
  }
  constexpr double kFarAway = 1e8;  // cells
  const auto cellAt = [&](const Eigen::Vector2d& point) {
    return map.cellAt(point.cwiseMax(-kFarAway * cell_).cwiseMin(kFarAway * cell_));
  };
  Eigen::AlignedBox2i box =
      map.knownCells().intersection(Eigen::AlignedBox2i(cellAt(looked_at.min()), cellAt(looked_at.max())));
  if (box.isEmpty()) box = Eigen::AlignedBox2i(Eigen::Vector2i::Zero(), Eigen::Vector2i::Zero());
  const Eigen::Vector2i first = box.min() - Eigen::Vector2i::Constant(kMargin);
  width_ = box.sizes().x() + 1 + 2 * kMargin;
  height_ = box.sizes().y() + 1 + 2 * kMargin;
  origin_ = cell_ * first.cast<double>();
  levels_.resize(kLevels);
  levels_[0].resize(static_cast<std::size_t>(width_) * height_);
  for (int y = box.min().y(); y <= box.max().y(); ++y) {
    for (int x = box.min().x(); x <= box.max().x(); ++x) {
      const GridMap::Cell& cell = map.cell(x, y);
      const Eigen::Vector2i here = Eigen::Vector2i(x, y) - first;
      levels_[0][static_cast<std::size_t>(here.y()) * width_ + here.x()].free = GridMap::isFree(cell);
      if (!GridMap::isOccupied(cell)) continue;
      const bool known = reflectivity && map.count(x, y) > 0;
      const auto least = static_cast<std::uint8_t>(known ? quantized(cell.reflectivity) : 0);
      const auto most = static_cast<std::uint8_t>(known ? least : 255);
      // What is beside counts half; all have the reflectivities around, as poses are on a grid.
      for (int dy = -kMargin; dy <= kMargin; ++dy) {
        for (int dx = -kMargin; dx <= kMargin; ++dx) {
          Bound& bound = levels_[0][static_cast<std::size_t>(here.y() + dy) * width_ + here.x() + dx];
          const bool itself = dx == 0 && dy == 0;
          bound.occupied = std::max<std::uint8_t>(bound.occupied, itself ? 2 : 1);
          bound.least = std::min(bound.least, least);
          bound.most = std::max(bound.most, most);
        }
      }
    }
  }
  for (int h = 1; h < kLevels; ++h) {
    const int step = 1 << (h - 1), added = 2 * step - 1;
    const int width = width_ + added, height = height_ + added;
    levels_[h].resize(static_cast<std::size_t>(width) * height);
    for (int y = -added; y < height_; ++y) {
      for (int x = -added; x < width_; ++x) {
        Bound& bound = levels_[h][static_cast<std::size_t>(y + added) * width + x + added];
        for (const auto& [dx, dy] :
             {std::pair(0, 0), std::pair(step, 0), std::pair(0, step), std::pair(step, step)}) {
          const Bound& part = at(h - 1, x + dx, y + dy);
          bound.occupied = std::max(bound.occupied, part.occupied);
          bound.least = std::min(bound.least, part.least);
          bound.most = std::max(bound.most, part.most);
          bound.free = std::max(bound.free, part.free);
        }
      }
    }
  }
}

const ScanSearch::Bound& ScanSearch::at(int level, int x, int y) const {
  static constexpr Bound kNothing{};
  const int added = (1 << level) - 1;
  const unsigned column = x + added, row = y + added;
  const unsigned width = width_ + added;
  if (column >= width || row >= static_cast<unsigned>(height_ + added)) return kNothing;
  return levels_[level][static_cast<std::size_t>(row) * width + column];
}

std::int32_t ScanSearch::pointScore(const Bound& bound, int reflectivity) const {
  if (bound.occupied == 0) return 0;
  const int difference =
      reflectivity == kUnknown ? 0 : std::max({0, bound.least - reflectivity, reflectivity - bound.most});
  return bound.occupied * factors_[difference];
}

std::int32_t ScanSearch::bound(int level, const Turned& turned, const Eigen::Vector2i& at,
                               std::int32_t least) const {
  constexpr std::size_t kBlock = 16;
  const std::size_t count = turned.ends.size();
  std::int32_t sum = 0;
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t end = std::min(first + kBlock, count);
    for (std::size_t i = first; i < end; ++i) {
      sum += pointScore(this->at(level, at.x() + turned.ends[i].x(), at.y() + turned.ends[i].y()),
                        turned.reflectivities[i]);
    }
    if (sum + kFull * static_cast<std::int32_t>(count - end) <= least) return least;
  }
  return sum;
}

bool ScanSearch::mayStand(int level, const Eigen::Vector2i& at) const {
  return this->at(level, at.x(), at.y()).free != 0;
}

std::vector<std::size_t> pointsApart(const Scan& scan, double distance) {
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    if (kept.empty() || (scan.points[i] - scan.points[kept.back()]).norm() >= distance) kept.push_back(i);
  }
  return kept;
}

// Neighbouring points nearer than a cell count once, as what is near has the most beams; then every n-th. The
// first of them are spread over all of the scan: what doesn't fit shows early.
std::vector<Eigen::Vector2f> ScanSearch::thinned(const Scan& scan, std::vector<int>& reflectivities) const {
  const std::vector<std::size_t> kept = pointsApart(scan, cell_);
  const std::size_t points = options_.points, n = std::min(kept.size(), points);
  std::vector<Eigen::Vector2f> result;
  constexpr double kGoldenSection = 0.618;
  std::size_t step = std::max<std::size_t>(1, std::lround(kGoldenSection * n));
  while (std::gcd(step, n) > 1) ++step;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t k = kept[i * step % n * kept.size() / n];
    result.push_back(scan.points[k] - scan.origin);
    reflectivities.push_back(scan.reflectivities.empty() ? kUnknown : quantized(scan.reflectivities[k]));
  }
  return result;
}

std::vector<ScanSearch::Turned> ScanSearch::turn(const Scan& scan, const SearchRegion& region) const {
  std::vector<int> reflectivities;
  const std::vector<Eigen::Vector2f> points = thinned(scan, reflectivities);
  const double step = cell_ / (kAngleShare * meanRange(points));
  const double half = std::min(region.half_range, M_PI);
  const int turns = std::max(1, static_cast<int>(std::ceil(2.0 * half / step)));
  std::vector<Turned> turned;
  for (int i = 0; i < turns; ++i) {
    Turned next{wrapAngle(region.angle - half + (i + 0.5) * 2.0 * half / turns), {}, reflectivities};
    const Eigen::Rotation2Df rotation(static_cast<float>(next.angle));
    next.ends.reserve(points.size());
    for (const Eigen::Vector2f& point : points) {
      // From the middle of the scanner's cell.
      const Eigen::Array2f end = (rotation * point).array() / static_cast<float>(cell_) + 0.5f;
      next.ends.push_back(end.floor().max(-1e8f).min(1e8f).cast<int>());
    }
    turned.push_back(std::move(next));
  }
  return turned;
}

Eigen::AlignedBox2i ScanSearch::cellsOf(const SearchRegion& region) const {
  const auto cellAt = [&](const Eigen::Vector2d& point) -> Eigen::Vector2i {
    return ((point - origin_).array() / cell_).floor().max(-1e8).min(1e8).cast<int>();
  };
  return Eigen::AlignedBox2i(cellAt(region.box.min()), cellAt(region.box.max()))
      .intersection(Eigen::AlignedBox2i(Eigen::Vector2i(0, 0), Eigen::Vector2i(width_ - 1, height_ - 1)));
}

Pose ScanSearch::poseOf(const Turned& turned, const Eigen::Vector2i& at, const Scan& scan) const {
  const Eigen::Vector2d scanner = origin_ + cell_ * (at.cast<double>().array() + 0.5).matrix();
  const Eigen::Vector2d body = scanner - Eigen::Rotation2Dd(turned.angle) * scan.origin.cast<double>();
  return {body.x(), body.y(), turned.angle};
}

bool ScanSearch::isApart(const Pose& pose, const std::vector<Optimum>& found) const {
  return std::all_of(found.begin(), found.end(), [&](const Optimum& other) {
    return (pose - other.pose).head<2>().norm() > options_.apart_distance ||
           std::abs(wrapAngle(pose.z() - other.pose.z())) > options_.apart_angle;
  });
}

// Depth first, the more promising windows first, and none that can't have a better pose.
void ScanSearch::descend(const Scan& scan, const std::vector<Turned>& turned, std::vector<Window> windows,
                         const Eigen::AlignedBox2i& box, const std::vector<Optimum>& found,
                         std::int32_t& best_score, Optimum& best) const {
  std::sort(windows.begin(), windows.end(),
            [](const Window& a, const Window& b) { return a.bound < b.bound; });  // the last is the next
  while (!windows.empty()) {
    const Window window = windows.back();
    windows.pop_back();
    if (window.bound <= best_score) continue;
    const Turned& turn = turned[window.turn];
    if (window.level == 0) {
      const Pose pose = poseOf(turn, window.at, scan);
      if (!isApart(pose, found)) continue;
      best_score = window.bound;
      best.pose = pose;
      continue;
    }
    const int level = window.level - 1, step = 1 << level;
    const std::size_t first = windows.size();
    for (const auto& [dx, dy] :
         {std::pair(0, 0), std::pair(step, 0), std::pair(0, step), std::pair(step, step)}) {
      const Eigen::Vector2i at = window.at + Eigen::Vector2i(dx, dy);
      const Eigen::Vector2i last = at + Eigen::Vector2i::Constant(step - 1);
      if (!box.intersects(Eigen::AlignedBox2i(at, last)) || !mayStand(level, at)) continue;
      const std::int32_t here = bound(level, turn, at, best_score);
      if (here > best_score) windows.push_back({here, window.turn, level, at});
    }
    std::sort(windows.begin() + first, windows.end(),
              [](const Window& a, const Window& b) { return a.bound < b.bound; });
  }
}

std::vector<ScanSearch::Optimum> ScanSearch::optima(const Scan& scan, const SearchRegion& region,
                                                    double least, int count) const {
  std::vector<Optimum> found;
  const Eigen::AlignedBox2i box = cellsOf(region);
  if (box.isEmpty() || scan.points.empty()) return found;
  const std::vector<Turned> turned = turn(scan, region);
  const double full = static_cast<double>(kFull) * turned.front().ends.size();
  const auto min_score = static_cast<std::int32_t>(options_.min_score * full);

  // Windows no larger than the region.
  int level = 0;
  while (level + 1 < kLevels && (1 << (level + 1)) <= box.sizes().maxCoeff() + 1) ++level;
  std::vector<Window> windows;
  const int step = 1 << level;
  for (int y = box.min().y(); y <= box.max().y(); y += step) {
    for (int x = box.min().x(); x <= box.max().x(); x += step) {
      if (!mayStand(level, {x, y})) continue;
      for (std::size_t i = 0; i < turned.size(); ++i) {
        const std::int32_t here = bound(level, turned[i], {x, y}, min_score);
        if (here > min_score) windows.push_back({here, static_cast<int>(i), level, {x, y}});
      }
    }
  }
  while (static_cast<int>(found.size()) < count) {
    const std::int32_t threshold =
        found.empty() ? min_score
                      : std::max(min_score, static_cast<std::int32_t>(least * full * found.front().score));
    std::int32_t best_score = threshold;
    Optimum best;
    descend(scan, turned, windows, box, found, best_score, best);
    if (best_score == threshold) break;
    best.score = best_score / full;
    found.push_back(best);
  }
  return found;
}

ScanSearch::Optimum ScanSearch::bestOfAll(const Scan& scan, const SearchRegion& region) const {
  Optimum best;
  const Eigen::AlignedBox2i box = cellsOf(region);
  if (box.isEmpty() || scan.points.empty()) return best;
  for (const Turned& turned : turn(scan, region)) {
    for (int y = box.min().y(); y <= box.max().y(); ++y) {
      for (int x = box.min().x(); x <= box.max().x(); ++x) {
        if (!mayStand(0, {x, y})) continue;
        const double score = bound(0, turned, {x, y}, -1) / (static_cast<double>(kFull) * turned.ends.size());
        if (score > best.score) best = {poseOf(turned, {x, y}, scan), score};
      }
    }
  }
  return best;
}

const ScanSearch::Bound& ScanSearch::endOf(const Eigen::Isometry2d& to_map,
                                           const Eigen::Vector2f& point) const {
  const Eigen::Array2d end = (to_map * point.cast<double>() - origin_).array() / cell_;
  const Eigen::Array2i cell = end.floor().max(-1e8).min(1e8).cast<int>();
  return at(0, cell.x(), cell.y());
}

double ScanSearch::score(const Scan& scan, const Pose& pose) const {
  const Eigen::Isometry2d to_map = isometry(pose);
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    sum += pointScore(endOf(to_map, scan.points[i]),
                      scan.reflectivities.empty() ? kUnknown : quantized(scan.reflectivities[i]));
  }
  return scan.points.empty() ? 0.0 : sum / (static_cast<double>(kFull) * scan.points.size());
}

double ScanSearch::difference(const Scan& scan, const Pose& pose) const {
  const Eigen::Isometry2d to_map = isometry(pose);
  double sum = 0.0;
  std::size_t known = 0;
  for (std::size_t i = 0; i < scan.reflectivities.size(); ++i) {
    const Bound& there = endOf(to_map, scan.points[i]);
    const int here = quantized(scan.reflectivities[i]);
    if (there.occupied == 0 || here == kUnknown) continue;
    sum += std::max({0, there.least - here, here - there.most}) / 255.0;
    ++known;
  }
  return known > 0 ? sum / known : 0.0;
}

}  // namespace intensity_hector_slam
