// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/ground_plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>

namespace intensity_place_recognition {
namespace {

constexpr int kCells = 64;                                           // of 1 m, of the plan's side
constexpr int kHighest = kCells / 2 - 1, kRoughly = kCells / 4 - 1;  // frequencies
constexpr int kColumns = kHighest + 1;                               // of them along x, from 0
constexpr int kRows = 2 * kHighest + 1;                              // and y, from -kHighest
constexpr int kFrequencies = kRows * kColumns;                       // of a channel
constexpr int kMostShifts = kCells / 4;                              // cells to either side
constexpr float kUpper = 1.0f;                  // m above the sensor: upper floors and crowns
constexpr float kUpright = 0.9f, kFlat = 0.5f;  // of the normals of walls, and of their flatness
constexpr int kChannels = 4;                    // what stands where; light: ground, lower, upper

// exp(i 2 pi k / kCells)
struct Waves {
  std::array<float, kCells> cosine, sine;
  Waves() {
    for (int k = 0; k < kCells; ++k) {
      cosine[k] = static_cast<float>(std::cos(2.0 * M_PI * k / kCells));
      sine[k] = static_cast<float>(std::sin(2.0 * M_PI * k / kCells));
    }
  }
};
const Waves& waves() {
  static const Waves kWaves;
  return kWaves;
}

// Of the parabola through three values, the middle of which is the largest: -0.5 to 0.5.
float vertex(float before, float at, float after) {
  const float bend = before - 2.0f * at + after;
  return bend < 0.0f ? std::clamp(0.5f * (before - after) / bend, -0.5f, 0.5f) : 0.0f;
}

}  // namespace

WallDirections::WallDirections(const Shape& shape) {
  for (const Patch& p : shape.patches()) {
    const float flat = p.normal.head<2>().norm();
    if (flat < kUpright || p.flatness < kFlat) continue;
    const Eigen::Vector3f facing = p.normal.dot(p.point) > 0.0f ? Eigen::Vector3f(-p.normal) : p.normal;
    const double step = std::atan2(facing.y(), facing.x()) / (2.0 * M_PI) * kSteps + kSteps;
    const int below = static_cast<int>(step);
    const float part = static_cast<float>(step - below);
    part_[below % kSteps] += p.flatness * (1.0f - part);
    part_[(below + 1) % kSteps] += p.flatness * part;
  }
  std::copy_n(part_.begin(), kSteps, part_.begin() + kSteps);
}

double WallDirections::bestYaw(const WallDirections& place, double likely, double reach) const {
  constexpr double kStep = 2.0 * M_PI / kSteps;
  const int middle = static_cast<int>(std::lround(likely / kStep)),
            most = static_cast<int>(reach / kStep) + 1;
  std::vector<float> products(2 * most + 1);
  for (int i = 0; i <= 2 * most; ++i) {
    const int turn = ((middle + i - most) % kSteps + kSteps) % kSteps;
    products[i] = std::inner_product(part_.begin(), part_.begin() + kSteps, place.part_.begin() + turn, 0.0f);
  }
  const auto best = std::max_element(products.begin() + 1, products.end() - 1);
  const int at = static_cast<int>(best - products.begin());
  return (middle + at - most + vertex(products[at - 1], *best, products[at + 1])) * kStep;
}

GroundPlan::GroundPlan(const Shape& shape, double yaw)
    : real_(static_cast<std::size_t>(kChannels) * kFrequencies), imaginary_(real_) {
  using Cells = std::array<float, kCells * kCells>;
  std::array<Cells, kChannels> sum{}, weight{};
  const float middle = 0.5f * (kCells - 1);
  const float cosine = static_cast<float>(std::cos(yaw)), sine = static_cast<float>(std::sin(yaw));
  for (const Patch& p : shape.patches()) {
    const float x = cosine * p.point.x() - sine * p.point.y() + middle,
                y = sine * p.point.x() + cosine * p.point.y() + middle;
    if (!(x >= 0.0f && y >= 0.0f && x < kCells - 1 && y < kCells - 1)) continue;
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const float right = x - static_cast<float>(column), up = y - static_cast<float>(row);
    const int channel = p.isLevel() ? 1 : p.point.z() < kUpper ? 2 : 3, at = row * kCells + column;
    for (const auto& [cell, part] :
         {std::make_pair(at, (1.0f - right) * (1.0f - up)), std::make_pair(at + 1, right * (1.0f - up)),
          std::make_pair(at + kCells, (1.0f - right) * up), std::make_pair(at + kCells + 1, right * up)}) {
      weight[channel][cell] += part;
      sum[channel][cell] += part * p.intensity;
    }
  }
  float mean = 0.0f;
  for (int i = 0; i < kCells * kCells; ++i) {
    sum[0][i] = std::sqrt(weight[2][i] + weight[3][i]);
    mean += sum[0][i] / (kCells * kCells);
    for (int c = 1; c < kChannels; ++c) sum[c][i] /= std::max(1.0f, weight[c][i]);
  }
  for (float& value : sum[0]) value -= mean;
  // Two channels at once, as the real and the imaginary part.
  for (int c = 0; c < kChannels; c += 2) {
    cv::Mat2f both(kCells, kCells), spectrum;
    std::array<double, 2> squares{};
    for (int i = 0; i < kCells * kCells; ++i) {
      both.begin()[i] = {sum[c][i], sum[c + 1][i]};
      squares[0] += sum[c][i] * sum[c][i];
      squares[1] += sum[c + 1][i] * sum[c + 1][i];
    }
    cv::dft(both, spectrum);
    const float scale = static_cast<float>(0.5 / std::sqrt(std::max(1e-18, squares[0]))),
                next_scale = static_cast<float>(0.5 / std::sqrt(std::max(1e-18, squares[1])));
    std::size_t at = static_cast<std::size_t>(c) * kFrequencies;
    for (int f = -kHighest; f <= kHighest; ++f) {
      for (int g = 0; g <= kHighest; ++g, ++at) {
        const cv::Vec2f z = spectrum((f + kCells) % kCells, g),
                        mirrored = spectrum((kCells - f) % kCells, (kCells - g) % kCells);
        real_[at] = scale * (z[0] + mirrored[0]);
        imaginary_[at] = scale * (z[1] - mirrored[1]);
        real_[at + kFrequencies] = next_scale * (z[1] + mirrored[1]);
        imaginary_[at + kFrequencies] = next_scale * (mirrored[0] - z[0]);
      }
    }
  }
}

GroundPlan GroundPlan::halfTurned() const {
  GroundPlan turned = *this;
  for (int c = 0; c < kChannels; ++c) {
    std::size_t at = static_cast<std::size_t>(c) * kFrequencies;
    for (int f = -kHighest; f <= kHighest; ++f) {
      for (int g = 0; g <= kHighest; ++g, ++at) {
        const int k = (f + g + kCells) % kCells;  // the cells' middle is between two of them
        const float cosine = waves().cosine[k], sine = waves().sine[k];
        turned.real_[at] = cosine * real_[at] + sine * imaginary_[at];
        turned.imaginary_[at] = sine * real_[at] - cosine * imaginary_[at];
      }
    }
  }
  return turned;
}

std::vector<float> GroundPlan::correlations(const GroundPlan& place, int step, int shifts,
                                            int highest) const {
  const int columns = highest + 1;
  // The frequencies along y together with their negatives: their sums for the cosine, their differences for
  // the sine.
  std::array<float, kColumns * kColumns> sum_real{}, sum_imaginary{}, difference_real{},
      difference_imaginary{};
  for (int f = 0; f <= highest; ++f) {
    for (int c = 0; c < kChannels; ++c) {
      const int above = (c * kRows + kHighest + f) * kColumns, below = (c * kRows + kHighest - f) * kColumns;
      const float *a = &place.real_[above], *b = &place.imaginary_[above], *x = &real_[above],
                  *y = &imaginary_[above], *p = &place.real_[below], *q = &place.imaginary_[below],
                  *u = &real_[below], *v = &imaginary_[below];
      float *sr = &sum_real[f * columns], *si = &sum_imaginary[f * columns],
            *dr = &difference_real[f * columns], *di = &difference_imaginary[f * columns];
      for (int g = 0; g < columns; ++g) {
        const float r = a[g] * x[g] + b[g] * y[g], i = b[g] * x[g] - a[g] * y[g];
        const float s = p[g] * u[g] + q[g] * v[g], j = q[g] * u[g] - p[g] * v[g];
        sr[g] += r + s;
        si[g] += i + j;
        dr[g] += r - s;
        di[g] += i - j;
      }
    }
  }
  for (int g = 0; g < columns; ++g) {  // which is its own negative
    sum_real[g] *= 0.5f;
    sum_imaginary[g] *= 0.5f;
  }
  const int side = 2 * shifts + 1;
  constexpr float kScale = 1.0f / (kChannels * kCells * kCells);
  std::vector<float> map(static_cast<std::size_t>(side) * side);
  using Row = std::array<float, kColumns>;
  for (int dy = 0; dy <= shifts; ++dy) {
    Row even_real{}, even_imaginary{}, odd_real{}, odd_imaginary{};
    for (int f = 0; f <= highest; ++f) {
      const int k = step * dy * f % kCells;
      const float c = waves().cosine[k], s = waves().sine[k];
      for (int g = 0; g < columns; ++g) {
        even_real[g] += c * sum_real[f * columns + g];
        even_imaginary[g] += c * sum_imaginary[f * columns + g];
        odd_real[g] += s * difference_real[f * columns + g];
        odd_imaginary[g] += s * difference_imaginary[f * columns + g];
      }
    }
    for (const int sign : {1, -1}) {
      const auto by = static_cast<float>(sign);
      Row real, imaginary;
      for (int g = 0; g < columns; ++g) {
        const float twice = g == 0 ? kScale : 2.0f * kScale;
        real[g] = twice * (even_real[g] - by * odd_imaginary[g]);
        imaginary[g] = twice * (even_imaginary[g] + by * odd_real[g]);
      }
      float* row = &map[static_cast<std::size_t>(shifts + sign * dy) * side + shifts];
      for (int dx = 0; dx <= shifts; ++dx) {
        float even = 0.0f, odd = 0.0f;
        for (int g = 0; g < columns; ++g) {
          const int k = step * dx * g % kCells;
          even += waves().cosine[k] * real[g];
          odd += waves().sine[k] * imaginary[g];
        }
        row[dx] = even - odd;
        row[-dx] = even + odd;
      }
    }
  }
  return map;
}

GroundPlan::Shift GroundPlan::roughShift(const GroundPlan& place, float reach) const {
  constexpr int kStep = 2;
  const int shifts = std::clamp(static_cast<int>(std::ceil(reach / kStep)), 0, kMostShifts / kStep),
            side = 2 * shifts + 1;
  const std::vector<float> map = correlations(place, kStep, shifts, kRoughly);
  const auto best = std::max_element(map.begin(), map.end());
  const int at = static_cast<int>(best - map.begin());
  return {*best, static_cast<float>(kStep * (at % side - shifts)),
          static_cast<float>(kStep * (at / side - shifts))};
}

std::vector<GroundPlan::Shift> GroundPlan::bestShifts(const GroundPlan& place, float reach,
                                                      std::size_t count) const {
  const int shifts = std::clamp(static_cast<int>(std::ceil(reach)), 0, kMostShifts), side = 2 * shifts + 1;
  const std::vector<float> map = correlations(place, 1, shifts, kHighest);
  std::vector<Shift> best;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const auto at = [&](int dx, int dy) {
        return map[std::clamp(y + dy, 0, side - 1) * side + std::clamp(x + dx, 0, side - 1)];
      };
      const float value = at(0, 0);
      bool largest = true;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) largest = largest && at(dx, dy) <= value;
      if (!largest) continue;
      best.push_back({value, static_cast<float>(x - shifts) + vertex(at(-1, 0), value, at(1, 0)),
                      static_cast<float>(y - shifts) + vertex(at(0, -1), value, at(0, 1))});
    }
  }
  std::sort(best.begin(), best.end(),
            [](const Shift& a, const Shift& b) { return a.correlation > b.correlation; });
  if (best.size() > count) best.resize(count);
  return best;
}

}  // namespace intensity_place_recognition
