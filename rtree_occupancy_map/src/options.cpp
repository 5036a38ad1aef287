// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/options.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>

namespace rtree_occupancy_map {
namespace {

constexpr const char* kOfNoMatter[] = {"threads",
                                       "working_set_memory",
                                       "decay_time",
                                       "color",
                                       "seed",
                                       "sensor_model/min_range",
                                       "sensor_model/max_range"};

}  // namespace

std::vector<mapping_common::Option> optionsInFiles(Options& options) {
  std::vector<mapping_common::Option> in_files;
  for (const auto& [option, section] : mapping_common::optionsOf(options))
    if (options.color || option.name() != "color") in_files.push_back(option);
  return in_files;
}

void requireLike(const Options& options, const Options& expected) {
  Options copy = options, expected_copy = expected;
  mapping_common::OptionList list = mapping_common::optionsOf(copy);
  for (const auto& [option, section] : mapping_common::optionsOf(expected_copy)) {
    const std::string name = option.name();
    if (name.compare(0, 5, "tree/") == 0 ||
        std::find(std::begin(kOfNoMatter), std::end(kOfNoMatter), name) != std::end(kOfNoMatter))
      continue;
    const mapping_common::OptionValue value = list.find(name)->get();
    if (value != option.get())
      throw std::invalid_argument(name + " is " + mapping_common::toText(value) + ", expected is " +
                                  mapping_common::toText(option.get()));
  }
}

}  // namespace rtree_occupancy_map
