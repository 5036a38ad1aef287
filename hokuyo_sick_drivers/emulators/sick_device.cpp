// SPDX-License-Identifier: BSD-3-Clause
//
// Life cycle, mirror and streams. What the commands do is in sick_commands.cpp.
#include "sick_device.h"

#include <algorithm>
#include <set>
#include <stdexcept>
#include <utility>

#include "sick_modes.h"

namespace device_emulators {
namespace {

constexpr Nanoseconds kTurnsPerSecond = 75;
const std::string kAck = "\x06", kNak = "\x15";
constexpr std::size_t kMaxWaitingCommands = 4;
constexpr int kQuarters = 4;  // of a degree

}  // namespace

SickModel sickModel(const std::string& name) {
  if (name == "LMS291-S05") return {name, "LMS291;S05;V02.30", {180, 100}, false, false};
  if (name == "LMS291-S14") return {name, "LMS291;S14;V02.30", {90, 50}, true, true};
  throw std::runtime_error("unknown model '" + name + "'; known are LMS291-S05 LMS291-S14");
}

SickOptions::SickOptions(const std::string& model_name) : model(sickModel(model_name)) {
  line.baud_rate = power_up_baud_rate;
  boot_delay = 30 * kSecond;
}

SickDevice::SickDevice(const SickOptions& options, std::shared_ptr<ScanSource> source)
    : Device(options, std::move(source)),
      options_(options),
      reader_(options.byte_gap),
      configuration_(options.configuration_size),
      variant_(options.model.variant),
      mode_(kOnRequest) {
  start();
}

void SickDevice::onPowerUp(Nanoseconds now) {
  reader_.clear();
  work_.clear();
  restart_at_ = kNever;
  variant_ = options_.model.variant;
  mode_ = kOnRequest;
  mirror_epoch_ = now;
  changeBaudRate(options_.power_up_baud_rate, now);
}

void SickDevice::onBooted(Nanoseconds now) {
  sendTelegram('\x90' + paddedType(options_.model.type), now);
}

void SickDevice::startStreaming(Nanoseconds now) {
  if (streams()) return;
  mode_ = kStreamAll;
  streamed_ = {mode_, {}, 1};
  next_turn_ = nextScan(now, streamed_);
}

std::string SickDevice::exampleMessage(Nanoseconds now) {
  const SickRequest all{kStreamAll, {}, 1};
  return lmsTelegram(measureScan(nextScan(now, all), all).payload, options_.status);
}

bool SickDevice::streams() const {
  static const std::set<unsigned> kStreams = {
      kStreamAll,     kStreamMeans,       kStreamSubrange,      kStreamMeansOfSubrange,
      kStreamPartial, kStreamIntensities, kStreamReflectivities};
  return kStreams.count(mode_) > 0;
}

int SickDevice::turnsOf(const SickRequest& request) const {
  return request.scans * (request.mode == kStreamPartial || options_.model.fast ? 1 : variant_.turns());
}

Nanoseconds SickDevice::turnStart(std::int64_t turn) const {
  return mirror_epoch_ + turn * kSecond / kTurnsPerSecond;
}

Nanoseconds SickDevice::scanEnd(std::int64_t turn, const SickRequest& request) const {
  const int right_end = (180 - variant_.angle) / 2;
  return turnStart(turn + turnsOf(request) - 1) +
         kSecond / kTurnsPerSecond * (right_end + variant_.angle) / 360;
}

std::int64_t SickDevice::nextScan(Nanoseconds now, const SickRequest& request) const {
  const std::int64_t turns = turnsOf(request);
  std::int64_t turn = std::max<Nanoseconds>(now - mirror_epoch_, 0) * kTurnsPerSecond / kSecond;
  while (turnStart(turn) < now || turn % turns != 0) ++turn;
  return turn;
}

Nanoseconds SickDevice::nextEvent() const {
  const Nanoseconds scan = streams() ? scanEnd(next_turn_, streamed_) : kNever;
  return std::min(restart_at_, work_.empty() ? scan : work_.front().due);
}

void SickDevice::onEvent(Nanoseconds now) {
  if (restart_at_ <= now) return powerUp(now);
  if (!work_.empty()) return work(now);
  const std::int64_t turn = next_turn_;
  next_turn_ += turnsOf(streamed_);
  if (!connected()) return;
  if (transmitter_.freeAt() > now || !lineHasRoom()) {
    ++counts_.skipped;
    return;
  }
  sendScanTelegram(measureScan(turn, streamed_), now);
}

void SickDevice::onReceived(std::string_view bytes, Nanoseconds now) {
  for (LmsReader::Telegram& telegram : reader_.read(bytes, now)) {
    ++counts_.commands;
    if (work_.size() >= kMaxWaitingCommands) continue;
    transmitter_.cut(now);  // a command ends the telegram in progress
    Work work;
    work.good = telegram.good && !faults_.hits(Fault::kNak, now);
    work.command = std::move(telegram.payload);
    work_.push_back(std::move(work));
    if (work_.size() == 1) begin(now);
  }
}

void SickDevice::begin(Nanoseconds now) {
  work_.front().due = now + options_.ack_delay;
}

Nanoseconds SickDevice::delayOf(const std::string& command) const {
  switch (static_cast<unsigned char>(command[0])) {
    case kChangeMode:
      return options_.mode_delay;
    case kWriteConfiguration:
      return options_.configure_delay;
    default:
      return options_.reply_delay;
  }
}

void SickDevice::work(Nanoseconds now) {
  Work& work = work_.front();
  if (!work.acknowledged) {
    reply(work.good ? kAck : kNak, now);
    if (!running() || work_.empty()) return;  // a fault may come with every byte sent
    if (!work.good) return finish(now);
    work.acknowledged = true;
    work.due = now + delayOf(work.command);
    return;
  }
  if (!work.measuring && readMeasuringCommand(work.command)) {
    work.measuring = true;
    work.turn = nextScan(now, asked_);
    work.due = scanEnd(work.turn, asked_);
    return;
  }
  if (work.measuring) {
    sendScanTelegram(measureScan(work.turn, asked_), now);
  } else {
    const std::string command = work.command;
    asked_baud_rate_ = 0;
    sendTelegram(execute(command), now);
    if (asked_baud_rate_ > 0) changeBaudRate(asked_baud_rate_, transmitter_.freeAt());
    if (command[0] == kReset && command.size() == 1) restart_at_ = transmitter_.freeAt();
  }
  if (running() && !work_.empty()) finish(now);
}

void SickDevice::finish(Nanoseconds now) {
  work_.pop_front();
  if (!work_.empty()) return begin(now);
  if (streams()) next_turn_ = nextScan(now, streamed_);
}

// Which quarter of a degree a turn's partial scan is shifted by; -1 for whole scans.
int SickDevice::partialOf(std::int64_t turn, const SickRequest& request) const {
  if (request.mode != kStreamPartial) return -1;
  return static_cast<int>(turn % variant_.turns()) * kQuarters / variant_.turns();
}

// Values of the scan that begins with a turn.
SentScan SickDevice::measureTurns(std::int64_t turn, const SickRequest& request, int first, int last) const {
  SickVariant variant = variant_;
  double offset = 0.0;
  if (request.mode == kStreamPartial) {
    // 100 degrees at 0.25 stand for 180 at 0.25 here. A turn has a value per degree.
    if (variant.resolution == 25) variant.angle = 180;
    offset = partialOf(turn, request) / static_cast<double>(kQuarters);
    variant.resolution = 100;
    if (last == 0) last = variant.values() - (offset > 0.0 ? 1 : 0);
  }
  if (last == 0) last = variant.values();
  const auto scan = source_->at(turnStart(turn));
  SentScan sent = measure(scan.get(), variant, configuration_, options_.coding, first, last, offset);
  const double degrees = (180 - variant.angle) / 2.0 + offset + (first - 1) * variant.resolution / 100.0;
  sent.start = turnStart(turn) + static_cast<Nanoseconds>(kSecond / kTurnsPerSecond * degrees / 360.0);
  return sent;
}

SickDevice::ScanTelegram SickDevice::measureScan(std::int64_t turn, const SickRequest& request) {
  const std::int64_t last_turn = turn + turnsOf(request) - 1;
  const auto index = static_cast<unsigned char>(last_turn & 0xff);
  if (request.mode == kStreamIntensities) {
    std::vector<SentScan> parts;
    for (const SickGroup& group : request.groups) {
      parts.push_back(measureTurns(turn, request, group.first, group.last));
      parts.back().device_stamp = last_turn;
      if (!configuration_.hasIntensityMode()) parts.back().intensities.assign(parts.back().ranges.size(), 0);
    }
    const bool wrong_count = faults_.hits(Fault::kCountMismatch, turnStart(turn));
    ScanTelegram telegram{encodeIntensities(parts, configuration_, options_.coding, index, wrong_count),
                          parts[0]};
    if (wrong_count) telegram.scan.fault = faultName(Fault::kCountMismatch);
    for (std::size_t i = 1; i < parts.size(); ++i) {
      auto& all = telegram.scan;
      all.ranges.insert(all.ranges.end(), parts[i].ranges.begin(), parts[i].ranges.end());
      all.intensities.insert(all.intensities.end(), parts[i].intensities.begin(), parts[i].intensities.end());
    }
    return telegram;
  }
  const bool is_part = request.mode == kStreamSubrange || request.mode == kStreamMeansOfSubrange;
  const SickGroup part = is_part ? request.groups[0] : SickGroup{1, 0};
  std::vector<SentScan> scans;
  for (int i = 0; i < request.scans; ++i)
    scans.push_back(
        measureTurns(turn + i * turnsOf(request) / request.scans, request, part.first, part.last));
  SentScan sent = meanOf(scans, configuration_);
  sent.device_stamp = last_turn;
  if (request.mode == kStreamReflectivities) {
    for (auto& intensity : sent.intensities) intensity = std::min(intensity, 255u);
    return {encodeReflectivities(sent, request.groups[0], configuration_, index), sent};
  }
  sent.intensities.clear();
  std::string head{is_part ? (request.scans > 1 ? '\xbf' : '\xb7') : (request.scans > 1 ? '\xb6' : '\xb0')};
  if (request.scans > 1) head += static_cast<char>(request.scans);
  if (is_part) {
    appendWord(head, static_cast<unsigned>(part.first));
    appendWord(head, static_cast<unsigned>(part.last));
  }
  return {encodeRanges(head, sent, configuration_, partialOf(turn, request), index), sent};
}

void SickDevice::sendTelegram(const std::string& payload, Nanoseconds now) {
  std::string telegram = lmsTelegram(payload, options_.status);
  if (connected() && faults_.hits(Fault::kWrongSum, now)) telegram.back() ^= 1;
  reply(telegram, now);
}

void SickDevice::sendScanTelegram(ScanTelegram telegram, Nanoseconds now) {
  std::string bytes = lmsTelegram(telegram.payload, options_.status);
  if (connected() && faults_.hits(Fault::kWrongSum, now)) {
    bytes.back() ^= 1;
    telegram.scan.fault +=
        (telegram.scan.fault.empty() ? "" : "+") + std::string(faultName(Fault::kWrongSum));
  }
  sendScan(bytes, now, std::move(telegram.scan));
}

}  // namespace device_emulators
