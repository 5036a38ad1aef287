// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/global_description.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

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

// The correlation of rows at all steps, from their spectra a and b, rows x (real, imaginary).
INTENSITY_PLACE_RECOGNITION_VECTORISED
void correlate(const float* a, const float* b, int rows, const Waves& waves, float* buffer,
               std::vector<float>& result) {
  const int half = waves.half, columns = waves.columns;
  float *real = buffer, *imaginary = real + half, *even = imaginary + half, *odd = even + half;
  std::fill(buffer, buffer + 4 * half, 0.0f);
  for (int r = 0; r < rows; ++r, a += 2 * half, b += 2 * half) {
    for (int f = 0; f < half; ++f) {
      real[f] += a[2 * f] * b[2 * f] + a[2 * f + 1] * b[2 * f + 1];
      imaginary[f] += a[2 * f] * b[2 * f + 1] - a[2 * f + 1] * b[2 * f];
    }
  }
  for (int f = 0; f < half; ++f) {
    const float *cosine = &waves.cosines[f * half], *sine = &waves.sines[f * half];
    for (int i = 0; i < half; ++i) {
      even[i] += real[f] * cosine[i];
      odd[i] += imaginary[f] * sine[i];
    }
  }
  for (int i = 0; i < half; ++i) {
    result[i] = even[i] - odd[i];
    result[(columns - i) % columns] = even[i] + odd[i];
  }
}

}  // namespace

GlobalSignature::GlobalSignature(const std::vector<cv::Mat1f>& views)
    : views_(static_cast<int>(views.size())), rows_(views.at(0).rows), columns_(views[0].cols) {
  spectrum_.reserve(static_cast<std::size_t>(views_) * rows_ * half());
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
    for (int f = 0; f < half(); ++f) spectrum_.emplace_back(full(r, f)[0], full(r, f)[1]);

  const int groups = std::min(rows_, kKeyRows), frequencies = std::min(kKeyFrequencies, half());
  const float mean_scale = static_cast<float>(columns_ / length / std::sqrt(columns_));
  const std::complex<float>* added =
      spectrum_.data() + spectrum_.size() - static_cast<std::size_t>(rows_) * half();
  for (int r = 0; r < rows_; ++r) {
    float* at = &key_[static_cast<std::size_t>(r * groups / rows_) * frequencies];
    at[0] += std::abs(means(r, 0)) * mean_scale;
    for (int f = 1; f < frequencies; ++f) at[f] += std::abs(added[r * half() + f]);
  }
}

bool GlobalSignature::isSound() const {
  const auto finite = [](float value) { return std::isfinite(value); };
  return views_ > 0 && rows_ > 0 && columns_ > 0 && !key_.empty() &&
         std::all_of(key_.begin(), key_.end(), finite) &&
         spectrum_.size() / rows_ / views_ == static_cast<std::size_t>(half()) &&
         spectrum_.size() % (static_cast<std::size_t>(rows_) * views_) == 0 &&
         std::all_of(spectrum_.begin(), spectrum_.end(),
                     [&](const std::complex<float>& c) { return finite(c.real()) && finite(c.imag()); });
}

std::vector<float> GlobalSignature::similarities(const GlobalSignature& other) const {
  if (!isLike(other)) throw std::invalid_argument("descriptions of different sizes can't be compared");
  std::vector<float> result(static_cast<std::size_t>(views_) * columns_, -1.0f);
  const Waves& waves = wavesOf(columns_);
  std::vector<float> buffer(4 * static_cast<std::size_t>(half())), turned(columns_);
  for (int v = 0; v < views_; ++v) {
    for (int w = 0; w < views_; ++w) {
      correlate(reinterpret_cast<const float*>(view(v)), reinterpret_cast<const float*>(other.view(w)), rows_,
                waves, buffer.data(), turned);
      float* at = &result[static_cast<std::size_t>((w - v + views_) % views_) * columns_];
      for (int i = 0; i < columns_; ++i) at[i] = std::max(at[i], turned[i]);
    }
  }
  return result;
}

void GlobalDescription::add(const std::shared_ptr<const Signature>& signature) {
  const auto& added = dynamic_cast<const GlobalSignature&>(*signature);
  index_.add(added.key());
  places_.push_back(added);
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
  const std::vector<float> all = places_.at(a).similarities(places_.at(b));
  return *std::max_element(all.begin(), all.end());
}

void GlobalDescription::write(mapping_common::ArchiveWriter& out) const {
  out(static_cast<std::uint64_t>(places_.size()));
  for (GlobalSignature place : places_) place.transfer(out);
}

void GlobalDescription::read(mapping_common::ArchiveReader& in) {
  for (std::size_t left = in.count(kLeastPlace); left > 0; --left) {
    auto place = std::make_shared<GlobalSignature>();
    place->transfer(in);
    if (!place->isSound() || (places() > 0 && (!place->isLike(places_.front()) ||
                                               place->key().size() != places_.front().key().size())))
      throw std::runtime_error("a place in it is inconsistent");
    add(place);
  }
}

}  // namespace intensity_place_recognition
