// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>

#include "device.h"
#include "port.h"
#include "truth_log.h"

namespace device_emulators {

struct RunOptions {
  TruthLog* truth = nullptr;
  bool check_baud_rate = true;         ///< whether the host has to set the device's rate
  std::function<void()> poll = [] {};  ///< called often, for what else has to be done
};

/// Runs a device on a port in real time until SIGINT or SIGTERM. Prints "ready" once hosts can connect.
/// @throws std::runtime_error
void runDevice(Device& device, Port& port, const RunOptions& options);

/// What was sent and what was injected, one line each.
void printCounts(const Device& device);

}  // namespace device_emulators
