// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "hokuyo_sick_drivers/lms_scan.h"
#include "hokuyo_sick_drivers/lms_telegram.h"
#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// How a SICK LMS 2xx is to measure. What is left open stays as the device has it.
struct LmsOptions {
  enum class Intensity { kNone, kNormalised, kDirect };
  enum class IntensityRange {
    kPlain,   ///< 16 bits of range, from 1FF7h up no range
    kFlags,   ///< 13 bits of range, 3 flags
    kSixteen  ///< 16 bits of range, from FFF7h up no range
  };

  int baud_rate = 38400;          ///< 9600, 19200, 38400 or 500000
  Nanoseconds connect_delay = 0;  ///< before anything is sent, while the device starts up
  std::optional<lms::Variant> variant;
  bool interlaced = false;  ///< partial scans as they are measured, 180 degrees
  Intensity intensity = Intensity::kNone;
  IntensityRange intensity_range = IntensityRange::kPlain;  ///< what no document says for sure
  int first_index = 1, last_index = 0;  ///< with intensities: of the values to be sent; 0: the last
  std::optional<lms::Unit> unit;
  std::optional<int> measuring_mode;  ///< without intensities: 0 to 6 or 15
  std::optional<int> sensitivity;     ///< 0 standard, 1 medium, 2 low, 3 high
  std::optional<bool> highest_availability, ignore_dazzling, real_time_index;
  bool restore_on_exit = false;  ///< writes back configuration, variant and baud rate as they were found

  /// @throws std::invalid_argument if they ask for something that an LMS can't do
  void check() const;
};

constexpr auto choicesOf(LmsOptions::Intensity) {
  using Intensity = LmsOptions::Intensity;
  return mapping_common::choices<Intensity>({{"none", Intensity::kNone, "ranges alone"},
                                             {"normalised", Intensity::kNormalised, "measuring mode 0Dh"},
                                             {"direct", Intensity::kDirect, "measuring mode 0Eh"}});
}
constexpr auto choicesOf(LmsOptions::IntensityRange) {
  using Range = LmsOptions::IntensityRange;
  return mapping_common::choices<Range>(
      {{"plain", Range::kPlain, "16 bits, of which 8183 and up are no range"},
       {"flags", Range::kFlags, "13 bits and 3 flags"},
       {"16_bit", Range::kSixteen, "65527 and up are no range"}});
}

/// What a driver knows of its device.
struct LmsReport {
  enum class Phase { kNoPort, kSearching, kSettingUp, kStreaming, kStopping };
  Phase phase = Phase::kNoPort;
  std::string problem;  ///< the latest, empty since scans arrive
  std::string warning;  ///< what is not as asked for, though scans arrive
  std::string type, software_version;
  int baud_rate = 0;  ///< of the line, 0 before it is found
  lms::Variant variant;
  int measuring_mode = 0;
  lms::Unit unit = lms::Unit::kCentimetre;
  bool real_time_index = false;
  std::uint8_t status = 0;  ///< of the last scan
  double scan_rate = 0.0;   ///< Hz, that is to be expected

  std::size_t scans = 0, lost = 0;  ///< lost by their real-time indices
  lms::Parser::Counts line;
  std::array<std::size_t, lms::kNumDefects> defects{};  ///< dropped, by lms::Defect
  std::size_t unexpected = 0;                           ///< telegrams that nobody asked for
  std::size_t repeated = 0, refused = 0;                ///< commands
  std::size_t timeouts = 0;                             ///< that scans failed to appear
  std::size_t power_ons = 0, configurations_written = 0;
  std::size_t unit_changes = 0;  ///< scans in another unit than the configuration says
  std::size_t beyond_top = 0;    ///< ranges greater than 13 bits, perhaps with flags

  /// Telegrams that were dropped, by reason.
  std::vector<std::pair<std::string, std::size_t>> dropped() const;
};

/// Drives a SICK LMS 200, 211, 220, 221 or 291 over RS-232 or RS-422.
///
/// Finds the device's baud rate, even while it streams, sets up what differs from the options and has it
/// stream ranges (B0h), ranges with a word of intensity (undocumented measuring modes 0Dh and 0Eh, F5h;
/// footnote in section 3.3.1 of the thesis) or, from fast (-S14) types, with a byte of reflectivity (C4h).
/// Begins anew whenever scans fail to appear.
class Lms2xx : public Protocol {
 public:
  /// That shutDown() takes at most, without and with restore_on_exit.
  static constexpr Nanoseconds kStopTime = 3 * kSecond / 2, kRestoreTime = 20 * kSecond;

  using OnScan = std::function<void(const lms::Scan&)>;

  /// @throws std::invalid_argument if the options ask for something that an LMS can't do
  Lms2xx(const LmsOptions& options, OnScan on_scan);

  void connected(Nanoseconds now) override;
  void disconnected(Nanoseconds now) override;
  void received(std::string_view bytes, Nanoseconds now) override;
  void tick(Nanoseconds now) override;
  Nanoseconds deadline() const override;
  Output takeOutput() override;
  void shutDown(Nanoseconds now) override;
  bool done() const override { return stopping_ && step_ == Step::kIdle; }

  const LmsReport& report() const { return report_; }

 private:
  enum class Step {
    kIdle,
    kDelay,      // before the first word
    kQuiet,      // after the command to stop
    kProbe,      // is there an answer at this rate
    kAwaitStop,  // the answer to that command is late
    kStop,
    kChangeRate,
    kSettle,
    kTestRate,
    kReadType,
    kSetVariant,
    kReadConfiguration,
    kInstall,
    kWriteConfiguration,
    kLeaveInstallation,
    kStart,
    kStream,
    kPause
  };
  struct Request {
    std::string command;
    lms::Code reply;
    Nanoseconds timeout;
    int tries;  // left
    Nanoseconds sent;
  };

  // Set-up, lms2xx_setup.cpp
  void search(int first_rate, Nanoseconds now);
  void tryRate(Nanoseconds now);
  void probe(Nanoseconds now);
  void probed(Nanoseconds now);
  void changeRate(int baud_rate, Nanoseconds now);
  void testRate(Nanoseconds now);
  void readType(Nanoseconds now);
  void setVariant(Nanoseconds now);
  void readConfiguration(Nanoseconds now);
  void checkConfiguration(Nanoseconds now);
  void leaveInstallation(Nanoseconds now);
  void configured(Nanoseconds now);
  void start(Nanoseconds now);
  void stream(Nanoseconds now);
  void stop(Step step, Nanoseconds now);
  void changeMode(Step step, const std::string& mode, Nanoseconds now);
  void answered(const lms::Telegram& telegram, Nanoseconds now);
  void modeChanged(int result, Nanoseconds now);
  void refused(Nanoseconds now, const std::string& why = "");

  bool isFast() const { return report_.type.find("S14") != std::string::npos; }
  lms::Variant wantedVariant() const;
  std::string wantedConfiguration() const;
  bool hasRanges() const;
  lms::ScanFormat format() const;
  std::string startCommand(const lms::ScanFormat& format) const;

  // Bytes and commands, lms2xx.cpp
  void transmit(const std::string& command);
  void send(const std::string& command);
  void setLineRate(int baud_rate);
  void request(Step step, const std::string& command, lms::Code reply, Nanoseconds timeout, Nanoseconds now,
               int tries = 3);
  void repeat(Nanoseconds now);
  void timedOut(Nanoseconds now);
  void fail(const std::string& problem, Nanoseconds now);
  void refuse(const std::string& problem, Nanoseconds now);
  void wait(Step step, Nanoseconds time, Nanoseconds now);
  void idle();

  void parse(Nanoseconds now);
  void handle(const lms::Telegram& telegram, Nanoseconds now);
  void handleScan(const lms::Telegram& telegram, Nanoseconds now);
  Nanoseconds endOfTelegram() const;
  void flush(Nanoseconds now);

  std::size_t damaged() const;
  std::string droppedSinceGood() const;

  const LmsOptions options_;
  const OnScan on_scan_;
  Step step_ = Step::kIdle;
  Nanoseconds deadline_ = kNever;
  std::deque<Output> output_;
  LmsReport report_, good_report_;  // now; at the last scan, or the start

  lms::Parser parser_;
  std::size_t heard_ = 0;    // bytes, since the last command
  std::size_t damaged_ = 0;  // telegrams, until then
  Nanoseconds last_byte_ = 0;

  std::optional<Request> request_;
  std::vector<int> rates_;  // to be tried
  std::size_t rate_ = 0;    // of them
  int rounds_ = 0;
  int line_rate_ = 0, next_rate_ = 0;
  Nanoseconds stop_sent_ = 0;
  bool stop_confirmed_ = false;
  bool delayed_ = false;

  lms::Variant device_variant_;
  std::string configuration_;
  bool configuration_refused_ = false;
  int writes_ = 0;  // in a row without success
  Nanoseconds next_write_ = 0;
  std::optional<lms::ScanDecoder> decoder_;

  // As it was before this driver came.
  struct Found {
    int baud_rate = 0;
    std::optional<lms::Variant> variant;
    std::string configuration;
  } found_;
  bool stopping_ = false;
  Nanoseconds give_up_ = kNever;
};

}  // namespace hokuyo_sick_drivers
