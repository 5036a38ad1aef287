// SPDX-License-Identifier: BSD-3-Clause
//
// How measuring starts, what becomes of scans, and what is done when they fail to come.
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "hokuyo_sick_drivers/hokuyo.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr int kTimeoutPeriods = 16, kTimeoutPeriodsPerSkip = 2;
constexpr Nanoseconds kErrorPause = kSecond / 2;
constexpr Nanoseconds kFuture = 100 * kMillisecond;  // that a scan may seem to come from
// Old firmware of the UTM-30LX goes silent a while after it has begun to measure intensities over more than
// that, times the cluster (as hokuyo_node knows).
constexpr double kSafeDegrees = 95.0;
constexpr Nanoseconds kStallTime = 30 * kSecond;
constexpr int kStalls = 3;

// Answers to a command that the device doesn't know or can't fulfil.
bool isRefusal(std::string_view status) {
  return status == "0C" || status == "0D" || status == "0E" || status == "0F" || status == "0H" ||
         (status >= "01" && status <= "07");
}

}  // namespace

void Hokuyo::prepareMeasuring(Nanoseconds now) {
  HokuyoSettings settings = settings_;
  settings.intensity = settings.intensity && !refuses_intensity_;
  settings.multi_echo = settings.multi_echo && !refuses_multi_echo_;
  try {
    request_ = HokuyoRequest::make(settings, *geometry_);
  } catch (const std::invalid_argument& e) {
    return startAnew(e.what(), kErrorPause, now);
  }
  scan_ = describeScan(request_, *geometry_);
  counter_.restart();
  clock_.restart(geometry_->period() * (request_.skip + 1),
                 geometry_->timeOf(request_.last));  // no ray leaves before it is measured
  last_stamp_.reset();
  probes_ = bad_scans_ = 0;
  good_faults_ = faults_;
  ++futile_starts_;
  enter(options_.synchronize_clock ? Step::kEnterTime : Step::kStart, now);
}

void Hokuyo::startReplied(std::string_view status, Nanoseconds now) {
  if (status == "00") return enter(Step::kMeasuring, now);
  if (!isRefusal(status)) {
    count(status == "0M" ? HokuyoFault::kUnstable : HokuyoFault::kErrorStatus);
    return startAnew("the device doesn't start measuring, " + scip::describeStatus(status), kErrorPause, now);
  }
  count(HokuyoFault::kRefused);
  const std::string refusal = "The device refuses " + command_ + ", " + scip::describeStatus(status);
  if (request_.multi_echo) {
    refuses_multi_echo_ = true;
    warning_ = refusal + ": measuring without multiple echoes until the next connection";
  } else if (request_.intensity) {
    refuses_intensity_ = true;
    warning_ = refusal + ": measuring without intensities until the next connection";
  } else {
    return startAnew(refusal, kErrorPause, now);
  }
  say(Level::kWarning, warning_);
  request_.multi_echo = request_.multi_echo && !refuses_multi_echo_;
  request_.intensity = request_.intensity && !refuses_intensity_;
  enter(Step::kStart, now);
}

void Hokuyo::measured(const scip::Message& message, Nanoseconds now) {
  if (message.echo() != command_) {
    count(HokuyoFault::kForeign);
    return badScan(now);
  }
  const std::string_view status = message.status();
  if (status == "99") {
    if (!takeScan(message)) return badScan(now);
    bad_scans_ = restarts_ = futile_starts_ = unanswered_probes_ = 0;
    good_faults_ = faults_;
    problem_.clear();
    ++scans_;
    deadline_ = now + scanTimeout();
    events_.scan(scan_);
  } else if (status.empty()) {
    count(HokuyoFault::kSum);
    badScan(now);
  } else if (status == "0M") {
    count(HokuyoFault::kUnstable);
    deadline_ = now + scanTimeout();
  } else if (status != "00" && status != "98") {  // 00 may come twice, after a repeated command
    count(HokuyoFault::kErrorStatus);
    startAnew("the device reports " + scip::describeStatus(status), kErrorPause, now);
  }
}

void Hokuyo::badScan(Nanoseconds now) {
  if (++bad_scans_ < options_.error_limit) return;
  startAnew(std::to_string(bad_scans_) + " bad scans in a row: " + differences(good_faults_, faults_), 0,
            now);
}

void Hokuyo::fellSilent(Nanoseconds now) {
  count(HokuyoFault::kTimeout);
  const double degrees = 180.0 / M_PI * geometry_->angleIncrement() * (request_.last - request_.first);
  const bool is_wide = request_.intensity && degrees > request_.cluster * kSafeDegrees;
  stalls_ = is_wide && now - measuring_since_ < kStallTime ? stalls_ + 1 : 0;
  if (stalls_ >= kStalls) {
    refuses_intensity_ = true;
    const auto rounded = [](double value) { return std::to_string(std::lround(value)); };
    warning_ =
        "Measuring without intensities until the next connection: with those over " + rounded(degrees) +
        " degrees the device goes silent again and again, as old firmware of the UTM-30LX does. Set cluster "
        "to " +
        rounded(std::ceil(degrees / kSafeDegrees)) + ", or angle_min and angle_max at most " +
        rounded(kSafeDegrees) + " degrees apart, or publish_intensity to false";
    say(Level::kError, warning_);
  }
  startAnew("no scan for " + std::to_string(scanTimeout() / kMillisecond) + " ms", 0, now);
}

bool Hokuyo::takeScan(const scip::Message& message) {
  if (message.lines.size() < 4) {
    count(HokuyoFault::kLength);
    return false;
  }
  const scip::Rows rows = scip::joinRows(message.lines, 3);
  if (rows.fault != scip::Rows::Fault::kNone) {
    count(rows.fault == scip::Rows::Fault::kSum ? HokuyoFault::kSum : HokuyoFault::kLength);
    return false;
  }
  if (!decodeScan(rows.characters, request_, *geometry_, scan_)) {
    count(HokuyoFault::kLength);
    return false;
  }
  return takeStamp(message.lines[2], message.begun, scan_);
}

// The device stamps the moment at which step 0 is passed.
bool Hokuyo::takeStamp(std::string_view line, Nanoseconds arrival, HokuyoScan& scan) {
  const auto digits = scip::checked(line);
  const auto value = digits && digits->size() == 4 ? scip::decode(*digits) : std::nullopt;
  if (!value) {
    count(HokuyoFault::kSum);
    return false;
  }
  CounterUnwrapper counter = counter_;
  const Nanoseconds stamp = counter.unwrap(*value) * kMillisecond;
  const bool is_past = last_stamp_ && stamp <= *last_stamp_;
  if (is_past || (clock_.known() && clock_.estimate(stamp) > arrival + kFuture)) {
    count(HokuyoFault::kStamp);
    if (bad_scans_ + 1 >= options_.error_limit) count(HokuyoFault::kClockRestart);
    return false;
  }
  counter_ = counter;
  if (last_stamp_) {
    const Nanoseconds interval = geometry_->period() * (request_.skip + 1);
    const Nanoseconds intervals = (stamp - *last_stamp_ + interval / 2) / interval;
    if (intervals > 1) count(HokuyoFault::kLostScan, static_cast<std::uint64_t>(intervals - 1));
  }
  last_stamp_ = stamp;
  scan.stamp = clock_.addScan(stamp, arrival) + geometry_->timeOf(request_.step(0));
  latency_ = arrival - scan.stamp;
  return true;
}

// Stops and starts the measuring; where that didn't help the last times, the port is opened anew.
void Hokuyo::startAnew(const std::string& why, Nanoseconds pause, Nanoseconds now) {
  count(HokuyoFault::kRestart);
  if (++restarts_ > options_.error_limit) return giveUp(why, now);
  problem_ = withDevicesWords(why);
  say(Level::kWarning, "Measuring starts anew: " + problem_);
  if (pause == 0) return enter(Step::kStop, now);
  enter(Step::kPause, now);
  deadline_ = now + pause;
}

Nanoseconds Hokuyo::scanTimeout() const {
  return geometry_->period() * (kTimeoutPeriods + (kTimeoutPeriodsPerSkip + 1) * request_.skip);
}

void Hokuyo::count(HokuyoFault fault, std::uint64_t number) {
  faults_[static_cast<std::size_t>(fault)] += number;
}

}  // namespace hokuyo_sick_drivers
