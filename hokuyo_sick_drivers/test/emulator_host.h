// SPDX-License-Identifier: BSD-3-Clause
//
// For tests of emulated devices: a host in virtual time, and scans made to measure.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "device.h"

namespace device_emulators {

/// Beams of a device's own steps.
class FixedSource : public ScanSource {
 public:
  explicit FixedSource(Scan scan) : scan_(std::make_shared<Scan>(std::move(scan))) {}
  std::shared_ptr<const Scan> at(Nanoseconds) override { return scan_; }

 private:
  std::shared_ptr<const Scan> scan_;
};

/// A host on a device's line.
class Host {
 public:
  explicit Host(Device& device, bool connect = true) : device_(device) {
    if (connect) device_.connect(0);
  }

  void send(const std::string& bytes) {
    device_.received(bytes, now_);
    drain();
  }
  /// What comes within that time.
  std::string listen(Nanoseconds duration) {
    const Nanoseconds end = now_ + duration;
    for (Nanoseconds next = device_.deadline(); next <= end; next = device_.deadline()) {
      now_ = std::max(now_, next);
      device_.tick(now_);
      drain();
    }
    now_ = end;
    device_.tick(now_);
    drain();
    return std::exchange(received_, "");
  }
  std::string ask(const std::string& bytes, Nanoseconds duration = kSecond) {
    send(bytes);
    return listen(duration);
  }

  Nanoseconds now() const { return now_; }
  struct Write {
    Nanoseconds time;
    std::string bytes;
  };
  std::vector<Write> writes;
  int disconnects = 0;
  std::vector<int> baud_rates;

 private:
  void drain() {
    for (;;) {
      Device::Output output = device_.takeOutput();
      if (output.empty()) return;
      if (output.disconnect) ++disconnects;
      if (output.baud_rate > 0) baud_rates.push_back(output.baud_rate);
      if (output.bytes.empty()) continue;
      received_ += output.bytes;
      writes.push_back({now_, std::move(output.bytes)});
    }
  }

  Device& device_;
  Nanoseconds now_ = 0;
  std::string received_;
};

/// "02 80 ..." to bytes.
inline std::string fromHex(const std::string& text) {
  std::istringstream in(text);
  std::string bytes;
  for (unsigned byte; in >> std::hex >> byte;) bytes += static_cast<char>(byte);
  return bytes;
}

inline std::string toHex(const std::string& bytes) {
  std::string text;
  for (const unsigned char byte : bytes) {
    char hex[4];
    std::snprintf(hex, sizeof hex, "%02X", byte);
    text += (text.empty() ? "" : " ") + std::string(hex);
  }
  return text;
}

inline std::size_t countOf(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size()))
    ++count;
  return count;
}

}  // namespace device_emulators
