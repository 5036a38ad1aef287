// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <vector>

namespace intensity_place_recognition {

/// Vectors that are found by their neighbourhood. It grows one by one. Few are compared with one by one; many
/// are in FLANN's forest of randomised k-d trees (Muja and Lowe 2014), which finds nearly all of the nearest.
class PlaceIndex {
 public:
  PlaceIndex();
  ~PlaceIndex();
  PlaceIndex(PlaceIndex&&) noexcept;
  PlaceIndex& operator=(PlaceIndex&&) noexcept;

  /// @param key of the same size as the others. @throws std::invalid_argument where it isn't
  void add(std::vector<float> key);
  std::size_t size() const { return keys_.size(); }
  const std::vector<float>& key(std::size_t number) const { return keys_.at(number); }
  /// Changes a key a little, so that it remains in its neighbourhood. @throws as add
  void move(std::size_t number, const std::vector<float>& key);
  /// The nearest by Euclidean distance among the first `before`, nearest first; of equally near ones the
  /// first added first.
  std::vector<std::size_t> nearest(const std::vector<float>& key, std::size_t count,
                                   std::size_t before = SIZE_MAX) const;

 private:
  struct Forest;
  std::deque<std::vector<float>> keys_;  // the forest points into it
  std::unique_ptr<Forest> forest_;
};

}  // namespace intensity_place_recognition
