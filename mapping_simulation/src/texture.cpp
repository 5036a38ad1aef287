// SPDX-License-Identifier: BSD-3-Clause
#include "texture.h"

#include <algorithm>

namespace mapping_simulation {
namespace {

std::size_t modulo(double cell, std::size_t n) {
  return std::min(static_cast<std::size_t>(cell - std::floor(cell / n) * n), n - 1);
}

// A mixture of the first two values, or one of the values.
struct Mixture {
  std::size_t first = 0;
  double second = 0.0;  // weight of values[1], where first is 0
};

Mixture mixtureAt(const Texture& texture, const Eigen::Vector2d& uv) {
  const double size = texture.size;
  const std::size_t count = texture.values.size();
  switch (texture.type) {
    case Texture::Type::kConstant:
    case Texture::Type::kFacade:
      break;
    case Texture::Type::kCheckerboard:
      return {modulo(std::floor(uv.x() / size) + std::floor(uv.y() / size), count)};
    case Texture::Type::kStripes:
      return {modulo(std::floor((uv.x() * std::cos(texture.angle) + uv.y() * std::sin(texture.angle)) / size),
                     count)};
    case Texture::Type::kNoise:
      return {0, smoothNoise(uv.x() / size, uv.y() / size, texture.seed)};
    case Texture::Type::kBricks: {
      const double row = std::floor(uv.y() / texture.height);
      const double x = uv.x() / size + (std::fmod(row, 2.0) == 0.0 ? 0.0 : 0.5), column = std::floor(x);
      const bool joint = std::min((x - column) * size, uv.y() - row * texture.height) < 0.1 * texture.height;
      if (joint) return {2};
      return {0, cellValue(static_cast<std::int64_t>(column), static_cast<std::int64_t>(row), texture.seed)};
    }
  }
  return {};
}

// Noise at all scales between half a metre and what can still be seen, with mean 0 and a standard deviation
// of about 1.
double detailAt(const Eigen::Vector2d& uv, double footprint, std::uint32_t seed) {
  constexpr double kCoarsest = 0.5, kFinest = 0.002, kDeviation = 0.25;  // m; of smoothNoise
  double sum = 0.0, size = kCoarsest;
  for (int octave = 0; size > kFinest; ++octave, size *= 0.5) {
    const double share = std::clamp(0.5 * size / footprint - 0.5, 0.0, 1.0);  // fades before it aliases
    if (share == 0.0) break;
    sum += share * (smoothNoise(uv.x() / size, uv.y() / size, seed + 7919u * (octave + 1)) - 0.5);
  }
  return sum / (2.0 * kDeviation);
}

}  // namespace

double Texture::at(const Eigen::Vector2d& uv) const {
  if (type == Type::kFacade) return facadeAt(*this, uv).albedo[0];
  const Mixture m = mixtureAt(*this, uv);
  return m.second > 0.0 ? values[0] + m.second * (values[1] - values[0]) : values[m.first];
}

Appearance Texture::seenAt(const Eigen::Vector2d& uv, double footprint) const {
  Appearance seen;
  if (type == Type::kFacade) {
    seen = facadeAt(*this, uv);
  } else {
    const Mixture m = mixtureAt(*this, uv);
    const auto color = [this](std::size_t i) {
      return colors.empty() ? Color::Constant(static_cast<float>(values[i])) : colors[i];
    };
    seen.albedo = color(m.first);
    if (m.second > 0.0) seen.albedo += static_cast<float>(m.second) * (color(1) - seen.albedo);
  }
  if (detail > 0.0)
    seen.albedo *= static_cast<float>(std::max(0.0, 1.0 + detail * detailAt(uv, footprint, seed)));
  seen.albedo = seen.albedo.min(1.0f);
  return seen;
}

}  // namespace mapping_simulation
