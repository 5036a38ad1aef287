// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "transmitter.h"

namespace device_emulators {

enum class Fault {
  kBytesLost,         ///< 1 to 4 bytes of a message
  kBitsFlipped,       ///< a bit of a message
  kCut,               ///< the end of a message is missing
  kGarbage,           ///< 1 to 32 random bytes within or before a message
  kSilence,           ///< says nothing for a while; what it had to say is lost
  kStall,             ///< says nothing for a while, then everything
  kDisconnect,        ///< the cable is pulled and put back
  kReboot,            ///< power fails and comes back
  kWrongSum,          ///< Hokuyo: a row's sum; SICK: a telegram's CRC
  kUnstable,          ///< Hokuyo: status 0M instead of a scan, the stream goes on
  kErrorStatus,       ///< Hokuyo: status 50 to 97 instead of a scan, the stream ends
  kNak,               ///< SICK: a good command is refused as if it had been damaged
  kCountMismatch,     ///< SICK: F5h whose count isn't stop - start + 1
  kAlreadyStreaming,  ///< streams at connect
  kHalfMessage,       ///< the end of some message comes first at connect
};
constexpr std::size_t kNumFaults = 15;

const char* faultName(Fault fault);
/// @throws std::runtime_error that lists the known names
Fault faultNamed(const std::string& name);
std::vector<Fault> allFaults();

struct FaultOptions {
  std::array<double, kNumFaults> rates{};  ///< probability per message sent, or per connect
  struct Moment {
    Fault fault;
    Nanoseconds when;
  };
  std::vector<Moment> moments;  ///< hits the first message from then on
  Nanoseconds silence = kSecond, stall = 300 * kMillisecond;
  Nanoseconds outage = 500 * kMillisecond;  ///< how long the cable is out

  double& rate(Fault fault) { return rates[static_cast<std::size_t>(fault)]; }
};

/// Says when a fault is due, and counts.
class FaultInjector {
 public:
  FaultInjector(const FaultOptions& options, std::uint64_t seed) : options_(options), random_(seed) {}

  void add(Fault fault, Nanoseconds when) { options_.moments.push_back({fault, when}); }
  /// Whether this message is hit: the moment has come, or the die falls so.
  bool hits(Fault fault, Nanoseconds now);
  /// Whether the moment of a fault has come that needs no message; it is over then.
  bool momentCame(Fault fault, Nanoseconds now);
  /// The first moment of a fault that needs no message.
  Nanoseconds nextMoment() const;

  std::size_t count(Fault fault) const { return counts_[static_cast<std::size_t>(fault)]; }
  std::size_t random(std::size_t from, std::size_t to) {
    return std::uniform_int_distribution<std::size_t>(from, to)(random_);
  }
  const FaultOptions& options() const { return options_; }

 private:
  FaultOptions options_;
  std::mt19937_64 random_;
  std::array<std::size_t, kNumFaults> counts_{};
};

}  // namespace device_emulators
