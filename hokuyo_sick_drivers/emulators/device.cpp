// SPDX-License-Identifier: BSD-3-Clause
#include "device.h"

#include <algorithm>
#include <utility>

namespace device_emulators {
namespace {

// A device whose host doesn't read gives up scans beyond this.
constexpr std::size_t kMaxBacklog = 1 << 18;

}  // namespace

Device::Device(const DeviceOptions& options, std::shared_ptr<ScanSource> source)
    : source_(std::move(source)),
      faults_(options.faults, options.seed),
      transmitter_(options.line, options.seed + 1),
      options_(options),
      baud_rate_(options.line.baud_rate) {}

void Device::start() {
  if (options_.power_up_at_start) {
    powerUp(0);
  } else if (options_.streaming) {
    startStreaming(0);
  }
}

void Device::connect(Nanoseconds now) {
  tick(now);
  if (connected_ || !link_up_) return;
  connected_ = true;
  ++counts_.connects;
  transmitter_.clear();
  if (!running()) return;
  if (faults_.hits(Fault::kAlreadyStreaming, now)) startStreaming(now);
  if (faults_.hits(Fault::kHalfMessage, now)) {
    const std::string message = exampleMessage(now);
    transmitter_.send(message.substr(faults_.random(1, message.size() - 1)), now);
  }
}

void Device::disconnect(Nanoseconds now) {
  tick(now);
  if (!connected_) return;
  connected_ = false;
  transmitter_.clear();
  if (running()) onHostClosed(now);
}

void Device::received(std::string_view bytes, Nanoseconds now) {
  tick(now);
  if (!running() || !connected_) return;
  if (baud_rate_ > 0 && host_baud_rate_ > 0 && baud_rate_ != host_baud_rate_) return;
  onReceived(bytes, now);
}

Nanoseconds Device::ownEvent() const {
  return std::min({link_back_, running() ? kNever : boot_end_, faults_.nextMoment(), baud_change_});
}

void Device::onOwnEvent(Nanoseconds now) {
  if (link_back_ <= now) {
    link_back_ = kNever;
    link_up_ = true;
  }
  if (baud_change_ <= now) {
    baud_change_ = kNever;
    baud_rate_ = next_baud_rate_;
    transmitter_.setBaudRate(baud_rate_);
    baud_rate_changed_ = true;
  }
  if (!running() && boot_end_ <= now) {
    boot_end_ = 0;
    onBooted(now);
  }
  const FaultOptions& faults = faults_.options();
  while (faults_.momentCame(Fault::kStall, now)) transmitter_.hold(now, now + faults.stall);
  while (faults_.momentCame(Fault::kSilence, now)) silent_until_ = now + faults.silence;
  while (faults_.momentCame(Fault::kDisconnect, now)) pullCable(now);
  while (faults_.momentCame(Fault::kReboot, now)) reboot(now);
}

void Device::tick(Nanoseconds now) {
  for (;;) {
    const Nanoseconds own = ownEvent(), derived = running() ? nextEvent() : kNever;
    if (std::min(own, derived) > now) break;
    now_ = std::max(now_, std::min(own, derived));
    if (own <= derived) {
      onOwnEvent(now_);
    } else {
      onEvent(now_);
    }
  }
  now_ = std::max(now_, now);
  if (!connected_) transmitter_.clear();
}

Nanoseconds Device::deadline() const {
  if (disconnect_pending_ || baud_rate_changed_) return now_;
  return std::min({ownEvent(), running() ? nextEvent() : kNever, transmitter_.deadline()});
}

Device::Output Device::takeOutput() {
  Output output;
  if (baud_rate_changed_) {
    baud_rate_changed_ = false;
    output.baud_rate = baud_rate_;
    return output;
  }
  if (disconnect_pending_) {
    disconnect_pending_ = false;
    output.disconnect = true;
    return output;
  }
  if (!connected_) return output;
  Transmitter::Piece piece = transmitter_.take(now_);
  if (piece.baud_rate > 0 && host_baud_rate_ > 0 && piece.baud_rate != host_baud_rate_) {
    for (char& byte : piece.bytes) byte = static_cast<char>(faults_.random(0, 255));
    piece.completes = nullptr;
  }
  if (piece.completes) {
    sent_.push_back(*piece.completes);
    ++counts_.scans;
  }
  output.bytes = std::move(piece.bytes);
  return output;
}

std::vector<SentScan> Device::takeSentScans() {
  return std::exchange(sent_, {});
}

bool Device::lineHasRoom() const {
  return transmitter_.backlog() < kMaxBacklog;
}

void Device::sendScan(const std::string& message, Nanoseconds now, SentScan scan) {
  send(message, now, std::make_shared<SentScan>(std::move(scan)));
}

void Device::send(std::string message, Nanoseconds now, std::shared_ptr<SentScan> scan) {
  if (!connected_) return;
  const FaultOptions& faults = faults_.options();
  const bool is_scan = scan != nullptr;
  bool complete = true;
  damage(message, scan.get(), complete, now);
  if (faults_.hits(Fault::kStall, now)) transmitter_.hold(now, now + faults.stall);
  if (faults_.hits(Fault::kSilence, now)) silent_until_ = now + faults.silence;
  if (faults_.hits(Fault::kDisconnect, now)) return pullCable(now);
  if (faults_.hits(Fault::kReboot, now)) return reboot(now);
  if (now < silent_until_) return;
  transmitter_.send(message, now, is_scan, complete ? scan : nullptr);
}

void Device::damage(std::string& message, SentScan* scan, bool& complete, Nanoseconds now) {
  const auto hit = [&](Fault fault) {
    if (message.empty() || !faults_.hits(fault, now)) return false;
    if (scan) scan->fault += (scan->fault.empty() ? "" : "+") + std::string(faultName(fault));
    return true;
  };
  if (hit(Fault::kBytesLost)) {
    const std::size_t count = std::min(faults_.random(1, 4), message.size());
    message.erase(faults_.random(0, message.size() - count), count);
    complete = false;
  }
  if (hit(Fault::kBitsFlipped)) {
    char& byte = message[faults_.random(0, message.size() - 1)];
    byte = static_cast<char>(byte ^ (1 << faults_.random(0, 7)));
  }
  if (hit(Fault::kGarbage)) {
    std::string garbage(faults_.random(1, 32), '\0');
    for (char& byte : garbage) byte = static_cast<char>(faults_.random(0, 255));
    message.insert(faults_.random(0, message.size() - 1), garbage);
  }
  if (hit(Fault::kCut)) {
    message.resize(faults_.random(0, message.size() - 1));
    complete = false;
  }
}

void Device::changeBaudRate(int rate, Nanoseconds when) {
  next_baud_rate_ = rate;
  baud_change_ = when;
}

void Device::pullCable(Nanoseconds now) {
  disconnect_pending_ = disconnect_pending_ || connected_;
  connected_ = link_up_ = false;
  link_back_ = now + faults_.options().outage;
  transmitter_.clear();
}

void Device::reboot(Nanoseconds now) {
  pullCable(now);
  powerUp(now);
}

void Device::powerUp(Nanoseconds now) {
  transmitter_.dropAfter(now);
  silent_until_ = 0;
  baud_change_ = kNever;
  boot_end_ = std::max<Nanoseconds>(now + options_.boot_delay, 1);
  onPowerUp(now);
}

}  // namespace device_emulators
