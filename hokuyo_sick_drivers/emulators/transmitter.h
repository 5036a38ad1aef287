// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace device_emulators {

using Nanoseconds = std::int64_t;
constexpr Nanoseconds kMicrosecond = 1'000, kMillisecond = 1'000'000, kSecond = 1'000'000'000;
constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::max();

/// A scan as the device sent it: what a driver has to come to.
struct SentScan {
  std::int64_t device_stamp = 0;  ///< Hokuyo: counter (ms); SICK: turns of the mirror since power-up
  Nanoseconds start = 0;          ///< Hokuyo: when step 0 was passed; SICK: when the first value was taken
  int first_step = 0;             ///< Hokuyo: first step asked for; SICK: index of the first value, from 1
  int cluster = 1;
  double resolution = 0.001;               ///< m per unit of the ranges
  std::vector<std::uint32_t> ranges;       ///< as sent, with the codes for "no reading"
  std::vector<std::uint32_t> intensities;  ///< as many, or none
  std::vector<std::uint8_t> echoes;        ///< per step; empty: one each
  std::string fault;                       ///< what was injected into the message; empty: nothing
};

/// How bytes leave the device.
struct LineOptions {
  int baud_rate = 0;            ///< 10 bits per byte; 0: unlimited, as USB and TCP are here
  Nanoseconds jitter = 0;       ///< a message is late by a uniform time up to this
  std::size_t packet_size = 0;  ///< bytes per write; 0: a message is written in one go
  bool random_packets = false;  ///< writes of random sizes, up to packet_size
  Nanoseconds packet_gap = 0;   ///< between writes
};

/// Messages in, pieces of them out when the line has had the time to carry them.
class Transmitter {
 public:
  Transmitter(const LineOptions& options, std::uint64_t seed) : options_(options), random_(seed) {}

  /// @param scan logged when the last byte has gone; may be null
  /// @param is_scan whether it may be cut
  void send(const std::string& message, Nanoseconds now, bool is_scan = false,
            std::shared_ptr<const SentScan> scan = nullptr);
  /// Nothing leaves before that time.
  void hold(Nanoseconds now, Nanoseconds until);
  void setBaudRate(int rate) { options_.baud_rate = rate; }
  int baudRate() const { return options_.baud_rate; }

  struct Piece {
    std::string bytes;
    Nanoseconds due = 0;
    int baud_rate = 0;
    bool is_scan = false, starts_message = false;
    std::shared_ptr<const SentScan> completes;
  };
  /// Next piece that is due; without bytes if there is none.
  Piece take(Nanoseconds now);
  Nanoseconds deadline() const { return pieces_.empty() ? kNever : pieces_.front().due; }
  /// When all is out.
  Nanoseconds freeAt() const { return free_at_; }
  std::size_t backlog() const { return backlog_; }

  /// Drops what hasn't left yet of scans, in the middle of a message too.
  void cut(Nanoseconds now);
  /// The same, but the line that is under way is finished.
  void cutAfterLine(Nanoseconds now);
  void dropAfter(Nanoseconds now);
  void clear();

 private:
  void reschedule(Nanoseconds now);
  Nanoseconds duration(std::size_t bytes) const;

  LineOptions options_;
  std::mt19937_64 random_;
  std::deque<Piece> pieces_;
  Nanoseconds free_at_ = 0;
  std::size_t backlog_ = 0;
};

}  // namespace device_emulators
