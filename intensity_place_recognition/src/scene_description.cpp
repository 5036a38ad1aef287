// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/scene_description.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace intensity_place_recognition {
namespace {

constexpr int kKeyFrequencies = 4;    // of each group of rows
constexpr int kKeyRows = 32;          // groups of neighbouring rows at most
constexpr double kNearTurn = 0.2618;  // rad
constexpr float kRangeScale = 20.0f;  // m

}  // namespace

void DescriptionOptions::describe(mapping_common::OptionList& o) {
  o("type", type, "", "how a scene is described").oneOf(sceneDescriptions());
  o("image", image, "", "of the panorama, for hog and gist");
  o("cell", cell, "pixels", "L, width and height of a cell of hog").within(2, 512);
  o("sigma", sigma, "pixels", "of the Gaussian filter before hog; 0: none").within(0.0, 50.0);
  o("blocks", blocks, "", "phi, rows of gist's grid").within(1, 64);
  o("scales", scales, "", "Omega, of gist's filters").within(1, 6);
  o("orientations", orientations, "", "chi, for each scale of gist").within(1, 32);
  o("rings", rings, "", "of polar, from the sensor outwards").within(2, 200);
  o("directions", directions, "", "of polar and gist, of a whole turn").within(12, 720);
  o("radius", radius, "m", "of polar").within(1.0, 1000.0);
}

const mapping_common::Table<MakeDescription>& sceneDescriptions() {
  static const mapping_common::Table<MakeDescription> kTable = {
      {"polar", makePolar, "height and intensity over a polar grid of the ground"},
      {"hog", makeHog, "global histograms of oriented gradients of the panorama"},
      {"gist", makeGist, "global responses of Gabor filters to the panorama"},
  };
  return kTable;
}

std::unique_ptr<SceneDescription> makeDescription(const DescriptionOptions& options) {
  return valueOf(sceneDescriptions(), options.type)(mapping_common::validate(options));
}

cv::Mat1f normalizedImage(const Panorama& panorama, Image image) {
  cv::Mat1f result(panorama.mask.size(), 0.0f);
  std::vector<float> seen;
  const auto first = panorama.intensity.begin();
  for (int i = 0; i < static_cast<int>(panorama.mask.total()); ++i)
    if (panorama.mask.begin()[i] == 255) seen.push_back(first[i]);
  std::sort(seen.begin(), seen.end());
  for (int i = 0; i < static_cast<int>(panorama.mask.total()); ++i) {
    if (panorama.mask.begin()[i] == 0) continue;
    if (image == Image::kRange) {
      result.begin()[i] = 1.0f - std::exp(-panorama.range.begin()[i] / kRangeScale);
    } else {
      const auto [low, high] = std::equal_range(seen.begin(), seen.end(), first[i]);
      result.begin()[i] = 0.5f * static_cast<float>((low - seen.begin()) + (high - seen.begin())) /
                          static_cast<float>(seen.size());
    }
  }
  return result;
}

Signature::Signature(const cv::Mat1f& description) : rows_(description.rows), columns_(description.cols) {
  cv::Mat1f centred = description.clone(), means;
  cv::reduce(centred, means, 1, cv::REDUCE_AVG);
  for (int r = 0; r < rows_; ++r) centred.row(r) -= means(r, 0);
  const double length = cv::norm(centred);
  if (!(length > 1e-6)) throw std::invalid_argument("the scene looks the same in all directions");
  centred /= length;
  cv::Mat2f full;
  cv::dft(centred, full, cv::DFT_ROWS | cv::DFT_COMPLEX_OUTPUT);
  const int half = columns_ / 2 + 1;
  spectrum_.resize(static_cast<std::size_t>(rows_) * half);
  for (int r = 0; r < rows_; ++r)
    for (int f = 0; f < half; ++f) spectrum_[r * half + f] = {full(r, f)[0], full(r, f)[1]};

  const int groups = std::min(rows_, kKeyRows), frequencies = std::min(kKeyFrequencies, half);
  key_.assign(static_cast<std::size_t>(groups) * frequencies, 0.0f);
  const float mean_scale = static_cast<float>(columns_ / length / std::sqrt(columns_));
  for (int r = 0; r < rows_; ++r) {
    float* at = &key_[static_cast<std::size_t>(r * groups / rows_) * frequencies];
    at[0] += std::abs(means(r, 0)) * mean_scale;
    for (int f = 1; f < frequencies; ++f) at[f] += std::abs(spectrum_[r * half + f]);
  }
  const float norm = std::sqrt(std::inner_product(key_.begin(), key_.end(), key_.begin(), 0.0f));
  for (float& value : key_) value /= norm;
}

bool Signature::isSound() const {
  const auto finite = [](float value) { return std::isfinite(value); };
  return rows_ > 0 && columns_ > 0 && !key_.empty() && std::all_of(key_.begin(), key_.end(), finite) &&
         spectrum_.size() == static_cast<std::size_t>(rows_) * (columns_ / 2 + 1) &&
         std::all_of(spectrum_.begin(), spectrum_.end(),
                     [&](const std::complex<float>& c) { return finite(c.real()) && finite(c.imag()); });
}

std::vector<float> Signature::similarities(const Signature& other) const {
  if (rows_ != other.rows_ || columns_ != other.columns_)
    throw std::invalid_argument("descriptions of different sizes can't be compared");
  const int half = columns_ / 2 + 1;
  // Both are spectra of real rows; the sum over all rows is one, too.
  std::vector<std::complex<float>> sum(half);
  for (int r = 0; r < rows_; ++r) {
    const std::complex<float>*a = &spectrum_[r * half], *b = &other.spectrum_[r * half];
    for (int f = 0; f < half; ++f) {
      sum[f] += std::complex<float>(a[f].real() * b[f].real() + a[f].imag() * b[f].imag(),
                                    a[f].real() * b[f].imag() - a[f].imag() * b[f].real());
    }
  }
  cv::Mat2f spectrum(1, columns_);
  for (int f = 0; f < columns_; ++f) {
    const std::complex<float> value = f < half ? sum[f] : std::conj(sum[columns_ - f]);
    spectrum(0, f) = {value.real(), value.imag()};
  }
  cv::Mat1f result;
  cv::dft(spectrum, result, cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
  return {result.begin(), result.end()};
}

std::vector<Signature::Turn> Signature::bestTurns(const Signature& other, std::size_t count) const {
  const std::vector<float> all = similarities(other);
  const double step = 2.0 * M_PI / columns_;
  const int reach = std::max(1, static_cast<int>(kNearTurn / step));
  std::vector<Turn> turns;
  for (int s = 0; s < columns_; ++s) {
    const auto at = [&](int i) { return all[(i + columns_) % columns_]; };
    bool largest = true;
    for (int d = 1; d <= reach; ++d) largest = largest && at(s - d) < at(s) && at(s + d) <= at(s);
    if (!largest) continue;
    // The parabola through the largest and its neighbours.
    const double bend = at(s - 1) - 2.0 * at(s) + at(s + 1);
    const double fraction = bend < 0.0 ? 0.5 * (at(s - 1) - at(s + 1)) / bend : 0.0;
    // Column i of this is column i + s of the other: azimuths there are smaller by s steps.
    turns.push_back({at(s), std::remainder(-(s + fraction) * step, 2.0 * M_PI)});
  }
  std::sort(turns.begin(), turns.end(),
            [](const Turn& a, const Turn& b) { return a.similarity > b.similarity; });
  if (turns.size() > count) turns.resize(count);
  return turns;
}

}  // namespace intensity_place_recognition
