// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "faults.h"
#include "scan_source.h"
#include "transmitter.h"

namespace device_emulators {

struct DeviceOptions {
  std::uint64_t seed = 1;
  LineOptions line;
  FaultOptions faults;
  Nanoseconds boot_delay = 0;      ///< from power-up until the device answers
  bool power_up_at_start = false;  ///< otherwise it has been running for long
  bool streaming = false;          ///< streams from the start, as if another program had left it so
};

struct Counts {
  std::size_t scans = 0;    ///< sent to the last byte
  std::size_t skipped = 0;  ///< that the line had no room for
  std::size_t commands = 0;
  std::size_t connects = 0;
};

/// An emulated device as a state machine without input, output or clock: bytes and the time go in, bytes
/// come out, paced as the line would. Times mustn't go backwards. Between calls the owner waits until
/// deadline(), then calls tick() and takes output until there is none.
class Device {
 public:
  Device(const DeviceOptions& options, std::shared_ptr<ScanSource> source);
  virtual ~Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  /// The host opened the port. Only while linkUp().
  void connect(Nanoseconds now);
  /// The host closed the port.
  void disconnect(Nanoseconds now);
  bool connected() const { return connected_; }
  /// False while the cable is out.
  bool linkUp() const { return link_up_; }

  void received(std::string_view bytes, Nanoseconds now);
  void tick(Nanoseconds now);
  Nanoseconds deadline() const;

  struct Output {
    std::string bytes;        ///< one write
    bool disconnect = false;  ///< the cable was pulled: drop the connection, linkUp() says when it's back
    int baud_rate = 0;        ///< the device switched to this rate
    bool empty() const { return bytes.empty() && !disconnect && baud_rate == 0; }
  };
  Output takeOutput();

  /// Rate that the host has set on a serial line. What is sent at another than the device's comes out
  /// garbled, and the device doesn't understand it. 0 (default): not checked.
  void setHostBaudRate(int rate) { host_baud_rate_ = rate; }
  int baudRate() const { return baud_rate_; }

  void inject(Fault fault, Nanoseconds when) { faults_.add(fault, when); }
  const FaultInjector& faults() const { return faults_; }
  const Counts& counts() const { return counts_; }
  /// The scans whose last byte was taken since the last call.
  std::vector<SentScan> takeSentScans();

 protected:
  virtual void onReceived(std::string_view bytes, Nanoseconds now) = 0;
  /// The next time at which something happens in the device by itself.
  virtual Nanoseconds nextEvent() const = 0;
  virtual void onEvent(Nanoseconds now) = 0;
  /// Power came: all but what is stored for good is as it was made.
  virtual void onPowerUp(Nanoseconds now) = 0;
  virtual void onBooted(Nanoseconds) {}
  virtual void onHostClosed(Nanoseconds) {}
  virtual void startStreaming(Nanoseconds now) = 0;
  /// A message of which a host may see the end when it connects.
  virtual std::string exampleMessage(Nanoseconds now) = 0;

  /// To be called by the constructor of the derived class.
  void start();
  void reply(const std::string& message, Nanoseconds now) { send(message, now, nullptr); }
  void sendScan(const std::string& message, Nanoseconds now, SentScan scan);
  bool lineHasRoom() const;
  void changeBaudRate(int rate, Nanoseconds when);
  /// Switches power off and on; what isn't out yet is lost.
  void powerUp(Nanoseconds now);
  /// The same, and the connection is lost.
  void reboot(Nanoseconds now);
  bool running() const { return boot_end_ == 0; }

  std::shared_ptr<ScanSource> source_;
  FaultInjector faults_;
  Transmitter transmitter_;
  Counts counts_;

 private:
  void send(std::string message, Nanoseconds now, std::shared_ptr<SentScan> scan);
  void pullCable(Nanoseconds now);
  Nanoseconds ownEvent() const;
  void onOwnEvent(Nanoseconds now);
  void damage(std::string& message, SentScan* scan, bool& complete, Nanoseconds now);

  const DeviceOptions options_;
  Nanoseconds now_ = 0;
  bool connected_ = false, link_up_ = true, disconnect_pending_ = false;
  Nanoseconds link_back_ = kNever;
  Nanoseconds boot_end_ = 0;  // 0: running
  Nanoseconds silent_until_ = 0;
  int baud_rate_ = 0, next_baud_rate_ = 0, host_baud_rate_ = 0;
  Nanoseconds baud_change_ = kNever;
  bool baud_rate_changed_ = false;
  std::vector<SentScan> sent_;
};

}  // namespace device_emulators
