// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/lms2xx.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace hokuyo_sick_drivers {
namespace {

// Nothing more of a telegram comes after a silence of
constexpr Nanoseconds kGap = 100 * kMillisecond;
// The LMS acknowledges within 60 ms. If it hasn't by now, the command was lost.
constexpr Nanoseconds kUnheard = kSecond / 2;
constexpr Nanoseconds kPauseTime = 5 * kSecond;

bool isScan(std::uint8_t code) {
  return code == lms::kRanges || code == lms::kIntensities || code == lms::kReflectivities;
}

}  // namespace

std::vector<std::pair<std::string, std::size_t>> LmsReport::dropped() const {
  std::vector<std::pair<std::string, std::size_t>> counts = {
      {"bad checksum", line.bad_crc}, {"bad length", line.bad_length}, {"cut", line.cut}};
  constexpr std::array<const char*, lms::kNumDefects> kDefects = {"size", "number of values", "unit",
                                                                  "other variant", "real-time index"};
  for (std::size_t i = 0; i < kDefects.size(); ++i) counts.emplace_back(kDefects[i], defects[i]);
  return counts;
}

Lms2xx::Lms2xx(const LmsOptions& options, OnScan on_scan) : options_(options), on_scan_(std::move(on_scan)) {
  options.check();
}

// --------------------------------------------------------------------------------------------------------
// the port

void Lms2xx::connected(Nanoseconds now) {
  rounds_ = 0;
  report_.phase = LmsReport::Phase::kSearching;
  if (!std::exchange(delayed_, true) && options_.connect_delay > 0) {
    wait(Step::kDelay, options_.connect_delay, now);
  } else {
    search(options_.baud_rate, now);
  }
}

void Lms2xx::disconnected(Nanoseconds /*now*/) {
  idle();
  output_.clear();
  parser_.clear();
}

void Lms2xx::received(std::string_view bytes, Nanoseconds now) {
  if (step_ == Step::kIdle || step_ == Step::kDelay) return;
  heard_ += bytes.size();
  last_byte_ = now;
  parser_.add(bytes);
  parse(now);
}

void Lms2xx::tick(Nanoseconds now) {
  if (now >= give_up_) return idle();
  if (now >= endOfTelegram()) flush(now);
  if (now < deadline_) return;
  switch (step_) {
    case Step::kIdle:
      break;
    case Step::kDelay:
    case Step::kPause:
      return search(options_.baud_rate, now);
    case Step::kQuiet:
    case Step::kProbe:
      return probe(now);
    case Step::kAwaitStop:
      return probed(now);
    case Step::kSettle:
      return testRate(now);
    case Step::kStream:
      ++report_.timeouts;
      return fail("scans fail to appear" + droppedSinceGood(), now);
    default:
      return timedOut(now);
  }
}

Nanoseconds Lms2xx::deadline() const {
  if (step_ == Step::kIdle) return kNever;
  return std::min({deadline_, give_up_, endOfTelegram()});
}

Protocol::Output Lms2xx::takeOutput() {
  if (output_.empty()) return {};
  Output first = std::move(output_.front());
  output_.pop_front();
  return first;
}

void Lms2xx::shutDown(Nanoseconds now) {
  stopping_ = true;
  if (report_.baud_rate == 0) return idle();
  report_.phase = LmsReport::Phase::kStopping;
  give_up_ = now + (options_.restore_on_exit ? kRestoreTime : kStopTime);
  stop(Step::kStop, now);
}

void Lms2xx::idle() {
  step_ = Step::kIdle;
  deadline_ = give_up_ = kNever;
  request_.reset();
  report_.phase = LmsReport::Phase::kNoPort;
  report_.baud_rate = 0;
}

// --------------------------------------------------------------------------------------------------------
// bytes

// A telegram that was cut off by an answer ends in silence. In a stream, more is to come.
Nanoseconds Lms2xx::endOfTelegram() const {
  return parser_.pending() > 0 && step_ != Step::kStream ? last_byte_ + kGap : kNever;
}

// What is complete of others inside of it comes out.
void Lms2xx::flush(Nanoseconds now) {
  while (step_ != Step::kIdle && parser_.pending() > 0) {
    parser_.endOfTelegram();
    parse(now);
  }
}

void Lms2xx::parse(Nanoseconds now) {
  lms::Telegram telegram;
  for (auto event = parser_.next(telegram); event != lms::Parser::Event::kNone;
       event = parser_.next(telegram)) {
    if (event == lms::Parser::Event::kTelegram) {
      handle(telegram, now);
    } else if (event == lms::Parser::Event::kNak) {
      ++report_.refused;
      heard_ = 0;
      if (request_) timedOut(now);
    }
  }
  report_.line = parser_.counts();
  // A broken answer needn't be waited for.
  if (request_ && damaged() != damaged_) deadline_ = std::min(deadline_, now + kUnheard);
}

void Lms2xx::handle(const lms::Telegram& telegram, Nanoseconds now) {
  const std::uint8_t code = telegram.code;
  const bool asked_for = request_ ? code == request_->reply : step_ == Step::kProbe && code == lms::kStatus;
  try {
    if (code == lms::kPowerOn) {
      ++report_.power_ons;
      if (stopping_) return idle();
      report_.problem = "the device was switched on";
      search(line_rate_, now);
    } else if (isScan(code)) {
      if (step_ == Step::kStart || step_ == Step::kStream) handleScan(telegram, now);
    } else if (code == lms::kUnknown && request_) {
      ++report_.refused;
      refused(now);
    } else if (asked_for) {
      answered(telegram, now);
    } else if (code == lms::kModeChanged) {
      stop_confirmed_ = true;  // or a late answer to a command that was repeated
      if (step_ == Step::kAwaitStop) probed(now);
    } else {
      ++report_.unexpected;
    }
  } catch (const lms::DecodeError& e) {
    ++report_.defects[static_cast<std::size_t>(e.defect)];
  }
}

void Lms2xx::handleScan(const lms::Telegram& telegram, Nanoseconds now) {
  const auto behind = lms::transferTime(parser_.pending(), line_rate_);
  const lms::Scan scan = decoder_->decode(telegram, now - static_cast<Nanoseconds>(behind * kSecond));
  stream(now);
  ++report_.scans;
  report_.problem.clear();
  report_.lost += scan.lost;
  report_.beyond_top += scan.beyond_top;
  report_.status = scan.status;
  report_.real_time_index = scan.real_time_index;
  if (scan.unit != report_.unit) ++report_.unit_changes;
  good_report_ = report_;
  on_scan_(scan);
}

std::size_t Lms2xx::damaged() const {
  const auto& counts = parser_.counts();
  return counts.bad_crc + counts.bad_length + counts.cut + counts.skipped;
}

std::string Lms2xx::droppedSinceGood() const {
  std::string text;
  const auto before = good_report_.dropped(), now = report_.dropped();
  for (std::size_t i = 0; i < now.size(); ++i) {
    const std::size_t count = now[i].second - before[i].second;
    if (count > 0) text += (text.empty() ? "; dropped: " : ", ") + std::to_string(count) + ' ' + now[i].first;
  }
  return text;
}

// --------------------------------------------------------------------------------------------------------
// commands

void Lms2xx::transmit(const std::string& command) {
  Output output;
  output.bytes = lms::encode(command);
  output_.push_back(output);
}

void Lms2xx::send(const std::string& command) {
  transmit(command);
  heard_ = 0;
  damaged_ = damaged();
}

void Lms2xx::setLineRate(int baud_rate) {
  line_rate_ = baud_rate;
  Output output;
  output.baud_rate = baud_rate;
  output_.push_back(output);
}

void Lms2xx::wait(Step step, Nanoseconds time, Nanoseconds now) {
  step_ = step;
  request_.reset();
  deadline_ = now + time;
}

void Lms2xx::request(Step step, const std::string& command, lms::Code reply, Nanoseconds timeout,
                     Nanoseconds now, int tries) {
  step_ = step;
  request_ = Request{command, reply, timeout, tries - 1, now};
  deadline_ = now + std::min(timeout, kUnheard);
  send(command);
}

// Either the command or its answer was lost, or the device takes its time.
void Lms2xx::timedOut(Nanoseconds now) {
  const bool lost = heard_ == 0 || damaged() != damaged_;
  const Nanoseconds end = request_->sent + request_->timeout;
  if (step_ == Step::kWriteConfiguration && (lost || now >= end)) {
    leaveInstallation(now);  // whether it is written, the device will tell
  } else if (request_->tries > 0 && (lost || now >= end)) {
    ++report_.repeated;
    --request_->tries;
    request_->sent = now;
    deadline_ = now + std::min(request_->timeout, kUnheard);
    send(request_->command);
  } else if (now < end) {
    deadline_ = end;
    damaged_ = damaged();
  } else {
    fail("the device doesn't answer any more", now);
  }
}

// Begins anew.
void Lms2xx::fail(const std::string& problem, Nanoseconds now) {
  if (stopping_) return idle();
  report_.problem = problem;
  search(options_.baud_rate, now);
}

// Begins anew after a while, for it is not the line's fault.
void Lms2xx::refuse(const std::string& problem, Nanoseconds now) {
  if (stopping_) return idle();
  report_.problem = problem;
  report_.phase = LmsReport::Phase::kSearching;
  wait(Step::kPause, kPauseTime, now);
}

}  // namespace hokuyo_sick_drivers
