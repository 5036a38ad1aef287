// SPDX-License-Identifier: BSD-3-Clause
//
// Life cycle, clock and measuring. What the commands do is in hokuyo_commands.cpp.
#include "hokuyo_device.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "scip_text.h"

namespace device_emulators {
namespace {

constexpr std::int64_t kCounterMask = (1 << 24) - 1;
constexpr std::size_t kMaxLine = 256;
constexpr int kFactoryBitRate = 19200;

// The message with another sum in one of its data rows.
std::string withWrongSum(std::string message, FaultInjector& faults) {
  std::vector<std::size_t> ends;  // of the rows, at the LF
  std::size_t line = 0;
  for (std::size_t i = 0; i < message.size(); ++i) {
    if (message[i] != '\n') continue;
    if (line >= 3 && message[i - 1] != '\n') ends.push_back(i);
    ++line;
  }
  if (ends.empty()) return message;
  char& sum = message[ends[faults.random(0, ends.size() - 1)] - 1];
  sum = static_cast<char>(((sum - 0x30) ^ 1) + 0x30);
  return message;
}

}  // namespace

HokuyoOptions::HokuyoOptions(const std::string& model_name) : model(hokuyoModel(model_name)) {}

HokuyoDevice::HokuyoDevice(const HokuyoOptions& options, std::shared_ptr<ScanSource> source)
    : Device(options, std::move(source)), options_(options) {
  onPowerUp(0);
  setClock(0, options_.start_ms);
  start();
}

void HokuyoDevice::setClock(Nanoseconds now, std::uint32_t ms) {
  clock_epoch_ = now;
  clock_start_ = ms;
}

std::uint32_t HokuyoDevice::counter(Nanoseconds now) const {
  const Nanoseconds elapsed = now - clock_epoch_;
  const Nanoseconds shown = elapsed + std::llround(static_cast<double>(elapsed) * options_.drift_ppm * 1e-6);
  return static_cast<std::uint32_t>((clock_start_ + shown / kMillisecond) & kCounterMask);
}

void HokuyoDevice::onPowerUp(Nanoseconds now) {
  stop();
  input_.clear();
  adjusting_time_ = asleep_ = sensitive_ = false;
  malfunction_ = motor_level_ = 0;
  bit_rate_ = options_.line.baud_rate > 0 ? options_.line.baud_rate : kFactoryBitRate;
  if (options_.line.baud_rate > 0 && baudRate() != bit_rate_) changeBaudRate(bit_rate_, now);
  restart_asked_.reset();
  restart_at_ = kNever;
  setClock(now, 0);
  motor_epoch_ = now;
  period_ = 60 * kSecond / model_.rpm;
}

void HokuyoDevice::onHostClosed(Nanoseconds) {
  if (!options_.stop_on_close) return;
  stop();
  adjusting_time_ = false;
  input_.clear();
}

void HokuyoDevice::stop() {
  stream_.reset();
  single_.reset();
  laser_on_ = false;
}

Nanoseconds HokuyoDevice::scanEnd(std::int64_t turn) const {
  return turnStart(turn) + period_ * (model_.amax + 1) / model_.ares;
}

std::int64_t HokuyoDevice::nextTurn(Nanoseconds now) const {
  return std::max<Nanoseconds>(now - motor_epoch_ + period_ - 1, 0) / period_;
}

Nanoseconds HokuyoDevice::nextEvent() const {
  return std::min(
      {restart_at_, stream_ ? scanEnd(stream_->turn) : kNever, single_ ? scanEnd(single_->turn) : kNever});
}

void HokuyoDevice::onEvent(Nanoseconds now) {
  if (restart_at_ <= now) {
    reboot(now);
    return;
  }
  if (single_ && scanEnd(single_->turn) <= now) {
    sendMeasurement(*std::exchange(single_, std::nullopt), now);
    return;
  }
  if (!stream_ || scanEnd(stream_->turn) > now) return;
  const bool busy = baudRate() > 0 && transmitter_.freeAt() > now;
  if (busy || !lineHasRoom()) {
    ++stream_->turn;
    ++counts_.skipped;
    return;
  }
  const Measurement measurement = *stream_;
  stream_->turn += 1 + stream_->request.interval;
  if (measurement.request.count > 0 && --stream_->left == 0) stop();
  sendMeasurement(measurement, now);
}

void HokuyoDevice::sendMeasurement(const Measurement& measurement, Nanoseconds now) {
  if (!connected()) return;
  const HokuyoRequest& request = measurement.request;
  std::string echo = request.echo;
  if (request.continuous) {
    const int to_come = request.count > 0 ? measurement.left - 1 : 0;
    echo += static_cast<char>('0' + to_come / 10);
    echo += static_cast<char>('0' + to_come % 10);
    if (faults_.hits(Fault::kUnstable, now)) {
      return reply(scipReply(echo + request.user_text, "0M"), now);
    }
    if (faults_.hits(Fault::kErrorStatus, now)) {
      stop();
      return reply(scipReply(echo + request.user_text, std::to_string(faults_.random(50, 97))), now);
    }
  }
  echo += request.user_text;
  const Nanoseconds start = turnStart(measurement.turn);
  SentScan scan = measure(source_->at(start).get(), model_, request, options_.partial_group);
  scan.start = start;
  scan.device_stamp = counter(start);
  std::string message =
      scipReply(echo, request.continuous ? "99" : "00",
                scipLine(scipEncode(counter(start), 4)) + scipRows(encodeScan(scan, request)));
  if (faults_.hits(Fault::kWrongSum, now)) {
    message = withWrongSum(std::move(message), faults_);
    scan.fault = faultName(Fault::kWrongSum);
  }
  sendScan(message, now, std::move(scan));
}

void HokuyoDevice::startStreaming(Nanoseconds now) {
  Measurement all;
  all.request.first = model_.amin;
  all.request.last = model_.amax;
  all.request.continuous = true;
  char echo[16];
  std::snprintf(echo, sizeof echo, "MD%04d%04d010", model_.amin, model_.amax);
  all.request.echo = echo;
  all.turn = nextTurn(now);
  stream_ = all;
  laser_on_ = true;
}

std::string HokuyoDevice::exampleMessage(Nanoseconds now) {
  HokuyoRequest all;
  all.first = model_.amin;
  all.last = model_.amax;
  const SentScan scan = measure(source_->at(now).get(), model_, all, false);
  return scipReply("MD", "99", scipLine(scipEncode(counter(now), 4)) + scipRows(encodeScan(scan, all)));
}

void HokuyoDevice::onReceived(std::string_view bytes, Nanoseconds now) {
  for (const char byte : bytes) {
    if (byte != '\n' && byte != '\r') {
      if (input_.size() < kMaxLine) input_ += byte;
      continue;
    }
    const std::string line = std::exchange(input_, "");
    if (line.empty()) continue;  // CR LF, or a lone LF that ends a half-typed command
    ++counts_.commands;
    execute(line, now);
    if (!running()) return;
  }
}

}  // namespace device_emulators
