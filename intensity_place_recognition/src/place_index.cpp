// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/place_index.h"

#include <Eigen/Core>
#include <algorithm>
#include <flann/flann.hpp>
#include <stdexcept>
#include <utility>

namespace intensity_place_recognition {
namespace {

constexpr std::size_t kFew = 2000;  // up to here comparing with all is as fast
constexpr int kTrees = 4, kChecks = 1024;
constexpr float kRebuild = 2.0f;  // times as large as when it was balanced

float squaredDistance(const std::vector<float>& a, const std::vector<float>& b) {
  const auto size = static_cast<Eigen::Index>(a.size());
  return (Eigen::Map<const Eigen::VectorXf>(a.data(), size) -
          Eigen::Map<const Eigen::VectorXf>(b.data(), size))
      .squaredNorm();
}

flann::Matrix<float> rowOf(const std::vector<float>& key) {
  return {const_cast<float*>(key.data()), 1, key.size()};
}

}  // namespace

struct PlaceIndex::Forest : flann::Index<flann::L2<float>> {
  explicit Forest(const std::vector<float>& first)
      : flann::Index<flann::L2<float>>(rowOf(first), flann::KDTreeIndexParams(kTrees)) {
    flann::seed_random(1);  // the same keys make the same forest
    buildIndex();
  }
};

PlaceIndex::PlaceIndex() = default;
PlaceIndex::~PlaceIndex() = default;
PlaceIndex::PlaceIndex(PlaceIndex&&) noexcept = default;
PlaceIndex& PlaceIndex::operator=(PlaceIndex&&) noexcept = default;

void PlaceIndex::add(std::vector<float> key) {
  if (key.empty() || (!keys_.empty() && key.size() != keys_.front().size()))
    throw std::invalid_argument("keys have to be of the same size");
  keys_.push_back(std::move(key));
  if (forest_) {
    forest_->addPoints(rowOf(keys_.back()), kRebuild);
  } else if (keys_.size() > kFew) {
    forest_ = std::make_unique<Forest>(keys_.front());
    for (std::size_t i = 1; i < keys_.size(); ++i) forest_->addPoints(rowOf(keys_[i]), kRebuild);
  }
}

void PlaceIndex::move(std::size_t number, const std::vector<float>& key) {
  if (key.size() != keys_.at(number).size()) throw std::invalid_argument("keys have to be of the same size");
  std::copy(key.begin(), key.end(), keys_[number].begin());  // which stays where the forest finds it
}

std::vector<std::size_t> PlaceIndex::nearest(const std::vector<float>& key, std::size_t count,
                                             std::size_t before) const {
  before = std::min(before, keys_.size());
  if (before == 0) return {};
  if (key.size() != keys_.front().size()) throw std::invalid_argument("keys have to be of the same size");
  std::vector<std::pair<float, std::size_t>> found;
  if (forest_ && before > kFew) {
    std::vector<std::vector<std::size_t>> indices;
    std::vector<std::vector<float>> distances;
    // Of those that were added later none may crowd out earlier ones.
    forest_->knnSearch(rowOf(key), indices, distances, count + keys_.size() - before,
                       flann::SearchParams(kChecks));
    for (std::size_t i = 0; i < indices[0].size(); ++i)
      if (indices[0][i] < before) found.emplace_back(distances[0][i], indices[0][i]);
  } else {
    for (std::size_t i = 0; i < before; ++i) found.emplace_back(squaredDistance(key, keys_[i]), i);
  }
  const std::size_t kept = std::min(count, found.size());
  std::partial_sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(kept), found.end());
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < kept; ++i) result.push_back(found[i].second);
  return result;
}

}  // namespace intensity_place_recognition
