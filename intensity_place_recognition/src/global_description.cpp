// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/global_description.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace intensity_place_recognition {
namespace {

constexpr int kKeyFrequencies = 4;       // of each group of rows
constexpr int kKeyRows = 32;             // groups of neighbouring rows at most
constexpr std::size_t kLeastPlace = 40;  // bytes of a place in a file, at least

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
  std::vector<std::complex<float>> sum(half());
  cv::Mat2f spectrum(1, columns_);
  cv::Mat1f turned;
  for (int v = 0; v < views_; ++v) {
    for (int w = 0; w < views_; ++w) {
      // Both are spectra of real rows; the sum over all rows is one, too.
      std::fill(sum.begin(), sum.end(), 0.0f);
      const std::complex<float>*a = view(v), *b = other.view(w);
      for (int r = 0; r < rows_; ++r, a += half(), b += half()) {
        for (int f = 0; f < half(); ++f) {
          sum[f] += std::complex<float>(a[f].real() * b[f].real() + a[f].imag() * b[f].imag(),
                                        a[f].real() * b[f].imag() - a[f].imag() * b[f].real());
        }
      }
      for (int f = 0; f < columns_; ++f) {
        const std::complex<float> value = f < half() ? sum[f] : std::conj(sum[columns_ - f]);
        spectrum(0, f) = {value.real(), value.imag()};
      }
      cv::dft(spectrum, turned, cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
      float* at = &result[static_cast<std::size_t>((w - v + views_) % views_) * columns_];
      for (int i = 0; i < columns_; ++i) at[i] = std::max(at[i], turned(0, i));
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
