// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/shape.h"

#include <zlib.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "intensity_place_recognition/block_grid.h"

namespace intensity_place_recognition {
namespace {

constexpr float kLowest = -10.0f, kHighest = 20.0f;  // m from the sensor
constexpr int kFewest = 6;                           // points that a surface is told from
constexpr int kPool = 2;                             // pixels of the panorama in one of those that are kept

// Sums over the points of a voxel.
struct Moments {
  int count = 0;
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  Eigen::Matrix3f squares = Eigen::Matrix3f::Zero();
  float intensity = 0.0f, squared = 0.0f;  // intensities, and of them
  Eigen::Vector3i cell = Eigen::Vector3i::Zero();
};

struct Measured {
  Patch patch;
  float error = 0.0f;  // standard error of the intensity
};

// Evenly over all, which are in the order of their places. At most `most`.
std::vector<Measured> thinned(const std::vector<Measured>& all, int most) {
  const std::size_t count = std::min(all.size(), static_cast<std::size_t>(most));
  std::vector<Measured> kept;
  kept.reserve(count);
  for (std::size_t i = 0; i < count; ++i) kept.push_back(all[i * all.size() / count]);
  return kept;
}

/// Intensities fall with the range and the angle of incidence, and roads are dark: two places of one shape
/// would agree in all of that. So each becomes its rank among the patches that are alike in them, -0.5 to
/// 0.5. What differs by no more than it is uncertain has about the same rank.
void flattenIntensities(std::vector<Measured>& patches) {
  constexpr int kAngles = 4;
  constexpr float kErrors = 2.5f;  // standard errors, within which values count as equal
  constexpr std::size_t kFewestAlike = 40, kMostRanges = 8;
  std::array<std::vector<std::size_t>, 2 * kAngles> groups;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Patch& p = patches[i].patch;
    const float cosine = std::abs(p.normal.dot(p.point.normalized()));
    const int angle = std::min(kAngles - 1, static_cast<int>(cosine * kAngles));
    groups[(p.isLevel() ? 0 : kAngles) + angle].push_back(i);
  }
  for (std::vector<std::size_t>& group : groups) {
    if (group.empty()) continue;
    std::sort(group.begin(), group.end(), [&](std::size_t a, std::size_t b) {
      return patches[a].patch.point.squaredNorm() < patches[b].patch.point.squaredNorm();
    });
    const std::size_t parts = std::clamp<std::size_t>(group.size() / kFewestAlike, 1, kMostRanges);
    for (std::size_t part = 0; part < parts; ++part) {
      std::vector<std::size_t> alike(group.begin() + group.size() * part / parts,
                                     group.begin() + group.size() * (part + 1) / parts);
      std::vector<float> sorted, errors;
      for (const std::size_t i : alike) {
        sorted.push_back(patches[i].patch.intensity);
        errors.push_back(patches[i].error);
      }
      std::sort(sorted.begin(), sorted.end());
      const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
      std::nth_element(errors.begin(), middle, errors.end());
      const float alike_within = kErrors * *middle;
      for (const std::size_t i : alike) {
        float& value = patches[i].patch.intensity;
        const auto below = std::lower_bound(sorted.begin(), sorted.end(), value - alike_within),
                   above = std::upper_bound(sorted.begin(), sorted.end(), value + alike_within);
        value = 0.5f * static_cast<float>((below - sorted.begin()) + (above - sorted.begin())) /
                    static_cast<float>(sorted.size()) -
                0.5f;
      }
    }
  }
}

}  // namespace

Shape::Shape(const Cloud& cloud, const Panorama& panorama, const ShapeOptions& options) {
  const float size = static_cast<float>(options.voxel), radius = static_cast<float>(options.radius);
  const float nearest = static_cast<float>(panorama.options.min_range);
  const int side = static_cast<int>(std::ceil(2.0f * radius / size)) + 2;
  const int layers = static_cast<int>(std::ceil((kHighest - kLowest) / size)) + 2;
  const auto cellOf = [&](const Eigen::Vector3f& p) {
    return Eigen::Vector3i(static_cast<int>((p.x() + radius) / size) + 1,
                           static_cast<int>((p.y() + radius) / size) + 1,
                           static_cast<int>((p.z() - kLowest) / size) + 1);
  };
  BlockGrid grid({side, side, layers});
  std::vector<int> indices(grid.slots(), -1);  // of moments
  std::vector<Moments> moments;
  for (const pcl::PointXYZI& p : cloud) {
    const Eigen::Vector3f point = p.getVector3fMap();
    const float squared = point.squaredNorm();
    if (!(squared >= nearest * nearest && squared < radius * radius && p.z > kLowest && p.z < kHighest))
      continue;
    const Eigen::Vector3i cell = cellOf(point);
    const std::size_t slot = grid.makeSlot(cell.x(), cell.y(), cell.z());
    if (slot >= indices.size()) indices.resize(grid.slots(), -1);
    int& index = indices[slot];
    if (index < 0) {
      index = static_cast<int>(moments.size());
      moments.emplace_back();
      moments.back().cell = cell;
    }
    Moments& m = moments[index];
    ++m.count;
    m.sum += point;
    m.squares += point * point.transpose();
    m.intensity += p.intensity;
    m.squared += p.intensity * p.intensity;
  }
  // In the order of their cells, whatever that of the points is.
  std::vector<std::pair<int, int>> order;  // cell, index
  order.reserve(moments.size());
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const Eigen::Vector3i& cell = moments[i].cell;
    order.emplace_back((cell.z() * side + cell.y()) * side + cell.x(), static_cast<int>(i));
  }
  std::sort(order.begin(), order.end());

  std::vector<Measured> upright, level;
  for (const auto& [number, index] : order) {
    const Moments& own = moments[index];
    Moments all;
    for (int z = -1; z <= 1; ++z) {
      for (int y = -1; y <= 1; ++y) {
        for (int x = -1; x <= 1; ++x) {
          const int at = indices[grid.slot(own.cell.x() + x, own.cell.y() + y, own.cell.z() + z)];
          if (at < 0) continue;
          all.count += moments[at].count;
          all.sum += moments[at].sum;
          all.squares += moments[at].squares;
        }
      }
    }
    if (all.count < kFewest) continue;
    const Eigen::Vector3f mean = all.sum / static_cast<float>(all.count);
    const Eigen::Matrix3f covariance = all.squares / static_cast<float>(all.count) - mean * mean.transpose();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
    solver.computeDirect(covariance);
    Patch patch;
    patch.point = own.sum / static_cast<float>(own.count);
    patch.normal = solver.eigenvectors().col(0);
    patch.intensity = own.intensity / static_cast<float>(own.count);
    const Eigen::Vector3f spread = solver.eigenvalues().cwiseMax(1e-6f).cwiseSqrt();
    patch.flatness = (spread[1] - spread[0]) / spread[1];
    const float count = static_cast<float>(own.count);
    const float variance = std::max(0.0f, own.squared / count - patch.intensity * patch.intensity);
    (patch.isLevel() ? level : upright)
        .push_back({patch, std::sqrt(variance / std::max(1.0f, count - 1.0f))});
  }
  std::vector<Measured> kept = thinned(upright, options.upright);
  const std::vector<Measured> kept_level = thinned(level, options.level);
  kept.insert(kept.end(), kept_level.begin(), kept_level.end());
  flattenIntensities(kept);
  patches_.reserve(kept.size());
  for (const Measured& m : kept) patches_.push_back(m.patch);

  lowest_ = static_cast<float>(panorama.options.min_elevation);
  highest_ = static_cast<float>(panorama.options.max_elevation);
  rows_ = panorama.mask.rows / kPool;
  columns_ = panorama.mask.cols / kPool;
  nearest_.assign(static_cast<std::size_t>(rows_) * columns_, 0);
  for (int y = 0; y < rows_ * kPool; ++y) {
    for (int x = 0; x < columns_ * kPool; ++x) {
      if (panorama.mask(y, x) == 0) continue;
      std::uint16_t& kept = nearest_[y / kPool * columns_ + x / kPool];
      const auto range =
          static_cast<std::uint16_t>(std::clamp(100.0f * panorama.range(y, x), 1.0f, 65535.0f));
      if (kept == 0 || range < kept) kept = range;
    }
  }
}

bool Shape::isSound() const {
  return rows_ > 0 && columns_ > 0 && lowest_ < highest_ &&
         nearest_.size() == static_cast<std::size_t>(rows_) * columns_ &&
         std::all_of(patches_.begin(), patches_.end(), [](const Patch& p) {
           return p.point.norm() < ShapeOptions::kFarthest && p.normal.allFinite() &&
                  std::isfinite(p.intensity) && std::isfinite(p.flatness);
         });
}

bool Shape::seesThrough(const Eigen::Vector3f& point, float margin) const {
  const float flat = point.head<2>().norm(), range = point.norm();
  const float row =
      (highest_ - std::atan2(point.z(), flat)) / (highest_ - lowest_) * static_cast<float>(rows_);
  if (!(row >= 1.0f && row < static_cast<float>(rows_ - 1))) return false;
  const int y = static_cast<int>(row);
  const int x = static_cast<int>((M_PI - std::atan2(point.y(), point.x())) / (2.0 * M_PI) * columns_);
  bool seen = false;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const std::uint16_t nearest = nearest_[(y + dy) * columns_ + (x + dx + columns_) % columns_];
      if (nearest == 0) continue;
      if (0.01f * nearest < range + margin) return false;
      seen = true;
    }
  }
  return seen;
}

PackedShape::PackedShape(const Shape& shape)
    : rows_(shape.rows_), columns_(shape.columns_), lowest_(shape.lowest_), highest_(shape.highest_) {
  const std::vector<Patch>& all = shape.patches();
  if (!all.empty()) {
    Eigen::Vector3f highest_point = lowest_point_ = all.front().point;
    for (const Patch& p : all) {
      lowest_point_ = lowest_point_.cwiseMin(p.point);
      highest_point = highest_point.cwiseMax(p.point);
    }
    step_ = (highest_point - lowest_point_)
                .cwiseMax(1e-3f)
                .cwiseQuotient(Eigen::Vector3f(kMask, kMask, kHeightMask));
  }
  const auto rounded = [](float value) { return static_cast<std::uint64_t>(std::max(0.0f, value) + 0.5f); };
  patches_.reserve(all.size());
  // Any three groups that follow one another from a multiple of three are every eighth patch, and so on.
  constexpr std::array<std::size_t, kGroups> kOrder = {0, 8, 16, 4, 12, 20, 2, 10, 18, 6, 14, 22,
                                                       1, 9, 17, 5, 13, 21, 3, 11, 19, 7, 15, 23};
  for (const std::size_t first : kOrder) {
    for (std::size_t i = first; i < all.size(); i += kGroups) {
      const Patch& p = all[i];
      const Eigen::Vector3f at = (p.point - lowest_point_).cwiseQuotient(step_);
      const Eigen::Vector3f n = (p.normal.z() < 0.0f ? -1.0f : 1.0f) / p.normal.lpNorm<1>() * p.normal;
      patches_.push_back(rounded(at.x()) | rounded(at.y()) << 14 | rounded(at.z()) << 28 |
                         rounded((n.x() + n.y() + 1.0f) * kNormalSteps) << 40 |
                         rounded((n.x() - n.y() + 1.0f) * kNormalSteps) << 47 |
                         rounded((p.intensity + 0.5f) * kIntensitySteps) << 54 |
                         rounded(p.flatness * kFlatnessSteps) << 60 | std::uint64_t(p.isLevel()) << 63);
    }
  }

  std::vector<std::uint16_t> changes(shape.nearest_.size());
  std::adjacent_difference(shape.nearest_.begin(), shape.nearest_.end(), changes.begin());
  // Low bytes first, then high ones, which are alike.
  std::vector<std::uint8_t> bytes(2 * changes.size());
  for (std::size_t i = 0; i < changes.size(); ++i) {
    bytes[i] = static_cast<std::uint8_t>(changes[i]);
    bytes[changes.size() + i] = static_cast<std::uint8_t>(changes[i] >> 8);
  }
  uLongf size = compressBound(bytes.size());
  std::vector<std::uint8_t> packed(size);
  if (compress2(packed.data(), &size, bytes.data(), bytes.size(), Z_BEST_SPEED) != Z_OK)
    throw std::runtime_error("the ranges can't be compressed");
  ranges_.assign(packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(size));
}

Shape PackedShape::unpacked() const {
  Shape shape;
  shape.patches_.resize(patches_.size());
  for (std::size_t i = 0; i < patches_.size(); ++i)
    shape.patches_[i] = {point(i), normal(i), intensity(i), flatness(i)};
  shape.rows_ = rows_;
  shape.columns_ = columns_;
  shape.lowest_ = lowest_;
  shape.highest_ = highest_;
  const std::size_t pixels = static_cast<std::size_t>(std::max(0, rows_)) * std::max(0, columns_);
  // What zlib's format can hold at most, so that a damaged number takes no memory.
  if (2 * pixels > 1032 * ranges_.size()) throw std::runtime_error("a place in it is inconsistent");
  std::vector<std::uint8_t> bytes(2 * pixels);
  uLongf size = bytes.size();
  if (uncompress(bytes.data(), &size, ranges_.data(), ranges_.size()) != Z_OK || size != bytes.size())
    throw std::runtime_error("a place in it is inconsistent");
  shape.nearest_.resize(pixels);
  std::uint16_t last = 0;
  for (std::size_t i = 0; i < pixels; ++i)
    shape.nearest_[i] = last = static_cast<std::uint16_t>(last + bytes[i] + 256 * bytes[pixels + i]);
  return shape;
}

std::size_t PackedShape::bytes() const {
  return sizeof(*this) + patches_.capacity() * sizeof(patches_[0]) + ranges_.capacity();
}

}  // namespace intensity_place_recognition
