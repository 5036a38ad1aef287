// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>

#include "hokuyo_device.h"
#include "scip_text.h"

namespace device_emulators {
namespace {

constexpr std::size_t kMaxUserText = 16;
constexpr Nanoseconds kRestartDelay = kSecond;  // RB: time for the second one, and until the restart
constexpr std::array<int, 7> kBitRates = {19200, 38400, 57600, 115200, 250000, 500000, 750000};

bool isNumber(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c); });
}

}  // namespace

struct HokuyoDevice::Command {
  const char* code;
  std::size_t argument_size;
  void (HokuyoDevice::*run)(Nanoseconds now);
  bool HokuyoModel::*needs;  // null: all models have it
};

void HokuyoDevice::execute(const std::string& line, Nanoseconds now) {
  using M = HokuyoModel;
  using D = HokuyoDevice;
  static const std::array<Command, 26> kCommands = {{
      {"VV", 0, &D::version, nullptr},
      {"PP", 0, &D::parameters, nullptr},
      {"II", 0, &D::information, nullptr},
      {"%ST", 0, &D::state, &M::scip22},
      {"BM", 0, &D::laser, nullptr},
      {"QT", 0, &D::quit, nullptr},
      {"RS", 0, &D::reset, nullptr},
      {"RT", 0, &D::partialReset, nullptr},
      {"RB", 0, &D::restart, &M::scip22},
      {"%SL", 0, &D::sleep, &M::scip22},
      {"SS", 6, &D::bitRate, nullptr},
      {"$IP", 36, &D::address, &M::ethernet},
      {"CR", 2, &D::motorSpeed, nullptr},
      {"HS", 1, &D::sensitivity, nullptr},
      {"DB", 2, &D::malfunction, nullptr},
      {"TM", 1, &D::time, nullptr},
      {"MD", 13, &D::measureContinuously, nullptr},
      {"MS", 13, &D::measureContinuously, nullptr},
      {"ME", 13, &D::measureContinuously, &M::intensity},
      {"ND", 13, &D::measureContinuously, &M::multi_echo},
      {"NE", 13, &D::measureContinuously, &M::multi_echo},
      {"GD", 10, &D::measureOnce, nullptr},
      {"GS", 10, &D::measureOnce, nullptr},
      {"GE", 10, &D::measureOnce, &M::intensity},
      {"HD", 10, &D::measureOnce, &M::multi_echo},
      {"HE", 10, &D::measureOnce, &M::multi_echo},
  }};
  line_ = line;
  code_ = line.substr(0, line[0] == '%' || line[0] == '$' ? 3 : 2);
  const auto command =
      std::find_if(kCommands.begin(), kCommands.end(), [&](const Command& c) { return code_ == c.code; });
  if (adjusting_time_ && code_ != "TM") return answer(model_.scip22 ? "10" : "0E", now);
  if (command == kCommands.end()) return answer("0E", now);
  if (command->needs && !(model_.*(command->needs))) return answer(model_.scip22 ? "0F" : "0E", now);
  const std::string arguments = line.substr(code_.size());
  const std::string error = checkForm(*command, arguments);
  if (!error.empty()) return answer(error, now);
  argument_ = arguments.substr(0, command->argument_size);
  (this->*command->run)(now);
}

std::string HokuyoDevice::checkForm(const Command& command, const std::string& arguments) const {
  if (arguments.size() < command.argument_size) return model_.scip22 ? "0H" : "0C";
  const std::string text = arguments.substr(command.argument_size);
  if (model_.scip22 && !text.empty() && text[0] != ';') return "0D";
  if (text.size() > kMaxUserText) return "0G";
  const bool printable = std::all_of(text.begin(), text.end(), [](char c) { return c >= 0x20 && c < 0x7f; });
  if (!printable) return model_.scip22 ? "0D" : "0H";
  return "";
}

void HokuyoDevice::answer(const std::string& status, Nanoseconds now, const std::string& contents) {
  reply(scipReply(line_, status, contents), now);
}

std::string HokuyoDevice::keyLine(const std::string& key, const std::string& value) const {
  return scipKeyLine(key, value, options_.sum_semicolon);
}

void HokuyoDevice::version(Nanoseconds now) {
  answer("00", now,
         keyLine("VEND", "Hokuyo Automatic Co.,Ltd.") + keyLine("PROD", model_.prod) +
             keyLine("FIRM", model_.firm) + keyLine("PROT", model_.prot) + keyLine("SERI", model_.seri));
}

void HokuyoDevice::parameters(Nanoseconds now) {
  std::string lines = keyLine("MODL", model_.modl);
  const std::array<std::pair<const char*, int>, 7> numbers = {{{"DMIN", model_.dmin},
                                                               {"DMAX", model_.dmax},
                                                               {"ARES", model_.ares},
                                                               {"AMIN", model_.amin},
                                                               {"AMAX", model_.amax},
                                                               {"AFRT", model_.afrt},
                                                               {"SCAN", model_.rpm}}};
  for (const auto& [key, value] : numbers) lines += keyLine(key, std::to_string(value));
  if (model_.scip22) lines += keyLine("PROT", model_.prot);
  answer("00", now, lines);
}

void HokuyoDevice::information(Nanoseconds now) {
  char hex[8];
  std::snprintf(hex, sizeof hex, "%06X", counter(now));
  const std::string speed = "Initial(" + std::to_string(model_.rpm) + "[rpm])<-Default setting by user";
  char trouble[40];
  std::snprintf(trouble, sizeof trouble, "Trouble!! Error No. =[00->%02d]", malfunction_);
  const std::string& mesm = stream_ ? model_.mesm_multi : laser_on_ ? model_.mesm_single : model_.mesm_idle;
  answer("00", now,
         keyLine("MODL", model_.modl) + keyLine("LASR", laser_on_ ? "ON" : "OFF") + keyLine("SCSP", speed) +
             keyLine("MESM", mesm) +
             keyLine("SBPS", model_.baud_rates ? std::to_string(bit_rate_) + "[bps]" : model_.sbps) +
             keyLine("TIME", model_.hex_time ? hex : scipEncode(counter(now), 4)) +
             keyLine("STAT", malfunction_ ? trouble : model_.stat));
}

void HokuyoDevice::state(Nanoseconds now) {
  const char* state = malfunction_ ? "900" : asleep_ ? "005" : stream_ ? "004" : laser_on_ ? "003" : "000";
  answer("00", now, scipLine(state));
}

void HokuyoDevice::laser(Nanoseconds now) {
  if (malfunction_) return answer("01", now);
  asleep_ = false;
  answer(laser_on_ ? "02" : "00", now);
  laser_on_ = true;
}

void HokuyoDevice::quit(Nanoseconds now) {
  stop();
  asleep_ = false;
  if (options_.quit_cuts_scan) transmitter_.cutAfterLine(now);
  answer("00", now);
}

void HokuyoDevice::reset(Nanoseconds now) {
  stop();
  asleep_ = sensitive_ = false;
  motor_level_ = 0;
  period_ = 60 * kSecond / model_.rpm;
  motor_epoch_ = now;
  setClock(now, 0);
  answer("00", now);
  const int factory = options_.line.baud_rate;
  if (factory > 0 && bit_rate_ != factory) changeBaudRate(factory, transmitter_.freeAt());
  if (factory > 0) bit_rate_ = factory;
}

void HokuyoDevice::partialReset(Nanoseconds now) {
  sensitive_ = false;
  setClock(now, 0);
  // A scan that began before would have a stamp of neither clock.
  for (auto* measurement : {&stream_, &single_})
    if (*measurement) (*measurement)->turn = std::max((*measurement)->turn, nextTurn(now));
  answer("00", now);
}

void HokuyoDevice::restart(Nanoseconds now) {
  if (restart_asked_ && now - *restart_asked_ <= kRestartDelay) {
    stop();
    restart_at_ = now + kRestartDelay;
    return answer("00", now);
  }
  restart_asked_ = now;
  answer("01", now);
}

void HokuyoDevice::sleep(Nanoseconds now) {
  stop();
  asleep_ = true;
  answer("00", now);
}

void HokuyoDevice::bitRate(Nanoseconds now) {
  if (model_.ethernet) return answer(model_.scip22 ? "0F" : "0E", now);
  if (!isNumber(argument_)) return answer("01", now);
  const int rate = std::stoi(argument_);
  if (std::find(kBitRates.begin(), kBitRates.end(), rate) == kBitRates.end()) return answer("02", now);
  if (rate == bit_rate_) return answer("03", now);
  bit_rate_ = rate;
  answer("00", now);
  if (options_.line.baud_rate > 0) changeBaudRate(rate, transmitter_.freeAt());
}

// Address, netmask and gateway, three digits for each number. They hold from the next start on.
void HokuyoDevice::address(Nanoseconds now) {
  if (!isNumber(argument_)) return answer("01", now);
  for (std::size_t i = 0; i < argument_.size(); i += 3) {
    if (std::stoi(argument_.substr(i, 3)) > 255) return answer("02", now);
  }
  stored_address_ = argument_;
  answer("00", now);
}

void HokuyoDevice::motorSpeed(Nanoseconds now) {
  constexpr int kSlowest = 10, kBackToDefault = 99;  // levels of one per cent
  if (!model_.motor_speed) return answer("04", now);
  if (!isNumber(argument_)) return answer("01", now);
  int level = std::stoi(argument_);
  if (level > kSlowest && level != kBackToDefault) return answer("02", now);
  if (level == kBackToDefault) level = 0;
  if (level == motor_level_) return answer("03", now);
  motor_level_ = level;
  period_ = 60 * kSecond * 100 / (model_.rpm * (100 - level));
  motor_epoch_ = now;
  for (auto* measurement : {&stream_, &single_})
    if (*measurement) (*measurement)->turn = nextTurn(now);
  answer("00", now);
}

void HokuyoDevice::sensitivity(Nanoseconds now) {
  if (!model_.sensitivity) return answer("03", now);
  if (argument_ != "0" && argument_ != "1") return answer("01", now);
  const bool high = argument_ == "1";
  answer(high == sensitive_ ? "02" : "00", now);
  sensitive_ = high;
}

void HokuyoDevice::malfunction(Nanoseconds now) {
  constexpr int kLast = 5, kBackToNormal = 10;
  const int mode = isNumber(argument_) ? std::stoi(argument_) : 0;
  if (mode == kBackToNormal) {
    answer(malfunction_ ? "00" : "03", now);
    malfunction_ = 0;
    return;
  }
  if (mode < 1 || mode > kLast) return answer("01", now);
  if (mode == malfunction_) return answer("02", now);
  stop();
  malfunction_ = mode;
  answer("00", now);
}

void HokuyoDevice::time(Nanoseconds now) {
  switch (argument_[0]) {
    case '0':
      if (adjusting_time_) return answer("02", now);
      if (stream_) return answer("10", now);
      stop();
      adjusting_time_ = true;
      return answer("00", now);
    case '1':
      if (!adjusting_time_ && model_.time_needs_mode) return answer("04", now);
      return answer("00", now, scipLine(scipEncode(counter(now), 4)));
    case '2':
      answer(adjusting_time_ ? "00" : "03", now);
      adjusting_time_ = false;
      return;
    default:
      return answer("01", now);
  }
}

std::string HokuyoDevice::readRequest(HokuyoRequest& request) const {
  request.continuous = code_[0] == 'M' || code_[0] == 'N';
  request.multi_echo = code_[0] == 'H' || code_[0] == 'N';
  request.intensity = code_[1] == 'E';
  request.two_characters = code_[1] == 'S';
  const std::size_t fixed = 2 + (request.continuous ? 11 : 10);
  request.echo = line_.substr(0, fixed);
  request.user_text = line_.substr(2 + argument_.size());

  const auto digits = [&](std::size_t at, std::size_t size) { return argument_.substr(at, size); };
  if (!isNumber(digits(0, 4))) return "01";
  if (!isNumber(digits(4, 4))) return "02";
  if (!isNumber(digits(8, 2))) return "03";
  request.first = std::stoi(digits(0, 4));
  request.last = std::stoi(digits(4, 4));
  request.cluster = std::max(std::stoi(digits(8, 2)), 1);
  if (request.first < model_.amin || request.last > model_.amax) return "04";
  if (request.last < request.first) return "05";
  if (request.continuous) {
    if (!isNumber(digits(10, 1))) return "06";
    if (!isNumber(digits(11, 2))) return "07";
    request.interval = std::stoi(digits(10, 1));
    request.count = std::stoi(digits(11, 2));
  }
  if (malfunction_) return std::to_string(50 + malfunction_);
  if (asleep_) return "10";
  return "";
}

void HokuyoDevice::measureOnce(Nanoseconds now) {
  Measurement measurement;
  const std::string error = readRequest(measurement.request);
  if (!error.empty()) return answer(error, now);
  if (!laser_on_) return answer("10", now);
  if (single_) return answer("0B", now);
  measurement.turn = nextTurn(now);
  single_ = measurement;
}

void HokuyoDevice::measureContinuously(Nanoseconds now) {
  Measurement measurement;
  const std::string error = readRequest(measurement.request);
  if (!error.empty()) return answer(error, now);
  laser_on_ = true;
  measurement.turn = nextTurn(now);
  measurement.left = measurement.request.count;
  stream_ = measurement;
  answer("00", now);
}

}  // namespace device_emulators
