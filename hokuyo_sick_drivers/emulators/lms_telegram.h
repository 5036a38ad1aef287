// SPDX-License-Identifier: BSD-3-Clause
//
// Telegrams of the LMS 2xx, on the device's side.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "transmitter.h"

namespace device_emulators {

std::uint16_t lmsCrc(std::string_view bytes);
/// A telegram of the device. @param payload reply code and data @param status the byte that follows them
std::string lmsTelegram(const std::string& payload, unsigned char status);
/// Low byte first.
void appendWord(std::string& bytes, unsigned value);
unsigned wordAt(const std::string& bytes, std::size_t position);

/// Finds the host's telegrams in what comes.
class LmsReader {
 public:
  /// @param byte_gap a telegram whose next byte takes longer is dropped
  explicit LmsReader(Nanoseconds byte_gap) : byte_gap_(byte_gap) {}

  struct Telegram {
    std::string payload;  ///< command and data
    bool good = false;    ///< CRC and length are right
  };
  std::vector<Telegram> read(std::string_view bytes, Nanoseconds now);
  void clear() { buffer_.clear(); }

 private:
  const Nanoseconds byte_gap_;
  std::string buffer_;
  Nanoseconds last_ = 0;
};

}  // namespace device_emulators
