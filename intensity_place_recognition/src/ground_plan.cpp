// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/ground_plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <opencv2/core.hpp>

namespace intensity_place_recognition {
namespace {

constexpr int kCells = 32;                               // of the plan's side
constexpr float kCell = 2.0f;                            // m
constexpr int kHighest = kCells / 2 - 1;                 // frequency
constexpr int kColumns = kHighest + 1;                   // frequencies along x, from 0
constexpr int kRows = 2 * kHighest + 1;                  // and y, from -kHighest
constexpr int kShifts = 5;                               // cells to either side at most
constexpr float kUpper = 1.0f;                           // m above the sensor: upper floors and crowns
constexpr std::size_t kFrequencies = kRows * kColumns;   // of a channel
constexpr std::array<float, 4> kWeights = {1, 1, 1, 1};  // what stands where; light: ground, lower, upper
constexpr int kChannels = static_cast<int>(kWeights.size());

// exp(i 2 pi shift frequency / kCells)
struct Waves {
  std::array<std::complex<float>, kCells> of;
  Waves() {
    for (int i = 0; i < kCells; ++i) {
      const double angle = 2.0 * M_PI * i / kCells;
      of[i] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
    }
  }
  std::complex<float> at(int shift, int frequency) const {
    return of[((shift * frequency) % kCells + kCells) % kCells];
  }
};

}  // namespace

GroundPlan::GroundPlan(const Shape& shape, double yaw) : real_(kChannels * kFrequencies), imaginary_(real_) {
  std::array<cv::Mat1f, kChannels> sum, weight;
  for (int c = 0; c < kChannels; ++c) {
    sum[c] = cv::Mat1f(kCells, kCells, 0.0f);
    weight[c] = cv::Mat1f(kCells, kCells, 0.0f);
  }
  const float cosine = static_cast<float>(std::cos(yaw)) / kCell,
              sine = static_cast<float>(std::sin(yaw)) / kCell;
  for (const Patch& p : shape.patches()) {
    const float x = cosine * p.point.x() - sine * p.point.y() + 0.5f * (kCells - 1),
                y = sine * p.point.x() + cosine * p.point.y() + 0.5f * (kCells - 1);
    const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
    if (column < 0 || row < 0 || column >= kCells - 1 || row >= kCells - 1) continue;
    const int channel = p.isLevel() ? 1 : p.point.z() < kUpper ? 2 : 3;
    for (int i = 0; i < 4; ++i) {
      const float right = x - column, up = y - row;
      const float part = (i % 2 == 1 ? right : 1.0f - right) * (i / 2 == 1 ? up : 1.0f - up);
      const int r = row + i / 2, c = column + i % 2;
      weight[channel](r, c) += part;
      sum[channel](r, c) += part * p.intensity;
      if (channel > 1) sum[0](r, c) += part;
    }
  }
  cv::sqrt(sum[0], sum[0]);
  sum[0] -= cv::mean(sum[0])[0];
  for (int c = 1; c < kChannels; ++c)
    for (int i = 0; i < kCells * kCells; ++i) sum[c].begin()[i] /= std::max(1.0f, weight[c].begin()[i]);
  for (int c = 0; c < kChannels; ++c) {
    const float scale = static_cast<float>(kWeights[c] / std::max(1e-9, cv::norm(sum[c])));
    cv::Mat2f spectrum;
    cv::dft(sum[c], spectrum, cv::DFT_COMPLEX_OUTPUT);
    for (int f = 0; f < kRows; ++f) {
      for (int g = 0; g < kColumns; ++g) {
        const cv::Vec2f value = spectrum((f - kHighest + kCells) % kCells, g);
        const std::size_t at = c * kFrequencies + f * kColumns + g;
        real_[at] = scale * value[0];
        imaginary_[at] = scale * value[1];
      }
    }
  }
}

GroundPlan::Shift GroundPlan::bestShift(const GroundPlan& place, float reach) const {
  static const Waves kWaves;
  std::array<float, kFrequencies> real{}, imaginary{};
  for (int c = 0; c < kChannels; ++c) {
    const float *a = &place.real_[c * kFrequencies], *b = &place.imaginary_[c * kFrequencies],
                *x = &real_[c * kFrequencies], *y = &imaginary_[c * kFrequencies];
    for (std::size_t i = 0; i < kFrequencies; ++i) {
      real[i] += a[i] * x[i] + b[i] * y[i];
      imaginary[i] += b[i] * x[i] - a[i] * y[i];
    }
  }
  const int shifts = std::clamp(static_cast<int>(std::ceil(reach / kCell)), 0, kShifts);
  float total = 0.0f;
  for (const float weight : kWeights) total += weight;
  const float scale = 1.0f / (total * kCells * kCells);
  Shift best;
  for (int dy = -shifts; dy <= shifts; ++dy) {
    std::array<float, kColumns> row_real{}, row_imaginary{};
    for (int f = 0; f < kRows; ++f) {
      const std::complex<float> wave = kWaves.at(dy, f - kHighest);
      const float c = wave.real(), s = wave.imag();
      const float *a = &real[f * kColumns], *b = &imaginary[f * kColumns];
      for (int g = 0; g < kColumns; ++g) {
        row_real[g] += c * a[g] - s * b[g];
        row_imaginary[g] += c * b[g] + s * a[g];
      }
    }
    for (int dx = -shifts; dx <= shifts; ++dx) {
      float sum = row_real[0];
      for (int g = 1; g < kColumns; ++g) {
        const std::complex<float> wave = kWaves.at(dx, g);
        sum += 2.0f * (wave.real() * row_real[g] - wave.imag() * row_imaginary[g]);
      }
      if (sum * scale > best.correlation) best = {sum * scale, dx * kCell, dy * kCell};
    }
  }
  return best;
}

}  // namespace intensity_place_recognition
