// SPDX-License-Identifier: BSD-3-Clause
#include <map>

#include "sick_device.h"
#include "sick_modes.h"

namespace device_emulators {
namespace {

const std::string kPassword = "SICK_LMS";
const std::string kUnknownCommand = "\x92";
constexpr char kModeChanged = 0x00, kWrongPassword = 0x01, kFault = 0x02;
constexpr char kRefused = 0x00, kAccepted = 0x01;
constexpr std::size_t kMaxGroups = 5, kMaxAskedGroups = 2;
constexpr std::size_t kMaxTelegram = 812;
constexpr int kFewestScans = 2, kMostScans = 250;  // of a mean

unsigned char codeOf(const std::string& command) {
  return static_cast<unsigned char>(command[0]);
}

std::string modeReply(char result) {
  return {'\xa0', result};
}

}  // namespace

std::string SickDevice::execute(const std::string& command) {
  const auto code = codeOf(command);
  if (code == kChangeMode) return changeMode(command);
  if (code == kChangeVariant) return changeVariant(command);
  if (code == kWriteConfiguration) return configure(command);
  if (command.size() == 1) {
    switch (code) {
      case kReset:
        return "\x91";
      case kAskStatus:
        return status();
      case kAskErrors:
        return "\xb2";
      case kAskType:
        return '\xba' + paddedType(options_.model.type);
      case kAskConfiguration:
        return '\xf4' + configuration_.bytes();
    }
  }
  return kUnknownCommand;
}

std::string SickDevice::changeMode(const std::string& command) {
  static const std::map<unsigned, int> kRates = {
      {kBaud38400, 38400}, {kBaud19200, 19200}, {kBaud9600, 9600}, {kBaud500000, 500000}};
  if (command.size() < 2) return kUnknownCommand;
  const unsigned mode = static_cast<unsigned char>(command[1]);
  SickRequest request{mode, {}, 1};
  if (mode == kInstallation) {
    if (command.size() != 2 + kPassword.size()) return kUnknownCommand;
    if (command.substr(2) != kPassword) return modeReply(kWrongPassword);
  } else if (mode == kStreamIntensities) {
    if (!readGroups(command, 2, kMaxGroups, request.groups)) return kUnknownCommand;
  } else if (mode == kStreamReflectivities) {
    if (!options_.model.reflectivities || command.size() != 6) return kUnknownCommand;
    const SickGroup group{static_cast<int>(wordAt(command, 2)), static_cast<int>(wordAt(command, 4))};
    if (!isGroup(group)) return kUnknownCommand;
    request.groups = {group};
  } else if (mode == kStreamMeans || mode == kStreamSubrange || mode == kStreamMeansOfSubrange) {
    if (!readMeans(command, 2, request)) return kUnknownCommand;
  } else if (command.size() != 2) {
    return kUnknownCommand;
  } else if (const auto rate = kRates.find(mode); rate != kRates.end()) {
    asked_baud_rate_ = rate->second;
    return modeReply(kModeChanged);
  } else if (mode != kDiagnosis && mode != kStreamAll && mode != kOnRequest && mode != kStreamPartial) {
    return kUnknownCommand;
  }
  mode_ = mode;
  streamed_ = request;
  return modeReply(kModeChanged);
}

bool SickDevice::isGroup(const SickGroup& group) const {
  return group.first >= 1 && group.first <= group.last && group.last <= variant_.values();
}

bool SickDevice::readGroups(const std::string& command, std::size_t at, std::size_t max_groups,
                            std::vector<SickGroup>& groups) const {
  if (command.size() < at + 2) return false;
  const std::size_t count = wordAt(command, at);
  if (count < 1 || count > max_groups || command.size() != at + 2 + 4 * count) return false;
  constexpr std::size_t kFrame = 4 + 1 + 2 + 1 + 2, kValue = 4;  // bytes
  const std::size_t group_header = configuration_.sendsIndex() ? 7 : 6;
  std::size_t telegram = kFrame;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t start = at + 2 + 4 * i;
    const SickGroup group{static_cast<int>(wordAt(command, start)),
                          static_cast<int>(wordAt(command, start + 2))};
    if (!isGroup(group)) return false;
    telegram += group_header + kValue * static_cast<std::size_t>(group.last - group.first + 1);
    groups.push_back(group);
  }
  return telegram <= kMaxTelegram;
}

// The number of scans, the indices of a part, or both, as the mode has them.
bool SickDevice::readMeans(const std::string& command, std::size_t at, SickRequest& request) const {
  const bool has_scans = request.mode != kStreamSubrange, has_part = request.mode != kStreamMeans;
  if (command.size() != at + (has_scans ? 1 : 0) + (has_part ? 4 : 0)) return false;
  if (has_scans) {
    request.scans = static_cast<unsigned char>(command[at++]);
    if (request.scans < kFewestScans || request.scans > kMostScans) return false;
  }
  if (!has_part) return true;
  request.groups = {{static_cast<int>(wordAt(command, at)), static_cast<int>(wordAt(command, at + 2))}};
  return isGroup(request.groups[0]);
}

bool SickDevice::readMeasuringCommand(const std::string& command) {
  if (mode_ != kOnRequest) return false;
  asked_ = SickRequest();
  switch (codeOf(command)) {
    case kAskScan:
      asked_.mode = kStreamAll;
      return command.size() == 2 && command[1] == 0x01;
    case kAskMeans:
      asked_.mode = kStreamMeans;
      return readMeans(command, 1, asked_);
    case kAskSubrange:
      asked_.mode = kStreamSubrange;
      return readMeans(command, 1, asked_);
    case kAskMeansOfSubrange:
      asked_.mode = kStreamMeansOfSubrange;
      return readMeans(command, 1, asked_);
    case kAskIntensities:
      asked_.mode = kStreamIntensities;
      return readGroups(command, 1, kMaxAskedGroups, asked_.groups);
    case kAskReflectivities: {
      asked_.mode = kStreamReflectivities;
      if (!options_.model.reflectivities || command.size() != 5) return false;
      const SickGroup group{static_cast<int>(wordAt(command, 1)), static_cast<int>(wordAt(command, 3))};
      asked_.groups = {group};
      return isGroup(group);
    }
    default:
      return false;
  }
}

std::string SickDevice::changeVariant(const std::string& command) {
  if (command.size() != 5) return kUnknownCommand;
  const SickVariant asked{static_cast<int>(wordAt(command, 1)), static_cast<int>(wordAt(command, 3))};
  const bool exists =
      (asked.angle == 180 && (asked.resolution == 100 || asked.resolution == 50)) ||
      (asked.angle == 100 && (asked.resolution == 100 || asked.resolution == 50 || asked.resolution == 25));
  const bool accepted = exists && !options_.model.fast && !streams();
  if (accepted) variant_ = asked;
  std::string payload{'\xbb', accepted ? kAccepted : kRefused};
  appendWord(payload, static_cast<unsigned>(variant_.angle));
  appendWord(payload, static_cast<unsigned>(variant_.resolution));
  return payload;
}

std::string SickDevice::configure(const std::string& command) {
  const bool allowed = mode_ == kInstallation;
  if (!allowed && options_.refuse_by_mode) return modeReply(kFault);
  const bool accepted = allowed && configuration_.write(command.substr(1));
  if (accepted) ++configuration_writes_;
  return std::string{'\xf7', accepted ? kAccepted : kRefused} + configuration_.bytes();
}

std::string SickDevice::status() const {
  // Offsets count the reply's code as 0.
  constexpr std::size_t kSize = 153, kVersion = 1, kVersionSize = 7, kModeAt = 8, kMotor = 67,
                        kMeasuring = 102, kAngle = 107, kResolution = 109, kBaud = 116, kUnit = 122;
  static const std::map<int, unsigned> kBaudWords = {
      {9600, 0x8067}, {19200, 0x8033}, {38400, 0x8019}, {500000, 0x8001}};
  constexpr unsigned kTurnsPerMinute = 75 * 60;

  std::string payload(kSize, '\0');
  payload[0] = '\xb1';
  const auto put = [&](std::size_t at, unsigned word) {
    std::string bytes;
    appendWord(bytes, word);
    payload.replace(at, bytes.size(), bytes);
  };
  std::string version = options_.model.type.substr(options_.model.type.rfind(';') + 1);
  version.resize(kVersionSize, ' ');
  payload.replace(kVersion, kVersionSize, version);
  payload[kModeAt] = static_cast<char>(mode_);
  put(kMotor, kTurnsPerMinute);
  payload[kMeasuring] = static_cast<char>(configuration_.mode());
  put(kAngle, static_cast<unsigned>(variant_.angle));
  put(kResolution, static_cast<unsigned>(variant_.resolution));
  const auto baud = kBaudWords.find(baudRate());
  if (baud != kBaudWords.end()) put(kBaud, baud->second);
  payload[kUnit] = static_cast<char>(configuration_.unitBits());
  return payload;
}

}  // namespace device_emulators
