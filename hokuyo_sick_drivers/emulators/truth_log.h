// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fstream>
#include <string>

#include "transmitter.h"

namespace device_emulators {

/// Every scan that was sent to its last byte, one line of comma-separated values each.
class TruthLog {
 public:
  /// @throws std::runtime_error if the file can't be written
  explicit TruthLog(const std::string& path);
  /// @param epoch_offset from the device's time to Unix time
  void write(const SentScan& scan, Nanoseconds epoch_offset);

 private:
  std::string path_;
  std::ofstream file_;
};

}  // namespace device_emulators
