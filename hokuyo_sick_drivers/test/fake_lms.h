// SPDX-License-Identifier: BSD-3-Clause
//
// An LMS 2xx of a few lines, a line to it, and Lms2xx at the other end, all in virtual time.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/lms2xx.h"

namespace hokuyo_sick_drivers {

inline std::string bytesOf(const std::string& hex) {
  std::string bytes;
  for (std::size_t i = 0; i < hex.size(); i += 3)
    bytes += static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16));
  return bytes;
}

/// A telegram from the LMS.
inline std::string answer(const std::string& code_and_data, int status = 0x10) {
  std::string telegram = "\x02\x80" + lms::word(static_cast<int>(code_and_data.size()) + 1) + code_and_data;
  telegram += static_cast<char>(status);
  return telegram + lms::word(lms::crc(telegram));
}

const std::string kFactoryConfiguration = bytesOf(
    "00 00 46 00 00 00 00 00 00 02 02 00 00 00 0A 0A 50 64 00 0A 0A 50 64 00 0A 0A 50 64 00 00 00 00 02 00");

/// What a test may set at any time; what the device did stays to be looked at.
struct FakeLms {
  int rate = 9600;
  int angle = 180, resolution = 100;
  std::string type = "LMS291;S05;V02.30   ";
  std::string configuration = kFactoryConfiguration;
  Nanoseconds acknowledge_time = 10 * kMillisecond, mode_time = 30 * kMillisecond, write_time = kSecond / 2;
  bool refuses_write = false, refuses_installation = false, off = false, mute = false;
  char start_result = 0;  ///< of commands to stream
  std::string stream;     ///< the command that started it, empty: on request
  double turn = 1.0 / 75.0;

  std::vector<std::string> commands;
  int writes = 0;
  bool installing = false;
  int next_rate = 0;

  int mode() const { return configuration[5]; }
  bool hasIndex() const { return (configuration[4] & 2) != 0; }
  int turns() const { return stream == "\x2A" || angle == 90 ? 1 : 100 / resolution; }
  int values() const { return angle == 90 ? 181 : angle * 100 / resolution + 1; }
  /// Of the scan that began with this turn of the mirror.
  static int range(std::int64_t turn, int index) { return 100 + index + static_cast<int>(turn % 1000); }
  static int intensity(std::int64_t turn, int index) { return 5 * index + static_cast<int>(turn % 100); }

  std::string scan(std::int64_t turn_number) const {
    std::string data;
    const int unit = configuration[6] << 14;
    if (stream[0] == '\x2B' || stream[0] == '\x50') {
      const auto w = [&](std::size_t at) {
        return static_cast<std::uint8_t>(stream[at]) | stream[at + 1] << 8;
      };
      const bool words = stream[0] == '\x2B';
      const int start = w(words ? 3 : 1), stop = w(words ? 5 : 3), count = stop - start + 1;
      if (words) {
        data = "\xF5" + lms::word(1) + lms::word(start) + lms::word(stop) + lms::word(count | unit);
        for (int i = start; i <= stop; ++i) {
          data += lms::word(range(turn_number, i)) + lms::word(intensity(turn_number, i));
        }
      } else {
        data = "\xC4" + lms::word(values() | unit);
        for (int i = 1; i <= values(); ++i) data += lms::word(range(turn_number, i));
        data += lms::word(count) + lms::word(start) + lms::word(stop);
        for (int i = start; i <= stop; ++i) data += static_cast<char>(i);
      }
    } else {
      int count = values(), head = unit;
      if (stream == "\x2A") {
        const int step = 4 * resolution / 100,
                  partial = static_cast<int>(turn_number % (100 / resolution)) * step;
        count = partial == 0 ? 181 : 180;
        head |= 0x2000 | partial << 11;
      }
      data = "\xB0" + lms::word(head | count);
      for (int i = 1; i <= count; ++i) data += lms::word(range(turn_number, i));
    }
    if (hasIndex()) data += static_cast<char>(turn_number % 256);
    return answer(data);
  }

  std::string status() const {
    std::string data(152, '\0');
    data.replace(0, 7, "X02.30 ");
    data.replace(106, 4, lms::word(angle) + lms::word(resolution));
    return answer("\xB1" + data);
  }

  /// @return answers and when they are sent, after the acknowledgement
  std::pair<std::string, Nanoseconds> execute(const std::string& command) {
    commands.push_back(command);
    const std::string data = command.substr(1);
    const auto mode_changed = [](char result) { return answer(std::string{'\xA0', result}); };
    switch (command[0]) {
      case '\x20': {
        stream.clear();
        installing = false;
        const std::map<char, int> rates = {{0x42, 9600}, {0x41, 19200}, {0x40, 38400}, {0x48, 500000}};
        if (data[0] == 0) {
          if (refuses_installation) return {mode_changed(2), mode_time};
          installing = data.substr(1) == "SICK_LMS";
          return {mode_changed(installing ? 0 : 1), mode_time};
        }
        if (rates.count(data[0]) > 0) {
          next_rate = rates.at(data[0]);
        } else if (data[0] != '\x25') {
          if (start_result != 0) return {mode_changed(start_result), mode_time};
          stream = data;
        }
        return {mode_changed(0), mode_time};
      }
      case '\x31':
        return {status(), 5 * kMillisecond};
      case '\x3A':
        return {answer("\xBA" + type), 5 * kMillisecond};
      case '\x3B':
        angle = static_cast<std::uint8_t>(data[0]);
        resolution = static_cast<std::uint8_t>(data[2]);
        return {answer("\xBB\x01" + data), 50 * kMillisecond};
      case '\x74':
        return {answer("\xF4" + configuration), 5 * kMillisecond};
      case '\x77':
        if (!installing || refuses_write || data.size() != configuration.size()) {
          return {answer(std::string("\xF7\x00", 2) + configuration), 5 * kMillisecond};
        }
        configuration = data;
        ++writes;
        return {answer("\xF7\x01" + configuration), write_time};
      default:
        return {answer("\x92"), 5 * kMillisecond};
    }
  }
};

/// The line between both.
class Bench {
 public:
  explicit Bench(const LmsOptions& options)
      : lms(options, [this](const lms::Scan& scan) {
          scans.push_back(scan);
          scan_times.push_back(now);
        }) {}

  FakeLms device;
  std::vector<lms::Scan> scans;
  std::vector<Nanoseconds> scan_times;
  std::vector<Nanoseconds> true_starts;  ///< of all scans that were sent
  Lms2xx lms;
  Nanoseconds now = 1000 * kSecond;
  int host_rate = 9600, reconnects = 0;
  /// What the line does to bytes on their way to the host.
  std::function<std::string(const std::string&)> mangle = [](const std::string& bytes) { return bytes; };
  std::function<Nanoseconds()> jitter = [] { return Nanoseconds{0}; };

  void connect() { lms.connected(now); }
  void run(double seconds) {
    const Nanoseconds end = now + std::llround(seconds * 1e9);
    for (transmit(); true; transmit()) {
      const Nanoseconds next =
          std::min({lms.deadline(), events_.empty() ? kNever : events_.begin()->first, end});
      now = std::max(now, next);
      if (now >= end) return;
      if (!events_.empty() && events_.begin()->first <= now) {
        const auto event = events_.begin()->second;
        events_.erase(events_.begin());
        event();
      } else {
        lms.tick(now);
      }
    }
  }
  /// @return seconds it took, or a negative number
  double runUntil(const std::function<bool()>& condition, double seconds) {
    const Nanoseconds start = now;
    while (!condition()) {
      if (now - start > seconds * 1e9) return -1.0;
      run(0.005);
    }
    return (now - start) * 1e-9;
  }
  bool runUntilScans(std::size_t count, double seconds) {
    const std::size_t before = scans.size();
    return runUntil([&] { return scans.size() >= before + count; }, seconds) >= 0.0;
  }
  void powerOff() {
    device.off = true;
    device.stream.clear();
    device.installing = false;
    events_.clear();
  }
  void powerOn() {
    device.off = false;
    device.rate = 9600;
    device.stream.clear();
    toHost(answer("\x90LMS291"));
  }
  /// Starts the stream that another program left on.
  void leaveStreaming(const std::string& stream) {
    device.stream = stream;
    startStream();
  }
  void toHost(const std::string& bytes) {
    if (device.off || device.mute || device.rate != host_rate) return;
    const std::string arrived = mangle(bytes);
    if (!arrived.empty()) lms.received(arrived, now);
  }

 private:
  void at(Nanoseconds time, std::function<void()> event) {
    events_.emplace(std::max(time, now), std::move(event));
  }
  Nanoseconds transfer(std::size_t bytes) const { return std::llround(bytes * 1e10 / device.rate); }

  void transmit() {
    for (auto output = lms.takeOutput(); !output.empty(); output = lms.takeOutput()) {
      if (!output.bytes.empty() && host_rate == device.rate && !device.off) toDevice(output.bytes);
      if (output.baud_rate != 0) host_rate = output.baud_rate;
      if (output.reconnect) {
        ++reconnects;
        lms.disconnected(now);
        lms.connected(now);
      }
    }
  }
  void toDevice(const std::string& bytes) {
    ++stream_number_;  // the stream is cut off
    if (sending_until_ > now) {
      toHost(
          telegram_.substr(0, telegram_.size() * (now - sending_since_) / (sending_until_ - sending_since_)));
      sending_until_ = now;
    }
    const auto [reply, delay] = device.execute(bytes.substr(4, bytes.size() - 6));
    // Replies come one after the other.
    reply_time_ = std::max(now, reply_time_) + device.acknowledge_time;
    at(reply_time_, [this] { toHost("\x06"); });
    reply_time_ += delay + transfer(reply.size());
    at(reply_time_, [this, r = reply] {
      toHost(r);
      if (device.next_rate != 0) device.rate = std::exchange(device.next_rate, 0);
    });
    if (!device.stream.empty()) startStream();
  }
  void startStream() {
    const int number = ++stream_number_;
    const auto turn = static_cast<std::int64_t>(std::ceil(std::max(now, reply_time_) * 1e-9 / device.turn));
    measure(number, turn);
  }
  // What is measured while the line is busy is lost.
  void measure(int number, std::int64_t turn) {
    const double first = turn * device.turn;
    const double last = first + (device.turns() - 1 + std::min(device.angle, 180) / 360.0) * device.turn;
    at(std::llround(last * 1e9), [this, number, turn, first] {
      if (number != stream_number_ || device.off || device.stream.empty()) return;
      if (now >= sending_until_) {
        telegram_ = device.scan(turn);
        sending_since_ = now;
        sending_until_ = now + transfer(telegram_.size());
        at(sending_until_ + jitter(), [this, number, t = telegram_, first] {
          if (number != stream_number_) return;
          true_starts.push_back(std::llround(first * 1e9));
          toHost(t);
        });
      }
      measure(number, turn + device.turns());
    });
  }

  std::multimap<Nanoseconds, std::function<void()>> events_;
  Nanoseconds reply_time_ = 0, sending_since_ = 0, sending_until_ = 0;
  std::string telegram_;
  int stream_number_ = 0;
};

}  // namespace hokuyo_sick_drivers
