// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rtree_occupancy_map/options.h"

namespace rtree_occupancy_map {

/// A map's options with those of a machine, which files don't settle; with Options() as files have them.
inline Options withMachine(Options map, const Options& machine) {
  map.threads = machine.threads;
  map.working_set_memory = machine.working_set_memory;
  map.decay_time = map.dynamic && map.prob_miss < map.prior ? machine.decay_time : 0.0;
  return map;
}

}  // namespace rtree_occupancy_map
