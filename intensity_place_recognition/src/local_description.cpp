// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/local_description.h"

namespace intensity_place_recognition {
namespace {

using Sightings = std::vector<Sighting>;

std::size_t endOf(const Sightings& all, std::size_t begin) {
  std::size_t end = begin;
  while (end < all.size() && all[end].word == all[begin].word) ++end;
  return end;
}

// Calls with the ranges of sightings of each word that both have.
template <class Call>
void forCommon(const Sightings& a, const Sightings& b, const Call& call) {
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    const std::size_t i_end = endOf(a, i), j_end = endOf(b, j);
    const std::int32_t word = a[i].word, other = b[j].word;
    if (word == other) call(i, i_end, j, j_end);
    if (word <= other) i = i_end;
    if (other <= word) j = j_end;
  }
}

float idf(std::size_t views, std::size_t occurrences) {
  return std::log(static_cast<float>(views) / static_cast<float>(occurrences));
}

}  // namespace

void InvertedIndex::add(Sightings sightings) {
  const auto view = static_cast<std::int32_t>(views_.size());
  for (std::size_t i = 0; i < sightings.size(); i = endOf(sightings, i)) {
    const auto word = static_cast<std::size_t>(sightings[i].word);
    if (word >= inverted_.size()) inverted_.resize(word + 1);
    inverted_[word].push_back(view);
  }
  views_.push_back(std::move(sightings));
}

std::vector<float> InvertedIndex::similarities(const Sightings& sightings, std::size_t before) const {
  std::vector<float> result(before, 0.0f);
  for (std::size_t i = 0; i < sightings.size(); i = endOf(sightings, i)) {
    const std::vector<std::int32_t>& views = inverted_[sightings[i].word];
    const float weight = idf(views_.size() + 1, views.size() + 1);  // with this one
    for (const std::int32_t view : views) {
      if (static_cast<std::size_t>(view) >= before) break;
      result[view] += weight;
    }
  }
  return result;
}

float InvertedIndex::similarity(std::size_t a, std::size_t b) const {
  float sum = 0.0f;
  forCommon(views_.at(a), views_.at(b), [&](std::size_t i, std::size_t, std::size_t, std::size_t) {
    sum += idf(views_.size(), inverted_[views_[a][i].word].size());
  });
  return sum;
}

void InvertedIndex::vote(const Sightings& sightings, std::size_t view, std::vector<float>& by_step) const {
  constexpr float kSpread[] = {0.25f, 0.75f, 1.0f, 0.75f, 0.25f};
  const Sightings& there = views_.at(view);
  const int steps = static_cast<int>(by_step.size());
  forCommon(sightings, there, [&](std::size_t i, std::size_t i_end, std::size_t j, std::size_t j_end) {
    const float weight = idf(views_.size() + 1, inverted_[sightings[i].word].size()) /
                         static_cast<float>((i_end - i) * (j_end - j));
    for (std::size_t m = i; m < i_end; ++m) {
      for (std::size_t n = j; n < j_end; ++n) {
        // What is at the azimuth a here is at a + yaw there.
        const double yaw = there[n].azimuth - sightings[m].azimuth;
        const int step = static_cast<int>(std::lround(-yaw / (2.0 * M_PI) * steps));
        for (int d = -2; d <= 2; ++d)
          by_step[((step + d) % steps + steps) % steps] += weight * kSpread[d + 2];
      }
    }
  });
}

void InvertedIndex::write(mapping_common::ArchiveWriter& out) const {
  out(static_cast<std::uint64_t>(views_.size()));
  for (const Sightings& view : views_) out(view);
}

void InvertedIndex::read(mapping_common::ArchiveReader& in, std::size_t words) {
  for (std::size_t left = in.count(sizeof(std::uint64_t)); left > 0; --left) {
    Sightings view;
    in(view);
    for (std::size_t i = 0; i < view.size(); ++i)
      if (view[i].word < 0 || static_cast<std::size_t>(view[i].word) >= words ||
          !std::isfinite(view[i].azimuth) || (i > 0 && view[i].word < view[i - 1].word))
        throw std::runtime_error("the words of a place in it are inconsistent");
    add(std::move(view));
  }
}

}  // namespace intensity_place_recognition
