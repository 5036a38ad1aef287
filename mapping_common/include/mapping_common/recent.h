// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <iterator>
#include <limits>
#include <utility>
#include <vector>

namespace mapping_common {

/// What went into a map lately, so that it can go into another. Beyond a bound on memory the oldest is
/// forgotten.
template <class T>
class Recent {
 public:
  struct Entry {
    double stamp = 0.0;  ///< s
    std::size_t bytes = 0;
    T value;
  };

  /// @param memory bytes; 0: nothing is kept from now on
  void setMemory(std::size_t memory) {
    memory_ = memory;
    shrink();
  }
  bool keeps() const { return memory_ > 0; }

  /// Stamps that go back, as those of a recording that begins anew, make it forget all.
  void add(double stamp, std::size_t bytes, T value) {
    if (stamp < (entries_.empty() ? missing_ : entries_.back().stamp)) clear();
    entries_.push_back({stamp, bytes, std::move(value)});
    bytes_ += bytes;
    shrink();
  }
  /// The map is another, and has nothing of this in it.
  void clear() {
    entries_.clear();
    bytes_ = 0;
    missing_ = -std::numeric_limits<double>::infinity();
  }

  /// In the order in which they came.
  std::vector<Entry> after(double stamp) const {
    std::vector<Entry> later;
    std::copy_if(entries_.begin(), entries_.end(), std::back_inserter(later),
                 [stamp](const Entry& entry) { return entry.stamp > stamp; });
    return later;
  }
  /// Whether after() has all that there was.
  bool isComplete(double stamp) const { return missing_ <= stamp; }
  std::deque<Entry>& entries() { return entries_; }
  std::size_t bytes() const { return bytes_; }

 private:
  void shrink() {
    while (!entries_.empty() && bytes_ > memory_) {
      missing_ = entries_.front().stamp;
      bytes_ -= entries_.front().bytes;
      entries_.pop_front();
    }
  }

  std::size_t memory_ = 0, bytes_ = 0;
  std::deque<Entry> entries_;
  double missing_ = -std::numeric_limits<double>::infinity();  // the stamp of the last that was forgotten
};

}  // namespace mapping_common
