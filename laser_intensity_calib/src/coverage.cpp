// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <set>
#include <utility>

#include "laser_intensity_calib/fit.h"

namespace laser_intensity_calib {
namespace {

constexpr double kDegrees = 180.0 / M_PI;
constexpr int kColumns = 16;                  // of the map, over the ranges
constexpr int kRows = 9;                      // over 0 to 90 degrees
constexpr double kPlenty = 0.6, kThin = 0.2;  // shares of cells with samples
constexpr double kSteep = 60.0;  // deg, up to which samples are wanted at any range (thesis, Fig. 3.2)

struct Block {
  int inside = 0, observed = 0;
  double share() const { return inside > 0 ? static_cast<double>(observed) / inside : 0.0; }
  char symbol() const { return inside == 0 ? ' ' : share() >= kPlenty ? '#' : share() >= kThin ? '+' : '.'; }
};

template <class... Arguments>
std::string text(const char* format, Arguments... arguments) {
  char buffer[200];
  std::snprintf(buffer, sizeof(buffer), format, arguments...);
  return buffer;
}

}  // namespace

Coverage coverageOf(const std::vector<Cell>& cells, const LookupTable& table, const FitOptions& options) {
  std::set<std::pair<int, int>> observed;
  for (const Cell& cell : cells) {
    observed.emplace(static_cast<int>(cell.range / options.range_cell),
                     static_cast<int>(cell.incidence / options.incidence_cell));
  }
  const double first = table.range().min, last = table.range().max(), width = (last - first) / kColumns;
  Block blocks[kRows][kColumns], all;
  double steepest[kColumns] = {};  // deg
  const int r_end = static_cast<int>(last / options.range_cell) + 1;
  const int a_end = static_cast<int>(0.5 * M_PI / options.incidence_cell) + 1;
  for (int r = static_cast<int>(first / options.range_cell); r < r_end; ++r) {
    for (int a = 0; a < a_end; ++a) {
      const double range = (r + 0.5) * options.range_cell, incidence = (a + 0.5) * options.incidence_cell;
      const bool seen = observed.count({r, a}) > 0;
      if (!seen && !table.at(static_cast<float>(range), static_cast<float>(incidence)).inside) continue;
      const int column = std::clamp(static_cast<int>((range - first) / width), 0, kColumns - 1);
      Block& block = blocks[std::min(kRows - 1, static_cast<int>(incidence * kDegrees / 10.0))][column];
      ++block.inside;
      ++all.inside;
      if (!seen) continue;
      ++block.observed;
      ++all.observed;
      steepest[column] = std::max(steepest[column], incidence * kDegrees);
    }
  }

  Coverage coverage;
  coverage.observed = all.share();
  if (coverage.observed < 0.3) {
    coverage.advice.push_back(
        text("Only %.0f %% of the table is near samples, the rest is interpolated across gaps: observe the "
             "surface "
             "from more distances and at more angles",
             100.0 * coverage.observed));
  }
  const auto runs = [&](const auto& applies, const auto& say) {
    for (int begin = 0; begin < kColumns; ++begin) {
      if (!applies(begin)) continue;
      int end = begin + 1;
      while (end < kColumns && applies(end)) ++end;
      say(first + begin * width, first + end * width, begin, end);
      begin = end;
    }
  };
  for (int row = 0; row < kRows; ++row) {
    runs([&](int c) { return blocks[row][c].symbol() == '.'; },
         [&](double from, double to, int, int) {
           coverage.advice.push_back(text("Too few samples at %.2f to %.2f m, %d to %d deg: interpolated",
                                          from, to, 10 * row, 10 * row + 10));
         });
  }
  runs([&](int c) { return steepest[c] < kSteep; },
       [&](double from, double to, int begin, int end) {
         coverage.advice.push_back(
             text("No samples at %.2f to %.2f m beyond %.0f deg: turn the surface, or drive "
                  "along it",
                  from, to, *std::max_element(steepest + begin, steepest + end)));
       });

  for (int row = kRows - 1; row >= 0; --row) {
    coverage.map += text("%3d deg |", 10 * row);
    for (const Block& block : blocks[row]) coverage.map += std::string(2, block.symbol());
    coverage.map += "|\n";
  }
  coverage.map += text("        %.2f m%*.2f m\n", first, 2 * kColumns - 4, last);
  coverage.map += "        # samples in most cells, + in some, . in few, blank: not covered\n";
  return coverage;
}

}  // namespace laser_intensity_calib
