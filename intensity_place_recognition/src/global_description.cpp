// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/global_description.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "vectorised.h"

namespace intensity_place_recognition {
namespace {

constexpr int kKeyFrequencies = 4;       // of each group of rows
constexpr int kKeyRows = 32;             // groups of neighbouring rows at most
constexpr std::size_t kLeastPlace = 40;  // bytes of a place in a file, at least

// Of the transform of real rows: frequencies x steps, each from 0 to a half turn.
struct Waves {
  int columns, half;
  std::vector<float> cosines, sines;
  explicit Waves(int all) : columns(all), half(all / 2 + 1) {
    for (int f = 0; f < half; ++f) {
      // All but the lowest and, where the number is even, the highest stand for their negatives, too.
      const double scale = (f == 0 || 2 * f == columns ? 1.0 : 2.0) / columns;
      for (int i = 0; i < half; ++i) {
        const double angle = 2.0 * M_PI * (f * i % columns) / columns;
        cosines.push_back(static_cast<float>(scale * std::cos(angle)));
        sines.push_back(static_cast<float>(scale * std::sin(angle)));
      }
    }
  }
};
const Waves& wavesOf(int columns) {
  thread_local std::unique_ptr<Waves> waves;
  if (!waves || waves->columns != columns) waves = std::make_unique<Waves>(columns);
  return *waves;
}

// The correlation of rows at all steps, from their spectra a and b, rows x (real, imaginary) x half.
template <class Value>
__attribute__((always_inline)) inline void correlateRows(const float* a, const Value* b, int rows, float step,
                                                         const Waves& waves, float* buffer,
                                                         std::vector<float>& result) {
  const int half = waves.half, columns = waves.columns;
  float *real = buffer, *imaginary = real + half, *even = imaginary + half, *odd = even + half;
  std::fill(buffer, buffer + 4 * half, 0.0f);
  for (int r = 0; r < rows; ++r, a += 2 * half, b += 2 * half) {
    for (int f = 0; f < half; ++f) {
      const float x = a[f], y = a[half + f], u = b[f], v = b[half + f];
      real[f] += x * u + y * v;
      imaginary[f] += x * v - y * u;
    }
  }
  for (int f = 0; f < half; ++f) {
    const float *cosine = &waves.cosines[f * half], *sine = &waves.sines[f * half];
    const float re = step * real[f], im = step * imaginary[f];
    for (int i = 0; i < half; ++i) {
      even[i] += re * cosine[i];
      odd[i] += im * sine[i];
    }
  }
  for (int i = 0; i < half; ++i) {
    result[i] = even[i] - odd[i];
    result[(columns - i) % columns] = even[i] + odd[i];
  }
}

INTENSITY_PLACE_RECOGNITION_VECTORISED
void correlate(const float* a, const float* b, int rows, float step, const Waves& waves, float* buffer,
               std::vector<float>& result) {
  correlateRows(a, b, rows, step, waves, buffer, result);
}

INTENSITY_PLACE_RECOGNITION_VECTORISED
void correlate(const float* a, const std::int8_t* b, int rows, float step, const Waves& waves, float* buffer,
               std::vector<float>& result) {
  correlateRows(a, b, rows, step, waves, buffer, result);
}

// Whether so many values are views x rows x half of the columns.
bool isSize(int views, int rows, int columns, std::size_t values) {
  return views > 0 && rows > 0 && columns > 0 && values % rows == 0 && values / rows % views == 0 &&
         values / rows / views == static_cast<std::size_t>(columns / 2 + 1);
}

}  // namespace

GlobalSignature::GlobalSignature(const std::vector<cv::Mat1f>& views)
    : views_(static_cast<int>(views.size())), rows_(views.at(0).rows), columns_(views[0].cols) {
  spectrum_.reserve(2 * static_cast<std::size_t>(views_) * rows_ * half());
  key_.assign(static_cast<std::size_t>(std::min(rows_, kKeyRows)) * std::min(kKeyFrequencies, half()), 0.0f);
  for (const cv::Mat1f& view : views) addView(view);
  const float norm = std::sqrt(std::inner_product(key_.begin(), key_.end(), key_.begin(), 0.0f));
  for (float& value : key_) value /= norm;
}

void GlobalSignature::addView(const cv::Mat1f& description) {
  cv::Mat1f centred = description.clone(), means;
  cv::reduce(centred, means, 1, cv::REDUCE_AVG);
  for (int r = 0; columns_ > 1 && r < rows_; ++r) centred.row(r) -= means(r, 0);
  const double length = cv::norm(centred);
  if (!(length > 1e-6)) throw std::invalid_argument("the scene looks the same in all directions");
  centred /= length;
  cv::Mat2f full;
  cv::dft(centred, full, cv::DFT_ROWS | cv::DFT_COMPLEX_OUTPUT);
  for (int r = 0; r < rows_; ++r)
    for (const int part : {0, 1})
      for (int f = 0; f < half(); ++f) spectrum_.push_back(full(r, f)[part]);

  const int groups = std::min(rows_, kKeyRows), frequencies = std::min(kKeyFrequencies, half());
  const float mean_scale = static_cast<float>(columns_ / length / std::sqrt(columns_));
  for (int r = 0; r < rows_; ++r) {
    float* at = &key_[static_cast<std::size_t>(r * groups / rows_) * frequencies];
    at[0] += std::abs(means(r, 0)) * mean_scale;
    for (int f = 1; f < frequencies; ++f) at[f] += std::hypot(full(r, f)[0], full(r, f)[1]);
  }
}

void GlobalSignature::readComplex(mapping_common::ArchiveReader& in) {
  in(views_);
  in(rows_);
  in(columns_);
  std::vector<std::complex<float>> values;
  in(values);
  in(key_);
  const auto isFinite = [](float value) { return std::isfinite(value); };
  if (!isSize(views_, rows_, columns_, values.size()) || key_.empty() ||
      !std::all_of(key_.begin(), key_.end(), isFinite))
    throw std::runtime_error("a place in it is inconsistent");
  for (std::size_t row = 0; row < values.size(); row += half()) {
    for (int f = 0; f < half(); ++f) spectrum_.push_back(values[row + f].real());
    for (int f = 0; f < half(); ++f) spectrum_.push_back(values[row + f].imag());
  }
  if (!std::all_of(spectrum_.begin(), spectrum_.end(), isFinite))
    throw std::runtime_error("a place in it is inconsistent");
}

template <class Other>
std::vector<float> GlobalSignature::compared(const Other& other, float step) const {
  if (views_ != other.views_ || rows_ != other.rows_ || columns_ != other.columns_)
    throw std::invalid_argument("descriptions of different sizes can't be compared");
  std::vector<float> result(static_cast<std::size_t>(views_) * columns_, -1.0f);
  const Waves& waves = wavesOf(columns_);
  std::vector<float> buffer(4 * static_cast<std::size_t>(half())), turned(columns_);
  const std::size_t view = 2 * static_cast<std::size_t>(rows_) * half();
  for (int v = 0; v < views_; ++v) {
    for (int w = 0; w < views_; ++w) {
      correlate(&spectrum_[v * view], &other.spectrum_[w * view], rows_, step, waves, buffer.data(), turned);
      float* at = &result[static_cast<std::size_t>((w - v + views_) % views_) * columns_];
      for (int i = 0; i < columns_; ++i) at[i] = std::max(at[i], turned[i]);
    }
  }
  return result;
}

std::vector<float> GlobalSignature::similarities(const GlobalSignature& other) const {
  return compared(other, 1.0f);
}

std::vector<float> GlobalSignature::similarities(const PackedSignature& other) const {
  return compared(other, other.step_);
}

PackedSignature::PackedSignature(const GlobalSignature& signature)
    : views_(signature.views_), rows_(signature.rows_), columns_(signature.columns_) {
  float largest = 1e-12f;
  for (const float value : signature.spectrum_) largest = std::max(largest, std::abs(value));
  step_ = largest / 127.0f;
  spectrum_.reserve(signature.spectrum_.size());
  for (const float value : signature.spectrum_)
    spectrum_.push_back(static_cast<std::int8_t>(std::lround(value / step_)));
}

GlobalSignature PackedSignature::unpacked() const {
  GlobalSignature signature;
  signature.views_ = views_;
  signature.rows_ = rows_;
  signature.columns_ = columns_;
  for (const std::int8_t value : spectrum_) signature.spectrum_.push_back(step_ * static_cast<float>(value));
  return signature;
}

bool PackedSignature::isSound() const {
  return std::isfinite(step_) && spectrum_.size() % 2 == 0 &&
         isSize(views_, rows_, columns_, spectrum_.size() / 2);
}

void GlobalDescription::add(const std::shared_ptr<const Signature>& signature) {
  const auto& added = dynamic_cast<const GlobalSignature&>(*signature);
  add(PackedSignature(added), added.key());
}

void GlobalDescription::add(PackedSignature place, std::vector<float> key) {
  index_.add(std::move(key));
  places_.push_back(std::move(place));
}

std::vector<Candidate> GlobalDescription::candidates(const Signature& signature, int before, int count,
                                                     int turns) const {
  std::vector<Candidate> result;
  if (before <= 0) return result;
  const auto& query = dynamic_cast<const GlobalSignature&>(signature);
  for (const std::size_t i : index_.nearest(query.key(), count, before)) {
    Candidate candidate{static_cast<int>(i), -1.0f, {}};
    for (const Turn& turn : query.bestTurns(places_[i], turns)) {
      candidate.similarity = std::max(candidate.similarity, turn.similarity);
      candidate.yaws.push_back(turn.yaw);
    }
    result.push_back(std::move(candidate));
  }
  return result;
}

float GlobalDescription::similarity(int a, int b) const {
  const std::vector<float> all = places_.at(a).unpacked().similarities(places_.at(b));
  return *std::max_element(all.begin(), all.end());
}

void GlobalDescription::write(mapping_common::ArchiveWriter& out) const {
  out(static_cast<std::uint64_t>(places_.size()));
  for (std::size_t i = 0; i < places_.size(); ++i) {
    PackedSignature place = places_[i];
    place.transfer(out);
    out(index_.key(i));
  }
}

void GlobalDescription::read(mapping_common::ArchiveReader& in) {
  for (std::size_t left = in.count(kLeastPlace); left > 0; --left) {
    PackedSignature place;
    std::vector<float> key;
    if (in.version() == 1) {
      GlobalSignature whole;
      whole.readComplex(in);
      place = PackedSignature(whole);
      key = whole.key();
    } else {
      place.transfer(in);
      in(key);
    }
    if (!place.isSound() || !std::all_of(key.begin(), key.end(), [](float v) { return std::isfinite(v); }) ||
        key.empty() ||
        (places() > 0 && (!place.isLike(places_.front()) || key.size() != index_.key(0).size())))
      throw std::runtime_error("a place in it is inconsistent");
    add(std::move(place), std::move(key));
  }
}

}  // namespace intensity_place_recognition
