// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "device.h"
#include "lms_telegram.h"
#include "sick_scan.h"

namespace device_emulators {

struct SickModel {
  std::string name, type;       ///< of the preset; answer to 3Ah
  SickVariant variant;          ///< at power-up
  bool fast = false;            ///< refuses 3Bh; all values come from one turn
  bool reflectivities = false;  ///< knows 44h and mode 50h (C4h)
};

/// @throws std::runtime_error that lists the known names
SickModel sickModel(const std::string& name);

struct SickOptions : DeviceOptions {
  explicit SickOptions(const std::string& model_name = "LMS291-S05");
  SickModel model;
  int power_up_baud_rate = 9600;
  Nanoseconds ack_delay = 5 * kMillisecond;          ///< from a command to ACK or NAK
  Nanoseconds reply_delay = 10 * kMillisecond;       ///< from ACK to the reply
  Nanoseconds mode_delay = 100 * kMillisecond;       ///< the same of 20h
  Nanoseconds configure_delay = 200 * kMillisecond;  ///< the same of 77h; CARMEN's driver waits for 250 ms
  Nanoseconds byte_gap = 14 * kMillisecond;          ///< longest within a command
  std::size_t configuration_size = 34;
  bool refuse_by_mode = false;  ///< 77h outside of installation mode: A0h 02h, otherwise F7h 00h
  unsigned char status = 0x10;  ///< of every telegram
  SickCoding coding;
};

/// A SICK LMS 2xx.
class SickDevice : public Device {
 public:
  SickDevice(const SickOptions& options, std::shared_ptr<ScanSource> source);

  unsigned mode() const { return mode_; }
  const SickVariant& variant() const { return variant_; }
  const SickConfiguration& configuration() const { return configuration_; }
  /// How often the EEPROM was written.
  std::size_t configurationWrites() const { return configuration_writes_; }

 private:
  // The command at work: acknowledged, then answered.
  struct Work {
    std::string command;
    bool good = false, acknowledged = false, measuring = false;
    Nanoseconds due = 0;
    std::int64_t turn = 0;  // to be measured
  };
  struct ScanTelegram {
    std::string payload;
    SentScan scan;
  };

  void onReceived(std::string_view bytes, Nanoseconds now) override;
  Nanoseconds nextEvent() const override;
  void onEvent(Nanoseconds now) override;
  void onPowerUp(Nanoseconds now) override;
  void onBooted(Nanoseconds now) override;
  void startStreaming(Nanoseconds now) override;
  std::string exampleMessage(Nanoseconds now) override;

  void begin(Nanoseconds now);
  void work(Nanoseconds now);
  void finish(Nanoseconds now);
  Nanoseconds delayOf(const std::string& command) const;

  // sick_commands.cpp: reply code and data.
  std::string execute(const std::string& command);
  std::string changeMode(const std::string& command);
  std::string changeVariant(const std::string& command);
  std::string configure(const std::string& command);
  std::string status() const;
  /// Whether the command asks for a scan and may; asked_ says for which.
  bool readMeasuringCommand(const std::string& command);
  bool readGroups(const std::string& command, std::size_t at, std::size_t max_groups,
                  std::vector<SickGroup>& groups) const;
  bool isGroup(const SickGroup& group) const;
  bool readMeans(const std::string& command, std::size_t at, SickRequest& request) const;

  bool streams() const;
  int turnsOf(const SickRequest& request) const;
  Nanoseconds turnStart(std::int64_t turn) const;
  Nanoseconds scanEnd(std::int64_t turn, const SickRequest& request) const;
  std::int64_t nextScan(Nanoseconds now, const SickRequest& request) const;
  SentScan measureTurns(std::int64_t turn, const SickRequest& request, int first, int last) const;
  int partialOf(std::int64_t turn, const SickRequest& request) const;
  ScanTelegram measureScan(std::int64_t turn, const SickRequest& request);
  void sendTelegram(const std::string& payload, Nanoseconds now);
  void sendScanTelegram(ScanTelegram telegram, Nanoseconds now);

  const SickOptions options_;
  LmsReader reader_;
  std::deque<Work> work_;

  SickConfiguration configuration_;
  std::size_t configuration_writes_ = 0;
  SickVariant variant_;
  unsigned mode_ = 0;
  SickRequest streamed_, asked_;  // while that streams; once
  std::int64_t next_turn_ = 0;    // the next scan to stream begins there
  Nanoseconds mirror_epoch_ = 0;
  int asked_baud_rate_ = 0;  // once the reply is out
  Nanoseconds restart_at_ = kNever;
};

}  // namespace device_emulators
