// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "device.h"
#include "hokuyo_model.h"
#include "hokuyo_scan.h"

namespace device_emulators {

struct HokuyoOptions : DeviceOptions {
  explicit HokuyoOptions(const std::string& model_name = "UTM-30LX");
  HokuyoModel model;
  double drift_ppm = 0.0;       ///< how much faster the device's clock is
  std::uint32_t start_ms = 0;   ///< its counter at the start; 2^24 - 1 wraps at once
  bool sum_semicolon = false;   ///< VV, PP and II: the semicolon counts
  bool quit_cuts_scan = false;  ///< QT ends a scan under way at a row's end, otherwise after its last row
  bool partial_group = false;   ///< steps left over from whole clusters make a value too
  bool stop_on_close = false;   ///< stops streaming when the host closes the port, as over TCP
};

/// A Hokuyo that speaks SCIP 2.0 or 2.2.
class HokuyoDevice : public Device {
 public:
  HokuyoDevice(const HokuyoOptions& options, std::shared_ptr<ScanSource> source);

  /// Counter of the device, 24 bits of ms.
  std::uint32_t counter(Nanoseconds now) const;
  bool laserOn() const { return laser_on_; }
  /// Address, netmask and gateway that $IP has set, as 36 digits; "" before.
  const std::string& storedAddress() const { return stored_address_; }

 private:
  struct Command;
  struct Measurement {
    HokuyoRequest request;
    std::int64_t turn = 0;  // to be sent next
    int left = 0;           // scans, if counted
  };

  void onReceived(std::string_view bytes, Nanoseconds now) override;
  Nanoseconds nextEvent() const override;
  void onEvent(Nanoseconds now) override;
  void onPowerUp(Nanoseconds now) override;
  void onHostClosed(Nanoseconds now) override;
  void startStreaming(Nanoseconds now) override;
  std::string exampleMessage(Nanoseconds now) override;

  void execute(const std::string& line, Nanoseconds now);
  /// Status of what follows the command's code; "" if it's well formed.
  std::string checkForm(const Command& command, const std::string& arguments) const;

  void answer(const std::string& status, Nanoseconds now, const std::string& contents = "");
  void version(Nanoseconds now);
  void parameters(Nanoseconds now);
  void information(Nanoseconds now);
  void state(Nanoseconds now);
  void laser(Nanoseconds now);
  void quit(Nanoseconds now);
  void reset(Nanoseconds now);
  void partialReset(Nanoseconds now);
  void restart(Nanoseconds now);
  void sleep(Nanoseconds now);
  void bitRate(Nanoseconds now);
  void address(Nanoseconds now);
  void motorSpeed(Nanoseconds now);
  void sensitivity(Nanoseconds now);
  void malfunction(Nanoseconds now);
  void time(Nanoseconds now);
  void measureOnce(Nanoseconds now);
  void measureContinuously(Nanoseconds now);
  std::string readRequest(HokuyoRequest& request) const;

  void stop();
  void setClock(Nanoseconds now, std::uint32_t ms);
  Nanoseconds turnStart(std::int64_t turn) const { return motor_epoch_ + turn * period_; }
  Nanoseconds scanEnd(std::int64_t turn) const;
  std::int64_t nextTurn(Nanoseconds now) const;
  void sendMeasurement(const Measurement& measurement, Nanoseconds now);
  std::string keyLine(const std::string& key, const std::string& value) const;

  const HokuyoOptions options_;
  const HokuyoModel& model_ = options_.model;

  std::string input_;                   // the line so far
  std::string line_, code_, argument_;  // of the command at work
  std::string stored_address_;

  bool laser_on_ = false, adjusting_time_ = false, asleep_ = false, sensitive_ = false;
  int malfunction_ = 0, motor_level_ = 0, bit_rate_ = 0;
  std::optional<Measurement> stream_, single_;
  std::optional<Nanoseconds> restart_asked_;
  Nanoseconds restart_at_ = kNever;
  Nanoseconds clock_epoch_ = 0;
  std::uint32_t clock_start_ = 0;
  Nanoseconds motor_epoch_ = 0, period_ = 0;
};

}  // namespace device_emulators
