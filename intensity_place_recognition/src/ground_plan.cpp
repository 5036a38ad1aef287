// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/ground_plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>

#include "vectorised.h"

namespace intensity_place_recognition {
namespace {

constexpr int kCells = 64;                // of 1 m, of the plan's side
constexpr int kFrequencies = kCells / 2;  // along x from 0; along y as many, and their negatives
constexpr int kBlock = kFrequencies / 2;  // neighbours along x; the first are the low ones
constexpr int kMostShifts = kCells / 4;   // cells to either side
constexpr int kPadded = kMostShifts / 8 * 8 + 8;
constexpr float kUpper = 1.0f;                  // m above the sensor: upper floors and crowns
constexpr float kUpright = 0.9f, kFlat = 0.5f;  // of the normals of walls, and of their flatness
constexpr int kChannels = 4;                    // what stands where; light: ground, lower, upper
constexpr int kRow = 2 * kBlock;                // of real, then of imaginary parts
constexpr int kSign = kChannels * kRow;

// Of the real parts of a row of the spectrum. Low frequencies are the first.
constexpr int rowAt(int block, int f, bool negative, int channel) {
  return ((block * kFrequencies + f) * 2 + negative) * kSign + channel * kRow;
}
constexpr int kSize = rowAt(2, 0, false, 0);

// exp(i 2 pi k / kCells), and of shifts by one and two cells with the frequencies along x.
struct Waves {
  using Shifts = std::array<std::array<float, kPadded>, kFrequencies>;
  std::array<float, kCells> cosine, sine;
  std::array<Shifts, 2> cosines, sines;
  Waves() {
    for (int k = 0; k < kCells; ++k) {
      cosine[k] = static_cast<float>(std::cos(2.0 * M_PI * k / kCells));
      sine[k] = static_cast<float>(std::sin(2.0 * M_PI * k / kCells));
    }
    for (int step = 1; step <= 2; ++step) {
      for (int g = 0; g < kFrequencies; ++g) {
        for (int d = 0; d < kPadded; ++d) {
          cosines[step - 1][g][d] = cosine[step * d * g % kCells];
          sines[step - 1][g][d] = sine[step * d * g % kCells];
        }
      }
    }
  }
};
const Waves& waves() {
  static const Waves kWaves;
  return kWaves;
}

// Of two spectra, frequencies along y x along x: each frequency along y together with its negative, their
// sums for the cosine, their differences for the sine.
struct Products {
  using Rows = std::array<std::array<float, kFrequencies>, kFrequencies>;
  Rows sum_real, sum_imaginary, difference_real, difference_imaginary;
};

// @param blocks 1: the low frequencies alone
INTENSITY_PLACE_RECOGNITION_VECTORISED
void multiply(const std::int16_t* query, const std::int8_t* place, int blocks, float step, const float* steps,
              Products& out) {
  for (int block = 0; block < blocks; ++block) {
    for (int f = 0; f < blocks * kBlock; ++f) {
      float sum_real[kBlock] = {}, sum_imaginary[kBlock] = {}, difference_real[kBlock] = {},
            difference_imaginary[kBlock] = {};
      for (int c = 0; c < kChannels; ++c) {
        const std::int8_t* p = place + rowAt(block, f, false, c);
        const std::int16_t* q = query + rowAt(block, f, false, c);
        for (int g = 0; g < kBlock; ++g) {
          const float a = p[g], b = p[kBlock + g], x = q[g], y = q[kBlock + g];
          const float k = p[kSign + g], l = p[kSign + kBlock + g], u = q[kSign + g],
                      v = q[kSign + kBlock + g];
          const float r = a * x + b * y, i = b * x - a * y, s = k * u + l * v, j = l * u - k * v;
          sum_real[g] += r + s;
          sum_imaginary[g] += i + j;
          difference_real[g] += r - s;
          difference_imaginary[g] += i - j;
        }
      }
      const float scale = step * steps[block * kFrequencies + f],
                  once = f == 0 ? 0.5f * scale : scale;  // which is its own negative
      for (int g = 0; g < kBlock; ++g) {
        out.sum_real[f][block * kBlock + g] = once * sum_real[g];
        out.sum_imaginary[f][block * kBlock + g] = once * sum_imaginary[g];
        out.difference_real[f][block * kBlock + g] = scale * difference_real[g];
        out.difference_imaginary[f][block * kBlock + g] = scale * difference_imaginary[g];
      }
    }
  }
}

// Back to (2 shifts + 1) x (2 shifts + 1) shifts of `step` cells.
INTENSITY_PLACE_RECOGNITION_VECTORISED
void toShifts(const Products& products, int blocks, int step, int shifts, const Waves& wave, float* map) {
  const int columns = blocks * kBlock, side = 2 * shifts + 1, padded = (shifts + 8) / 8 * 8;
  const Waves::Shifts &cosines = wave.cosines[step - 1], &sines = wave.sines[step - 1];
  for (int dy = 0; dy <= shifts; ++dy) {
    float even_real[kFrequencies] = {}, even_imaginary[kFrequencies] = {}, odd_real[kFrequencies] = {},
          odd_imaginary[kFrequencies] = {};
    for (int f = 0; f < columns; ++f) {
      const int k = step * dy * f % kCells;
      const float c = wave.cosine[k], s = wave.sine[k];
      for (int g = 0; g < columns; ++g) {
        even_real[g] += c * products.sum_real[f][g];
        even_imaginary[g] += c * products.sum_imaginary[f][g];
        odd_real[g] += s * products.difference_real[f][g];
        odd_imaginary[g] += s * products.difference_imaginary[f][g];
      }
    }
    for (const int sign : {1, -1}) {
      const auto by = static_cast<float>(sign);
      float even[kPadded] = {}, odd[kPadded] = {};
      for (int g = 0; g < columns; ++g) {
        const float twice = g == 0 ? 1.0f : 2.0f;
        const float real = twice * (even_real[g] - by * odd_imaginary[g]),
                    imaginary = twice * (even_imaginary[g] + by * odd_real[g]);
        for (int d = 0; d < padded; ++d) {
          even[d] += real * cosines[g][d];
          odd[d] += imaginary * sines[g][d];
        }
      }
      float* row = map + (shifts + sign * dy) * side + shifts;
      for (int d = 0; d <= shifts; ++d) {
        row[d] = even[d] - odd[d];
        row[-d] = even[d] + odd[d];
      }
    }
  }
}

std::int16_t rounded(float value) {
  return static_cast<std::int16_t>(value + (value < 0.0f ? -0.5f : 0.5f));
}

// Of the parabola through three values, the middle of which is the largest: -0.5 to 0.5.
float vertex(float before, float at, float after) {
  const float bend = before - 2.0f * at + after;
  return bend < 0.0f ? std::clamp(0.5f * (before - after) / bend, -0.5f, 0.5f) : 0.0f;
}

// Of patches that are in a cell of the plan.
struct Cell {
  float weight = 0.0f, sum = 0.0f;  // the latter of intensities
  void add(float part, float intensity) {
    weight += part;
    sum += part * intensity;
  }
};

// What stands where, around its mean, and light of the ground; light of what is lower, and of what is upper.
INTENSITY_PLACE_RECOGNITION_VECTORISED
void fillPlanes(const Cell* cells, float* first, float* second) {
  constexpr int kAll = kCells * kCells;
  const Cell *ground = cells + kAll, *lower = cells + 2 * kAll, *upper = cells + 3 * kAll;
  for (int i = 0; i < kAll; ++i) {
    first[2 * i] = std::sqrt(lower[i].weight + upper[i].weight);
    first[2 * i + 1] = ground[i].sum / std::max(1.0f, ground[i].weight);
    second[2 * i] = lower[i].sum / std::max(1.0f, lower[i].weight);
    second[2 * i + 1] = upper[i].sum / std::max(1.0f, upper[i].weight);
  }
  float mean = 0.0f;
  for (int i = 0; i < kAll; ++i) mean += first[2 * i] / kAll;
  for (int i = 0; i < kAll; ++i) first[2 * i] -= mean;
}

// Of the real and of the imaginary parts.
std::array<float, 2> lengthsOf(const float* z) {
  std::array<float, 2> squares{};
  for (int i = 0; i < 2 * kCells * kCells; i += 2)
    for (const int k : {0, 1}) squares[k] += z[i + k] * z[i + k];
  return {std::sqrt(squares[0]), std::sqrt(squares[1])};
}

constexpr float kSteps =
    32766.0f / kCells;  // of 1: as large as a frequency can be, by all cells' length of 1

// A row of the spectra of two channels from that of one as the real and the other as the imaginary part.
// @param mirrored that of the negative frequency along y
INTENSITY_PLACE_RECOGNITION_VECTORISED
void separate(const float* row, const float* mirrored, const std::array<float, 2>& scale, std::int16_t* to) {
  float back[2 * kFrequencies];  // the negative frequencies along x
  for (int g = 0; g < kFrequencies; ++g) {
    back[2 * g] = mirrored[2 * ((kCells - g) % kCells)];
    back[2 * g + 1] = mirrored[2 * ((kCells - g) % kCells) + 1];
  }
  for (int block = 0; block < 2; ++block) {
    std::int16_t* at = to + rowAt(block, 0, false, 0);
    for (int i = 0; i < kBlock; ++i) {
      const int g = 2 * (block * kBlock + i);
      at[i] = rounded(scale[0] * (row[g] + back[g]));
      at[kBlock + i] = rounded(scale[0] * (row[g + 1] - back[g + 1]));
      at[kRow + i] = rounded(scale[1] * (row[g + 1] + back[g + 1]));
      at[kRow + kBlock + i] = rounded(scale[1] * (back[g] - row[g]));
    }
  }
}

}  // namespace

WallDirections::WallDirections(const Shape& shape) {
  std::array<float, kSteps> parts{};
  for (const Patch& p : shape.patches()) {
    const float flat = p.normal.head<2>().norm();
    if (flat < kUpright || p.flatness < kFlat) continue;
    const Eigen::Vector3f facing = p.normal.dot(p.point) > 0.0f ? Eigen::Vector3f(-p.normal) : p.normal;
    const double step = std::atan2(facing.y(), facing.x()) / (2.0 * M_PI) * kSteps + kSteps;
    const int below = static_cast<int>(step);
    const float part = static_cast<float>(step - below);
    parts[below % kSteps] += p.flatness * (1.0f - part);
    parts[(below + 1) % kSteps] += p.flatness * part;
  }
  const float most = std::max(1e-6f, *std::max_element(parts.begin(), parts.end()));
  for (int i = 0; i < kSteps; ++i) part_[i] = static_cast<std::uint8_t>(255.0f * parts[i] / most + 0.5f);
}

double WallDirections::bestYaw(const WallDirections& place, double likely, double reach) const {
  constexpr double kStep = 2.0 * M_PI / kSteps;
  const int middle = static_cast<int>(std::lround(likely / kStep)),
            most = static_cast<int>(reach / kStep) + 1;
  std::array<std::uint8_t, 2 * kSteps> there;  // twice around
  std::copy(place.part_.begin(), place.part_.end(), there.begin());
  std::copy(place.part_.begin(), place.part_.end(), there.begin() + kSteps);
  std::vector<float> products(2 * most + 1);
  for (int i = 0; i <= 2 * most; ++i) {
    const int turn = ((middle + i - most) % kSteps + kSteps) % kSteps;
    int sum = 0;
    for (int k = 0; k < kSteps; ++k) sum += part_[k] * there[turn + k];
    products[i] = static_cast<float>(sum);
  }
  const auto best = std::max_element(products.begin() + 1, products.end() - 1);
  const int at = static_cast<int>(best - products.begin());
  return (middle + at - most + vertex(products[at - 1], *best, products[at + 1])) * kStep;
}

GroundPlan::GroundPlan(const Shape& shape, double yaw) : spectrum_(kSize) {
  std::vector<Cell> cells(kChannels * kCells * kCells);
  const float middle = 0.5f * (kCells - 1);
  const float cosine = static_cast<float>(std::cos(yaw)), sine = static_cast<float>(std::sin(yaw));
  for (const Patch& p : shape.patches()) {
    const float x = cosine * p.point.x() - sine * p.point.y() + middle,
                y = sine * p.point.x() + cosine * p.point.y() + middle;
    if (!(x >= 0.0f && y >= 0.0f && x < kCells - 1 && y < kCells - 1)) continue;
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const float right = x - static_cast<float>(column), up = y - static_cast<float>(row);
    const int channel = p.isLevel() ? 1 : p.point.z() < kUpper ? 2 : 3;
    Cell* at = &cells[(channel * kCells + row) * kCells + column];
    at[0].add((1.0f - right) * (1.0f - up), p.intensity);
    at[1].add(right * (1.0f - up), p.intensity);
    at[kCells].add((1.0f - right) * up, p.intensity);
    at[kCells + 1].add(right * up, p.intensity);
  }
  // Two channels at once, as the real and the imaginary part.
  std::array<cv::Mat2f, kChannels / 2> both;
  for (cv::Mat2f& z : both) z.create(kCells, kCells);
  fillPlanes(cells.data(), both[0].ptr<float>(), both[1].ptr<float>());
  step_ = 1.0f / kSteps;
  for (int c = 0; c < kChannels; c += 2) {
    cv::Mat2f& z = both[c / 2];
    std::array<float, 2> scale = lengthsOf(z.ptr<float>());
    for (float& value : scale) value = 0.5f * kSteps / std::max(1e-9f, value);
    cv::dft(z, z);
    for (int f = 1 - kFrequencies; f < kFrequencies; ++f)
      separate(z.ptr<float>((f + kCells) % kCells), z.ptr<float>((kCells - f) % kCells), scale,
               &spectrum_[rowAt(0, std::abs(f), f < 0, c)]);
  }
  for (int block = 0; block < 2; ++block)
    std::copy_n(&spectrum_[rowAt(block, 0, false, 0)], kSign, &spectrum_[rowAt(block, 0, true, 0)]);
}

GroundPlan GroundPlan::halfTurned() const {
  GroundPlan turned = *this;
  for (int f = 1 - kFrequencies; f < kFrequencies; ++f) {
    for (int g = 0; g < kFrequencies; ++g) {
      const int k = (f + g + kCells) % kCells;  // the cells' middle is between two of them
      const float cosine = waves().cosine[k], sine = waves().sine[k];
      for (int c = 0; c < kChannels; ++c) {
        const int at = rowAt(g / kBlock, std::abs(f), f < 0, c) + g % kBlock;
        const float real = spectrum_[at], imaginary = spectrum_[at + kBlock];
        turned.spectrum_[at] = rounded(cosine * real + sine * imaginary);
        turned.spectrum_[at + kBlock] = rounded(sine * real - cosine * imaginary);
      }
    }
  }
  for (int block = 0; block < 2; ++block)
    std::copy_n(&turned.spectrum_[rowAt(block, 0, false, 0)], kSign,
                &turned.spectrum_[rowAt(block, 0, true, 0)]);
  return turned;
}

PackedPlan::PackedPlan(const GroundPlan& plan) : spectrum_(plan.spectrum_.size()) {
  // The parts of a frequency along y, of both signs and all channels, follow one another.
  const std::size_t size = rowAt(0, 1, false, 0);
  for (std::size_t first = 0; first < spectrum_.size(); first += size) {
    const std::int16_t* from = &plan.spectrum_[first];
    int largest = 1;
    for (std::size_t i = 0; i < size; ++i) largest = std::max(largest, std::abs(static_cast<int>(from[i])));
    const float scale = 127.0f / static_cast<float>(largest);
    steps_.push_back(plan.step_ / scale);
    for (std::size_t i = 0; i < size; ++i)
      spectrum_[first + i] = static_cast<std::int8_t>(rounded(scale * static_cast<float>(from[i])));
  }
}

std::size_t PackedPlan::bytes() const {
  return sizeof(*this) + spectrum_.capacity() + steps_.capacity() * sizeof(float);
}

std::vector<float> GroundPlan::correlations(const PackedPlan& place, int step, int shifts,
                                            bool roughly) const {
  Products products;
  const int side = 2 * shifts + 1;
  std::vector<float> map(static_cast<std::size_t>(side) * side);
  const int blocks = roughly ? 1 : 2;
  multiply(spectrum_.data(), place.spectrum_.data(), blocks, step_ / (kChannels * kCells * kCells),
           place.steps_.data(), products);
  toShifts(products, blocks, step, shifts, waves(), map.data());
  return map;
}

GroundPlan::Shift GroundPlan::roughShift(const PackedPlan& place, float reach) const {
  constexpr int kStep = 2;
  const int shifts = std::clamp(static_cast<int>(std::ceil(reach / kStep)), 0, kMostShifts / kStep);
  const std::vector<float> map = correlations(place, kStep, shifts, true);
  const auto best = std::max_element(map.begin(), map.end());
  const int at = static_cast<int>(best - map.begin()), side = 2 * shifts + 1;
  return {*best, static_cast<float>(kStep * (at % side - shifts)),
          static_cast<float>(kStep * (at / side - shifts))};
}

std::vector<GroundPlan::Shift> GroundPlan::bestShifts(const PackedPlan& place, float reach,
                                                      std::size_t count) const {
  const int shifts = std::clamp(static_cast<int>(std::ceil(reach)), 0, kMostShifts), side = 2 * shifts + 1;
  const std::vector<float> map = correlations(place, 1, shifts, false);
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
