// SPDX-License-Identifier: BSD-3-Clause
//
// Global descriptions (4.5.2): a matrix with a column for each direction of azimuth. Where the sensor is
// turned, its columns move in a circle; so the cosine similarity at all turns is a circular correlation,
// which the Fourier transform of the rows makes a product, and the magnitudes of that transform don't change
// at all. A view has one column, and turns are those from view to view.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "intensity_place_recognition/place_index.h"
#include "intensity_place_recognition/scene_description.h"

namespace intensity_place_recognition {

class PackedSignature;

class GlobalSignature : public Signature {
 public:
  GlobalSignature() = default;
  /// @param views features x directions, all of the same size; column i is about the azimuth
  ///   pi - (i + 0.5) * 2 pi / columns, as in a panorama. Rows' means are left out where there are several
  ///   columns: they say nothing about directions. Several views are evenly around the sensor.
  /// @throws std::invalid_argument if all columns are alike
  explicit GlobalSignature(const std::vector<cv::Mat1f>& views);

  /// The cosine similarity to `other` turned by each step, -1 to 1, that of the view that is the most alike.
  /// At s, what is in column (or view) i of this is in column i + s of `other`.
  std::vector<float> similarities(const GlobalSignature& other) const;
  std::vector<float> similarities(const PackedSignature& other) const;
  template <class Other>
  std::vector<Turn> bestTurns(const Other& other, std::size_t count) const {
    return intensity_place_recognition::bestTurns(similarities(other), count);
  }

  /// Of length 1, the same however the sensor is turned: the magnitudes of the lowest frequencies of
  /// neighbouring rows.
  const std::vector<float>& key() const { return key_; }
  /// As files of version 1 have it.
  /// @throws std::runtime_error where it isn't sound
  void readComplex(mapping_common::ArchiveReader& in);

 private:
  friend class PackedSignature;
  int half() const { return columns_ / 2 + 1; }
  void addView(const cv::Mat1f& description);
  template <class Other>
  std::vector<float> compared(const Other& other, float step) const;
  int views_ = 0, rows_ = 0, columns_ = 0;
  std::vector<float> spectrum_;  // views x rows x (real, imaginary) x half(), of descriptions of length 1
  std::vector<float> key_;
};

/// A description as places keep it, in a quarter of the memory.
class PackedSignature {
 public:
  PackedSignature() = default;
  explicit PackedSignature(const GlobalSignature& signature);
  /// Without its key.
  GlobalSignature unpacked() const;
  bool isLike(const PackedSignature& other) const {
    return views_ == other.views_ && rows_ == other.rows_ && columns_ == other.columns_;
  }
  /// What was read from a file may not be.
  bool isSound() const;
  /// That it takes in memory.
  std::size_t bytes() const { return sizeof(*this) + spectrum_.capacity(); }

  template <class Archive>
  void transfer(Archive& archive) {
    archive(views_);
    archive(rows_);
    archive(columns_);
    archive(step_);
    archive(spectrum_);
  }

 private:
  friend class GlobalSignature;
  int views_ = 0, rows_ = 0, columns_ = 0;
  float step_ = 0.0f;  // that its values are multiples of
  std::vector<std::int8_t> spectrum_;
};

/// Places that are looked up by the neighbourhood of their keys, and compared at all turns.
class GlobalDescription : public SceneDescription {
 public:
  std::shared_ptr<const Signature> describe(const Scene& scene) const override {
    return std::make_shared<GlobalSignature>(matrices(scene));
  }
  void add(const std::shared_ptr<const Signature>& signature) override;
  int places() const override { return static_cast<int>(places_.size()); }
  std::vector<Candidate> candidates(const Signature& signature, int before, int count,
                                    int turns) const override;
  float similarity(int a, int b) const override;
  void write(mapping_common::ArchiveWriter& out) const override;
  void read(mapping_common::ArchiveReader& in) override;

 private:
  /// Of one view or several, see GlobalSignature.
  virtual std::vector<cv::Mat1f> matrices(const Scene& scene) const = 0;
  void add(PackedSignature place, std::vector<float> key);
  std::deque<PackedSignature> places_;
  PlaceIndex index_;
};

/// Those of views, which become columns where they aren't panoramas.
template <class Describe>
std::vector<cv::Mat1f> ofEachView(const Scene& scene, const Describe& describe) {
  std::vector<cv::Mat1f> all;
  for (const View& view : scene.views()) {
    const cv::Mat1f description = describe(view);
    all.push_back(view.isPanorama()
                      ? description
                      : cv::Mat1f(description.reshape(1, static_cast<int>(description.total()))));
  }
  return all;
}

}  // namespace intensity_place_recognition
