// SPDX-License-Identifier: BSD-3-Clause
//
// How Lms2xx finds its device and sets it up.
#include <algorithm>
#include <utility>

#include "hokuyo_sick_drivers/lms2xx.h"

namespace hokuyo_sick_drivers {
namespace {

using lms::Variant;
using lms::word;

const std::string kModeRequest = "\x20", kStatusRequest = "\x31", kTypeRequest = "\x3A",
                  kVariantRequest = "\x3B", kConfigurationRequest = "\x74", kConfigurationWrite = "\x77";
// Operating modes.
const std::string kInstallation("\0SICK_LMS", 9), kStreamRanges = "\x24", kOnRequest = "\x25",
                                                  kStreamPartialScans = "\x2A", kStreamIntensities = "\x2B",
                                                  kStreamReflectivities = "\x50";
// Measuring modes.
constexpr char kFieldsMode = 0x00, kNormalisedMode = 0x0D, kDirectMode = 0x0E;

constexpr int kPowerUpRate = 9600;
constexpr int kRounds = 4;  // over all rates, before the port is opened anew

constexpr Nanoseconds kTimeout = kSecond, kModeTimeout = 4 * kSecond, kWriteTimeout = 15 * kSecond;
// After a command to stop, what was being sent ends within
constexpr Nanoseconds kQuietTime = 100 * kMillisecond;
constexpr Nanoseconds kProbeTime = kSecond / 2;
constexpr Nanoseconds kSilence = kSecond / 5;
constexpr Nanoseconds kSettleTime = 300 * kMillisecond;
// Without a scan: this long, and so many times what a scan takes.
constexpr double kPatience = 0.5, kPatiencePeriods = 3.0;
// The EEPROM wears out.
constexpr int kMaxWrites = 3;
constexpr Nanoseconds kWritePause = 60 * kSecond;

// 180 degrees by 0.25 are four turns at 100 degrees by 0.25.
Variant onDevice(const Variant& variant) {
  return variant == Variant{180, 25} ? Variant{100, 25} : variant;
}

void setBits(char& flags, int bits, std::optional<bool> on) {
  if (on) flags = static_cast<char>(*on ? flags | bits : flags & ~bits);
}

}  // namespace

// --------------------------------------------------------------------------------------------------------
// baud rate

void Lms2xx::search(int first_rate, Nanoseconds now) {
  report_.phase = LmsReport::Phase::kSearching;
  report_.baud_rate = 0;
  rates_ = {first_rate};
  const auto add = [this](int rate) {
    if (std::find(rates_.begin(), rates_.end(), rate) == rates_.end()) rates_.push_back(rate);
  };
  add(options_.baud_rate);
  add(kPowerUpRate);
  for (const auto& rate : lms::kBaudRates) add(rate.first);
  rate_ = 0;
  tryRate(now);
}

void Lms2xx::tryRate(Nanoseconds now) {
  setLineRate(rates_[rate_]);
  parser_.clear();
  send(kModeRequest + kOnRequest);
  stop_sent_ = now;
  stop_confirmed_ = false;
  wait(Step::kQuiet, kQuietTime, now);
}

// The LMS cuts off what it is sending, and answers. That may take as long as any change of mode; if there was
// something on the line that has ceased, the rate may be the right one.
void Lms2xx::probe(Nanoseconds now) {
  if (step_ == Step::kQuiet) flush(now);
  if (step_ != Step::kQuiet && step_ != Step::kProbe) return;  // there was something inside
  const bool ceased = heard_ > 0 && now - last_byte_ >= kSilence && now - stop_sent_ < kModeTimeout;
  if (step_ == Step::kQuiet || ceased) {
    transmit(kStatusRequest);
    return wait(Step::kProbe, kProbeTime, now);
  }
  if (++rate_ < rates_.size()) return tryRate(now);
  if (++rounds_ < kRounds) return search(options_.baud_rate, now);
  report_.problem = "no answer at any baud rate; check the cable, or switch the device off and on";
  idle();
  output_.push_back({});
  output_.back().reconnect = true;
}

void Lms2xx::probed(Nanoseconds now) {
  rounds_ = 0;
  report_.baud_rate = line_rate_;
  report_.phase = LmsReport::Phase::kSettingUp;
  report_.warning.clear();
  if (found_.baud_rate == 0) found_.baud_rate = line_rate_;
  if (line_rate_ == options_.baud_rate) return readType(now);
  changeRate(options_.baud_rate, now);
}

void Lms2xx::changeRate(int baud_rate, Nanoseconds now) {
  next_rate_ = baud_rate;
  for (const auto& [rate, mode] : lms::kBaudRates) {
    if (rate == baud_rate) changeMode(Step::kChangeRate, {mode}, now);
  }
}

void Lms2xx::testRate(Nanoseconds now) {
  parser_.clear();
  request(Step::kTestRate, kStatusRequest, lms::kStatus, kTimeout, now);
}

// --------------------------------------------------------------------------------------------------------
// variant and configuration

void Lms2xx::readType(Nanoseconds now) {
  request(Step::kReadType, kTypeRequest, lms::kType, kTimeout, now);
}

void Lms2xx::setVariant(Nanoseconds now) {
  const Variant wanted = stopping_ ? found_.variant.value_or(device_variant_) : onDevice(wantedVariant());
  if (isFast() || device_variant_ == wanted) return readConfiguration(now);
  request(Step::kSetVariant, kVariantRequest + word(wanted.angle) + word(wanted.resolution), lms::kVariant,
          kTimeout, now);
}

void Lms2xx::readConfiguration(Nanoseconds now) {
  request(Step::kReadConfiguration, kConfigurationRequest, lms::kConfiguration, kTimeout, now);
}

void Lms2xx::checkConfiguration(Nanoseconds now) {
  report_.measuring_mode = static_cast<std::uint8_t>(configuration_[lms::kMeasuringMode]);
  report_.unit = static_cast<lms::Unit>(configuration_[lms::kUnit]);
  if (configuration_ == wantedConfiguration()) {
    writes_ = 0;
    return configured(now);
  }
  if (!std::exchange(configuration_refused_, false) && now >= next_write_) {
    return changeMode(Step::kInstall, kInstallation, now);
  }
  report_.warning = "the device doesn't accept the configuration";
  if (stopping_ || hasRanges()) return configured(now);
  refuse("the device doesn't accept the measuring mode", now);
}

void Lms2xx::leaveInstallation(Nanoseconds now) {
  stop(Step::kLeaveInstallation, now);
}

void Lms2xx::configured(Nanoseconds now) {
  if (!stopping_) return start(now);
  if (found_.baud_rate == line_rate_) return idle();
  changeRate(found_.baud_rate, now);
}

Variant Lms2xx::wantedVariant() const {
  if (isFast()) return {90, 50};
  if (options_.variant) return *options_.variant;
  if (options_.intensity == LmsOptions::Intensity::kNone && device_variant_.valid()) return device_variant_;
  return {180, 100};
}

std::string Lms2xx::wantedConfiguration() const {
  std::string wanted = configuration_;
  if (stopping_) return found_.configuration.size() == wanted.size() ? found_.configuration : wanted;
  char& mode = wanted[lms::kMeasuringMode];
  if (options_.measuring_mode) {
    mode = static_cast<char>(*options_.measuring_mode);
  } else if (!isFast() && !hasRanges()) {
    mode = options_.intensity == LmsOptions::Intensity::kNone         ? kFieldsMode
           : options_.intensity == LmsOptions::Intensity::kNormalised ? kNormalisedMode
                                                                      : kDirectMode;
  }
  if (options_.unit) wanted[lms::kUnit] = static_cast<char>(*options_.unit);
  if (options_.sensitivity) wanted[lms::kSensitivity] = static_cast<char>(*options_.sensitivity);
  char& availability = wanted[lms::kAvailability];
  setBits(availability, lms::kHighestAvailability, options_.highest_availability);
  setBits(availability, lms::kSendRealTimeIndex, options_.real_time_index);
  setBits(availability, lms::kIgnoreDazzling, options_.ignore_dazzling);
  return wanted;
}

// Whether the device's measuring mode has what is asked for.
bool Lms2xx::hasRanges() const {
  const char mode = configuration_[lms::kMeasuringMode];
  switch (options_.intensity) {
    case LmsOptions::Intensity::kNormalised:
      return isFast() || mode == kNormalisedMode;
    case LmsOptions::Intensity::kDirect:
      return isFast() || mode == kDirectMode;
    default:
      return lms::RangeWord::ofMode(mode).has_value();
  }
}

// --------------------------------------------------------------------------------------------------------
// scans

lms::ScanFormat Lms2xx::format() const {
  lms::ScanFormat format;
  format.variant = wantedVariant();
  format.interlaced = options_.interlaced && !isFast();
  format.first = options_.first_index;
  format.last = options_.last_index == 0 ? format.variant.values() : options_.last_index;
  format.baud_rate = line_rate_;
  if (options_.intensity == LmsOptions::Intensity::kNone || isFast()) {
    const int mode = static_cast<std::uint8_t>(configuration_[lms::kMeasuringMode]);
    format.range_word = lms::RangeWord::ofMode(mode).value_or(lms::RangeWord());
    if (options_.intensity != LmsOptions::Intensity::kNone) format.code = lms::kReflectivities;
  } else {
    format.code = lms::kIntensities;
    if (options_.intensity_range != LmsOptions::IntensityRange::kFlags) format.range_word.bits = 16;
    if (options_.intensity_range == LmsOptions::IntensityRange::kSixteen) format.range_word.top = 0xFFFF;
  }
  return format;
}

void Lms2xx::start(Nanoseconds now) {
  const lms::ScanFormat format = this->format();
  if (format.last > format.variant.values()) {
    return refuse("value " + std::to_string(format.last) + " is asked for, a fast LMS has 181", now);
  }
  decoder_.emplace(format);
  good_report_ = report_;
  report_.variant = format.variant;
  report_.scan_rate = 1.0 / format.period();
  changeMode(Step::kStart, startCommand(format), now);
}

std::string Lms2xx::startCommand(const lms::ScanFormat& format) const {
  const std::string range = word(format.first) + word(format.last);
  if (format.code == lms::kIntensities) return kStreamIntensities + word(1) + range;
  if (format.code == lms::kReflectivities) return kStreamReflectivities + range;
  return format.interlaced ? kStreamPartialScans : kStreamRanges;
}

void Lms2xx::stream(Nanoseconds now) {
  report_.phase = LmsReport::Phase::kStreaming;
  const double patience = kPatience + kPatiencePeriods / report_.scan_rate;
  wait(Step::kStream, static_cast<Nanoseconds>(patience * kSecond), now);
}

void Lms2xx::stop(Step step, Nanoseconds now) {
  changeMode(step, kOnRequest, now);
}

// --------------------------------------------------------------------------------------------------------
// answers

void Lms2xx::changeMode(Step step, const std::string& mode, Nanoseconds now) {
  request(step, kModeRequest + mode, lms::kModeChanged, kModeTimeout, now);
}

// The answer that was waited for. @throws DecodeError, and goes on waiting
void Lms2xx::answered(const lms::Telegram& telegram, Nanoseconds now) {
  switch (step_) {
    case Step::kProbe: {
      const Variant variant = lms::decodeStatus(telegram).variant;
      report_.software_version = lms::decodeStatus(telegram).software_version;
      device_variant_ = variant;
      if (variant.valid() && !found_.variant) found_.variant = variant;
      const bool late = !stop_confirmed_ && damaged() == damaged_;
      if (!late) return probed(now);
      return wait(Step::kAwaitStop, stop_sent_ + kModeTimeout - now, now);
    }
    case Step::kTestRate:
      report_.baud_rate = line_rate_;
      return readType(now);
    case Step::kReadType:
      report_.type = lms::decodeType(telegram);
      if (report_.type.find("LMS") == std::string::npos) {
        report_.warning = report_.type + " is no type of LMS";
      }
      return setVariant(now);
    case Step::kSetVariant: {
      const lms::VariantReply reply = lms::decodeVariant(telegram);
      if (!reply.accepted) return refused(now);
      device_variant_ = reply.variant;
      return readConfiguration(now);
    }
    case Step::kReadConfiguration:
      configuration_ = lms::decodeConfiguration(telegram);
      if (found_.configuration.empty()) found_.configuration = configuration_;
      return checkConfiguration(now);
    case Step::kWriteConfiguration:
      configuration_refused_ = !lms::decodeConfigured(telegram);
      if (configuration_refused_) ++report_.refused;
      return leaveInstallation(now);
    default:
      return modeChanged(lms::decodeModeChange(telegram), now);
  }
}

void Lms2xx::modeChanged(int result, Nanoseconds now) {
  if (result != 0) {
    ++report_.refused;
    return refused(now, result == 1   ? ": wrong password"
                        : result == 2 ? ": a fault in the device"
                                      : ": result " + std::to_string(result));
  }
  switch (step_) {
    case Step::kStop:
      return options_.restore_on_exit && !configuration_.empty() ? setVariant(now) : idle();
    case Step::kChangeRate:
      setLineRate(next_rate_);
      return stopping_ ? idle() : wait(Step::kSettle, kSettleTime, now);
    case Step::kInstall:
      ++report_.configurations_written;
      if (++writes_ >= kMaxWrites) {
        writes_ = 0;
        next_write_ = now + kWritePause;
      }
      return request(Step::kWriteConfiguration, kConfigurationWrite + wantedConfiguration(), lms::kConfigured,
                     kWriteTimeout, now, 1);
    case Step::kLeaveInstallation:
      return readConfiguration(now);
    default:
      return stream(now);
  }
}

// The device knows the command but won't do it, or doesn't know it.
void Lms2xx::refused(Nanoseconds now, const std::string& why) {
  switch (step_) {
    case Step::kChangeRate:
      report_.warning = "the device doesn't change to " + std::to_string(next_rate_) + " baud" + why;
      return stopping_ ? idle() : readType(now);
    case Step::kReadType:
      report_.warning = "the device doesn't tell its type";
      return setVariant(now);
    case Step::kSetVariant:
      return refuse("the device doesn't accept " + wantedVariant().text(), now);
    case Step::kInstall:
    case Step::kWriteConfiguration:
      configuration_refused_ = true;
      return leaveInstallation(now);
    case Step::kStart:
      return refuse("the device doesn't accept the command to send scans" + why, now);
    default:
      return refuse("the device doesn't accept an ordinary command" + why, now);
  }
}

}  // namespace hokuyo_sick_drivers
