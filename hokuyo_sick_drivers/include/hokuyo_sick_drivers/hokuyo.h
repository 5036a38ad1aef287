// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hokuyo_sick_drivers/counter_unwrapper.h"
#include "hokuyo_sick_drivers/hokuyo_scan.h"
#include "hokuyo_sick_drivers/protocol.h"
#include "hokuyo_sick_drivers/scan_clock.h"
#include "hokuyo_sick_drivers/scip.h"

namespace hokuyo_sick_drivers {

/// What can go wrong. Each is counted.
enum class HokuyoFault {
  kSum,           ///< a line with a wrong sum
  kLength,        ///< a scan with more or less than was asked for
  kBroken,        ///< a message without an end
  kForeign,       ///< a reply to nothing that was asked
  kStamp,         ///< a scan from the past or the future
  kErrorStatus,   ///< the device reports an error
  kUnstable,      ///< the device reports a passing disturbance (0M)
  kRefused,       ///< the device can't measure as asked
  kTimeout,       ///< no reply, or no scan
  kLostScan,      ///< missing between the stamps of two scans
  kRestart,       ///< measuring was started anew because of one of the others
  kReconnect,     ///< the port was opened again
  kClockRestart,  ///< the device's clock started anew while measuring
  kCount
};
/// For people, e.g. "wrong sums".
const char* name(HokuyoFault fault);
using HokuyoFaults = std::array<std::uint64_t, static_cast<std::size_t>(HokuyoFault::kCount)>;
/// What went wrong between two counts, for people, e.g. "3 wrong sums, 1 lost scans"; "" if nothing did.
std::string differences(const HokuyoFaults& before, const HokuyoFaults& now);

/// A Hokuyo scanner that speaks SCIP 2: measures for as long as there is a connection, whatever state the
/// device is found in and whatever happens to it.
class Hokuyo : public Protocol {
 public:
  struct Options {
    bool synchronize_clock = true;  ///< asks for the device's time before measuring
    int clock_probes = 100;         ///< questions for that, at most
    bool reset = false;             ///< resets the device (RS) after each connection
    int error_limit = 4;            ///< bad scans in a row after which measuring starts anew
    std::vector<int> baud_rates;    ///< to be tried, the port's first; empty: not a serial line
  };
  enum class Level { kInfo, kWarning, kError };
  struct Events {
    std::function<void(const HokuyoScan&)> scan;
    std::function<void(Level, const std::string&)> say;
  };
  /// What there is to know about the device, see the replies to VV and II.
  struct Status {
    bool measuring = false;
    std::string activity;  ///< e.g. "measuring", "waiting for the reply to PP"
    std::string problem;   ///< why it doesn't measure, with the device's own words; "" once scans come
    std::string warning;   ///< what isn't measured as asked for, and what to do about that
    /// By SCIP's keys: VEND, PROD, FIRM, PROT, SERI, MODL, STAT, ...
    std::map<std::string, std::string> info;
    std::uint64_t informed = 0;  ///< how often the device has told its state (II)
    /// The device's own words of its state (STAT) where these aren't known to mean that all is well.
    std::string trouble() const;
    std::optional<HokuyoGeometry> geometry;
    HokuyoSettings settings;  ///< as they could be fulfilled
    HokuyoFaults faults{};
    std::uint64_t scans = 0;
    double clock_drift = 0.0;  ///< host seconds per device second, less one
    Nanoseconds latency = 0;   ///< of the latest scan, from the first ray to the first byte
    int baud_rate = 0;
  };

  Hokuyo(const Options& options, const HokuyoSettings& settings, Events events);

  /// Measures another way from now on. Where that is already so, nothing happens.
  /// @throws std::invalid_argument if the device is known and has no such rays
  void configure(const HokuyoSettings& settings, Nanoseconds now);
  /// Has the device tell its state (II) while it goes on measuring. A device that doesn't answer while it
  /// measures is stopped for that, as it is at a start.
  void updateStatus(Nanoseconds now);
  Status status() const;

  void connected(Nanoseconds now) override;
  void disconnected(Nanoseconds now) override;
  void received(std::string_view bytes, Nanoseconds now) override;
  void tick(Nanoseconds now) override;
  Nanoseconds deadline() const override { return std::min(deadline_, state_deadline_); }
  Output takeOutput() override;
  void shutDown(Nanoseconds now) override;
  bool done() const override { return step_ == Step::kDone; }

 private:
  // In the order of a start.
  enum class Step {
    kOffline,
    kQuiet,
    kPause,
    kStop,
    kStopAgain,
    kLeaveTimeMode,
    kLeaveOldProtocol,
    kReset,
    kParameters,
    kVersion,
    kInformation,
    kEnterTime,
    kTime,
    kLeaveTime,
    kStart,
    kMeasuring,
    kShutDown,
    kDone
  };

  void enter(Step step, Nanoseconds now);
  void send(const std::string& command, Nanoseconds timeout, Nanoseconds now);
  void replied(const scip::Message& message, Nanoseconds now);
  void failed(const std::string& why, Nanoseconds now);
  void giveUp(const std::string& why, Nanoseconds now);
  void startAnew(const std::string& why, Nanoseconds pause, Nanoseconds now);

  bool isOldProtocol(const scip::Message& message) const;
  bool stopReplied(std::string_view status, Nanoseconds now);
  void takeInformation(const scip::Message& message);
  void stateReplied(const scip::Message& message, Nanoseconds now);
  void takeProbe(const scip::Message& message, Nanoseconds now);
  void startReplied(std::string_view status, Nanoseconds now);
  void prepareMeasuring(Nanoseconds now);
  void measured(const scip::Message& message, Nanoseconds now);
  bool takeScan(const scip::Message& message);
  bool takeStamp(std::string_view line, Nanoseconds arrival, HokuyoScan& scan);
  void badScan(Nanoseconds now);
  void fellSilent(Nanoseconds now);
  std::string withDevicesWords(const std::string& why) const;

  void count(HokuyoFault fault, std::uint64_t number = 1);
  void say(Level level, const std::string& text) const { events_.say(level, text); }
  Nanoseconds scanTimeout() const;

  const Options options_;
  const Events events_;
  HokuyoSettings settings_;
  bool refuses_intensity_ = false, refuses_multi_echo_ = false;
  std::string problem_, warning_;  // see Status

  Step step_ = Step::kOffline;
  std::string command_;  // whose reply is awaited
  Nanoseconds sent_ = 0, deadline_ = kNever, quiet_end_ = 0;
  Nanoseconds state_deadline_ = kNever;  // of a reply to II while measuring
  Nanoseconds measuring_since_ = 0;
  int attempts_ = 0, mode_changes_ = 0, restarts_ = 0, probes_ = 0, unanswered_probes_ = 0,
      futile_starts_ = 0, bad_scans_ = 0;
  int stalls_ = 0;  // in a row, soon after a start
  std::size_t baud_index_ = 0;
  std::deque<Output> output_;
  scip::MessageReader reader_;
  std::uint64_t broken_seen_ = 0;

  std::map<std::string, std::string> info_;
  std::uint64_t informed_ = 0;
  std::optional<HokuyoGeometry> geometry_;
  HokuyoRequest request_;
  HokuyoScan scan_;

  CounterUnwrapper counter_{24};
  ScanClock clock_;
  std::optional<Nanoseconds> last_stamp_;  // of a scan, by the device
  Nanoseconds latency_ = 0;

  HokuyoFaults faults_{}, good_faults_{};  // now, at the last good scan
  std::uint64_t scans_ = 0;
  bool was_connected_ = false;
};

}  // namespace hokuyo_sick_drivers
