// SPDX-License-Identifier: BSD-3-Clause
//
// The dialogue with the device up to the scans; those are in hokuyo_stream.cpp.
#include "hokuyo_sick_drivers/hokuyo.h"

#include <cctype>
#include <stdexcept>
#include <utility>

namespace hokuyo_sick_drivers {
namespace {

constexpr Nanoseconds kQuietTime = 140 * kMillisecond, kQuietLimit = 400 * kMillisecond;
constexpr Nanoseconds kReplyTimeout = 300 * kMillisecond;
constexpr Nanoseconds kStartTimeout = kSecond;
constexpr int kAttempts = 3;
constexpr int kModeChanges = 3;  // out of the time mode and SCIP 1.1
constexpr int kMinProbes = 10, kMaxHalvings = 4;
constexpr Nanoseconds kProbeWidth = 250'000;  // good enough

}  // namespace

const char* name(HokuyoFault fault) {
  constexpr std::array<const char*, static_cast<std::size_t>(HokuyoFault::kCount)> kNames = {
      "wrong sums",         "wrong lengths", "messages without an end", "foreign messages", "wrong stamps",
      "error states",       "unstable",      "refused modes",           "timeouts",         "lost scans",
      "measuring restarts", "reconnects",    "device clock restarts"};
  return kNames[static_cast<std::size_t>(fault)];
}

std::string differences(const HokuyoFaults& before, const HokuyoFaults& now) {
  std::string text;
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (now[i] == before[i]) continue;
    if (!text.empty()) text += ", ";
    text += std::to_string(now[i] - before[i]) + ' ' + name(static_cast<HokuyoFault>(i));
  }
  return text;
}

std::string Hokuyo::Status::trouble() const {
  const auto found = info.find("STAT");
  if (found == info.end()) return "";
  std::string words = found->second;
  for (char& c : words) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const char* good : {"works well", "working normally", "no error"}) {
    if (words.find(good) != std::string::npos) return "";
  }
  return found->second;
}

Hokuyo::Hokuyo(const Options& options, const HokuyoSettings& settings, Events events)
    : options_(options), events_(std::move(events)), settings_(settings) {
  mapping_common::validate(settings);
}

void Hokuyo::configure(const HokuyoSettings& settings, Nanoseconds now) {
  mapping_common::validate(settings);
  if (geometry_) HokuyoRequest::make(settings, *geometry_);
  if (settings == settings_) return;
  settings_ = settings;
  refuses_intensity_ = refuses_multi_echo_ = false;
  stalls_ = 0;
  warning_.clear();
  if (step_ >= Step::kEnterTime && step_ <= Step::kMeasuring) enter(Step::kStop, now);
}

void Hokuyo::updateStatus(Nanoseconds now) {
  if (step_ != Step::kMeasuring || state_deadline_ != kNever) return;  // else it is asked, or soon will be
  output_.push_back({"II\n", 0, false});
  state_deadline_ = now + scanTimeout();
}

Hokuyo::Status Hokuyo::status() const {
  Status status;
  status.measuring = step_ == Step::kMeasuring && scans_ > 0;
  status.activity = step_ == Step::kOffline     ? "no connection"
                    : step_ == Step::kMeasuring ? "measuring"
                    : step_ == Step::kPause     ? "waiting after an error"
                    : command_.empty()          ? "looking for the device"
                                                : "waiting for the reply to " + command_;
  status.problem = problem_;
  status.warning = warning_;
  status.info = info_;
  status.informed = informed_;
  status.geometry = geometry_;
  status.settings = settings_;
  status.settings.intensity = settings_.intensity && !refuses_intensity_;
  status.settings.multi_echo = settings_.multi_echo && !refuses_multi_echo_;
  status.faults = faults_;
  status.scans = scans_;
  status.clock_drift = clock_.drift();
  status.latency = latency_;
  if (!options_.baud_rates.empty()) status.baud_rate = options_.baud_rates[baud_index_];
  return status;
}

void Hokuyo::connected(Nanoseconds now) {
  if (was_connected_) count(HokuyoFault::kReconnect);
  was_connected_ = true;
  refuses_intensity_ = refuses_multi_echo_ = false;
  warning_.clear();
  geometry_.reset();
  info_.clear();
  output_.clear();
  mode_changes_ = restarts_ = unanswered_probes_ = 0;
  if (!options_.baud_rates.empty()) output_.push_back({"", options_.baud_rates[baud_index_], false});
  enter(Step::kQuiet, now);
}

void Hokuyo::disconnected(Nanoseconds) {
  step_ = Step::kOffline;
  command_.clear();
  output_.clear();
  deadline_ = state_deadline_ = kNever;
}

void Hokuyo::received(std::string_view bytes, Nanoseconds now) {
  if (step_ == Step::kQuiet) {
    deadline_ = std::min(now + kQuietTime, quiet_end_);
    return;
  }
  while (!bytes.empty()) {
    bytes.remove_prefix(reader_.consume(bytes, now));
    // What a device sends that is being stopped may well be cut.
    if (step_ > Step::kStopAgain) count(HokuyoFault::kBroken, reader_.broken() - broken_seen_);
    broken_seen_ = reader_.broken();
    if (!reader_.complete()) continue;
    const scip::Message& message = reader_.message();
    if (state_deadline_ != kNever && message.echo() == "II") {
      stateReplied(message, now);
    } else if (step_ == Step::kMeasuring) {
      measured(message, now);
    } else if (!command_.empty() && (message.echo() == command_ || isOldProtocol(message))) {
      replied(message, now);
    } else if (step_ > Step::kStopAgain && step_ < Step::kShutDown) {
      count(HokuyoFault::kForeign);
    }
  }
}

void Hokuyo::tick(Nanoseconds now) {
  if (now >= state_deadline_) {
    count(HokuyoFault::kTimeout);
    return enter(Step::kStop, now);
  }
  if (now < deadline_) return;
  switch (step_) {
    case Step::kQuiet:
    case Step::kPause:
      return enter(Step::kStop, now);
    case Step::kShutDown:
      return enter(Step::kDone, now);
    case Step::kMeasuring:
      return fellSilent(now);
    case Step::kTime:
      // A late answer would be taken for that to the next question: only QT tells that there is none any
      // more.
      count(HokuyoFault::kTimeout);
      if (++unanswered_probes_ < kAttempts) return enter(Step::kStop, now);
      attempts_ = kAttempts;
      return failed("no reply to TM1", now);
    default:
      count(HokuyoFault::kTimeout);
      return failed("no reply to " + command_, now);
  }
}

Protocol::Output Hokuyo::takeOutput() {
  if (output_.empty()) return {};
  Output output = std::move(output_.front());
  output_.pop_front();
  return output;
}

void Hokuyo::shutDown(Nanoseconds now) {
  if (step_ == Step::kOffline) return enter(Step::kDone, now);
  const bool in_time_mode = step_ >= Step::kEnterTime && step_ <= Step::kLeaveTime;
  if (in_time_mode) output_.push_back({"TM2\n", 0, false});
  enter(Step::kShutDown, now);
}

void Hokuyo::enter(Step step, Nanoseconds now) {
  if (step != step_) attempts_ = 0;
  step_ = step;
  command_.clear();
  deadline_ = state_deadline_ = kNever;
  switch (step) {
    case Step::kQuiet:
      output_.push_back({"\n", 0, false});
      quiet_end_ = now + kQuietLimit;
      deadline_ = now + kQuietTime;
      reader_.clear();
      return;
    case Step::kStop:
    case Step::kStopAgain:
    case Step::kShutDown:
      return send("QT", kReplyTimeout, now);
    case Step::kLeaveTimeMode:
    case Step::kLeaveTime:
      return send("TM2", kReplyTimeout, now);
    case Step::kLeaveOldProtocol:
      return send("SCIP2.0", kReplyTimeout, now);
    case Step::kReset:
      return send("RS", kReplyTimeout, now);
    case Step::kParameters:
      return send("PP", kReplyTimeout, now);
    case Step::kVersion:
      return send("VV", kReplyTimeout, now);
    case Step::kInformation:
      return send("II", kReplyTimeout, now);
    case Step::kEnterTime:
      return send("TM0", kReplyTimeout, now);
    case Step::kTime:
      return send("TM1", kReplyTimeout, now);
    case Step::kStart:
      return send(request_.command(), kStartTimeout, now);
    case Step::kMeasuring:
      command_ = request_.command();
      measuring_since_ = now;
      deadline_ = now + kStartTimeout + scanTimeout();  // the motor may have to start
      return;
    case Step::kOffline:
    case Step::kPause:
    case Step::kDone:
      return;
  }
}

void Hokuyo::send(const std::string& command, Nanoseconds timeout, Nanoseconds now) {
  command_ = command;
  sent_ = now;
  deadline_ = now + timeout;
  output_.push_back({command + "\n", 0, false});
  reader_.expect(command);
}

void Hokuyo::replied(const scip::Message& message, Nanoseconds now) {
  const std::string_view status = isOldProtocol(message) ? message.echo() : message.status();
  if (status.empty()) {
    count(HokuyoFault::kSum);
    return failed("damaged reply to " + command_, now);
  }
  const bool ok = status == "00";
  if (!ok && step_ >= Step::kReset && step_ <= Step::kInformation) count(HokuyoFault::kErrorStatus);
  switch (step_) {
    case Step::kStop:
      if (stopReplied(status, now)) enter(Step::kStopAgain, now);
      return;
    case Step::kStopAgain:
      if (!stopReplied(status, now)) return;
      if (!geometry_) return enter(options_.reset ? Step::kReset : Step::kParameters, now);
      return enter(Step::kInformation, now);
    case Step::kLeaveTimeMode:
    case Step::kLeaveOldProtocol:
      return enter(Step::kStop, now);
    case Step::kReset:
      return enter(Step::kParameters, now);
    case Step::kParameters:
      if (!ok) return failed("the device answers PP with " + scip::describeStatus(status), now);
      try {
        const scip::KeyValues reply = scip::parseKeyValues(message.lines, 2);
        count(HokuyoFault::kSum, static_cast<std::uint64_t>(reply.bad_sums));
        geometry_ = HokuyoGeometry::parse(reply);
        takeInformation(message);
      } catch (const std::runtime_error& e) {
        return failed(e.what(), now);
      }
      return enter(Step::kVersion, now);
    case Step::kVersion:
    case Step::kInformation:
      if (!ok)
        say(Level::kWarning, "The device answers " + command_ + " with " + scip::describeStatus(status));
      if (ok) takeInformation(message);
      if (step_ == Step::kVersion) return enter(Step::kInformation, now);
      return prepareMeasuring(now);
    case Step::kEnterTime:
      if (ok || status == "02") return enter(Step::kTime, now);
      say(Level::kWarning, "The device doesn't tell its time (" + scip::describeStatus(status) +
                               "): stamps come from the times of arrival");
      return enter(Step::kLeaveTime, now);
    case Step::kTime:
      return takeProbe(message, now);
    case Step::kLeaveTime:
      return enter(Step::kStart, now);
    case Step::kStart:
      return startReplied(status, now);
    case Step::kShutDown:
      return enter(Step::kDone, now);
    default:
      return;
  }
}

// SCIP 1.1 knows no QT.
bool Hokuyo::isOldProtocol(const scip::Message& message) const {
  return step_ == Step::kStop && message.lines.size() == 1 && message.echo() == "E";
}

// @return whether the device has stopped; if not, what comes next is under way
bool Hokuyo::stopReplied(std::string_view status, Nanoseconds now) {
  if (status == "00") {
    mode_changes_ = 0;
    return true;
  }
  if (++mode_changes_ <= kModeChanges) {
    if (status == "0E" || status == "10") {
      enter(Step::kLeaveTimeMode, now);
      return false;
    }
    if (status == "E") {
      enter(Step::kLeaveOldProtocol, now);
      return false;
    }
  }
  count(HokuyoFault::kErrorStatus);
  failed("the device answers QT with " + scip::describeStatus(status), now);
  return false;
}

void Hokuyo::takeInformation(const scip::Message& message) {
  const scip::KeyValues reply = scip::parseKeyValues(message.lines, 2);
  if (step_ != Step::kParameters) {
    count(HokuyoFault::kSum, static_cast<std::uint64_t>(reply.bad_sums) + reply.bad_lines);
  }
  for (const auto& [key, value] : reply.values) info_[key] = value;
  if (message.echo() == "II") ++informed_;
}

// To a question while measuring.
void Hokuyo::stateReplied(const scip::Message& message, Nanoseconds now) {
  state_deadline_ = kNever;
  if (message.status() != "00") return enter(Step::kStop, now);
  takeInformation(message);
}

void Hokuyo::takeProbe(const scip::Message& message, Nanoseconds now) {
  const auto digits = message.lines.size() == 3 ? scip::checked(message.lines[2]) : std::nullopt;
  const auto time = digits && digits->size() == 4 ? scip::decode(*digits) : std::nullopt;
  if (!time || message.status() != "00") {
    count(time ? HokuyoFault::kErrorStatus : HokuyoFault::kSum);
    return failed("no time in the reply to TM1", now);
  }
  clock_.addProbe(sent_, counter_.unwrap(*time) * kMillisecond, now);
  attempts_ = 0;
  ++probes_;
  const bool enough = probes_ >= kMinProbes && clock_.probeWidth() < kProbeWidth;
  // Where starts fail again and again, a shorter one may come through.
  const int limit = std::max(kMinProbes, options_.clock_probes >> std::min(futile_starts_ - 1, kMaxHalvings));
  enter(enough || probes_ >= limit ? Step::kLeaveTime : Step::kTime, now);
}

// No reply, or none that is of use.
void Hokuyo::failed(const std::string& why, Nanoseconds now) {
  if (++attempts_ < kAttempts) {
    const int attempts = attempts_;
    reader_.clear();
    enter(step_, now);
    attempts_ = attempts;
    return;
  }
  switch (step_) {
    case Step::kLeaveTimeMode:
    case Step::kLeaveOldProtocol:
      return enter(Step::kStop, now);
    case Step::kReset:
      return enter(Step::kParameters, now);
    case Step::kVersion:
      say(Level::kWarning, "The device doesn't tell its version: " + why);
      return enter(Step::kInformation, now);
    case Step::kInformation:
      say(Level::kWarning, "The device doesn't tell its state: " + why);
      return prepareMeasuring(now);
    case Step::kEnterTime:
    case Step::kTime:
      say(Level::kWarning, "The device doesn't tell its time: " + why);
      clock_.restart(geometry_->period() * (request_.skip + 1), geometry_->timeOf(request_.last));
      return enter(Step::kLeaveTime, now);
    default:
      return giveUp(why, now);
  }
}

// Another baud rate, or the port anew.
void Hokuyo::giveUp(const std::string& why, Nanoseconds now) {
  const bool was_heard = geometry_.has_value();
  if (!was_heard && !options_.baud_rates.empty()) {
    baud_index_ = (baud_index_ + 1) % options_.baud_rates.size();
    if (baud_index_ != 0) {
      output_.push_back({"", options_.baud_rates[baud_index_], false});
      return enter(Step::kQuiet, now);
    }
  }
  problem_ = withDevicesWords(why);
  say(Level::kError, (was_heard ? "Measuring fails again and again, the port is opened anew: "
                                : "No dialogue with the device: ") +
                         problem_);
  output_.push_back({"", 0, true});
  enter(Step::kOffline, now);
}

std::string Hokuyo::withDevicesWords(const std::string& why) const {
  const std::string words = status().trouble();
  return words.empty() ? why : why + "; the device says: " + words;
}

}  // namespace hokuyo_sick_drivers
