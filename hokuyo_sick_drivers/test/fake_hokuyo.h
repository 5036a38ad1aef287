// SPDX-License-Identifier: BSD-3-Clause
//
// A Hokuyo in virtual time: answers as SCIP 2 says, measures distances by which a test knows the scan, and
// behaves badly where it is told to.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

class FakeHokuyo {
 public:
  static std::string summed(const std::string& line) {
    int total = 0;
    for (const char c : line) total += c;
    return line + static_cast<char>(total % 64 + 48);
  }
  static std::string encoded(std::uint32_t value, int width) {
    std::string text(static_cast<std::size_t>(width), '0');
    for (int i = width; i-- > 0; value /= 64)
      text[static_cast<std::size_t>(i)] = static_cast<char>(value % 64 + 48);
    return text;
  }
  // What scan `number` has at a step.
  static std::uint32_t distance(std::uint64_t number, int step) {
    return static_cast<std::uint32_t>(100 + step + 1100 * (number % 50));
  }
  static bool hasSecondEcho(int step) { return step % 3 == 0; }

  // How it is and behaves.
  bool silent = false, time_mode = false, old_protocol = false, crlf = false;
  std::set<std::string> refused;                // the first two letters of commands, answered 0E
  std::map<std::string, std::string> statuses;  // of commands by their first two letters
  std::string state = "Sensor works well.";     // STAT
  std::string state_while_measuring = "00";     // status of II then; "": no answer
  int stalls_beyond = 1 << 20;  // after 20 scans it goes silent, if of more rays with intensities
  double drift = 0.0;           // host seconds per device second, less one
  double period = 0.025;        // s, of the device
  Nanoseconds jitter = 0;       // at most, each way
  Nanoseconds latency = 2 * kMillisecond;
  std::int64_t clock_start = 1000;                                // ms
  std::function<std::string(std::string, std::uint64_t)> damage;  // of a scan's message
  std::mt19937 random{1};

  std::vector<std::string> commands;            // it got
  std::map<std::uint64_t, Nanoseconds> passed;  // when step 0 of a scan was
  std::uint64_t scans = 0;

  // It was left measuring by somebody else.
  void stream(const std::string& command, Nanoseconds now) {
    streaming_ = command;
    next_scan_ = now;
    streamed_ = 0;
  }
  void say(const std::string& bytes, Nanoseconds now) {
    const Nanoseconds late = jitter > 0 ? std::uniform_int_distribution<Nanoseconds>(0, jitter)(random) : 0;
    const Nanoseconds last = output_.empty() ? 0 : output_.back().first;
    std::string sent;
    for (const char c : bytes) sent += crlf && c == '\n' ? "\r\n" : std::string(1, c);
    output_.emplace_back(std::max(last, now + late), sent);
  }
  void input(const std::string& bytes, Nanoseconds now) {
    for (const char c : bytes) {
      if (c != '\n') {
        line_ += c;
        continue;
      }
      if (!line_.empty()) answer(line_, now);
      line_.clear();
    }
  }
  Nanoseconds next() const {
    return std::min(output_.empty() ? kNever : output_.front().first,
                    streaming_.empty() ? kNever : next_scan_);
  }
  std::string output(Nanoseconds now) {
    while (!streaming_.empty() && next_scan_ <= now) scan();
    std::string bytes;
    while (!output_.empty() && output_.front().first <= now) {
      bytes += output_.front().second;
      output_.pop_front();
    }
    return bytes;
  }

 private:
  double deviceTime(Nanoseconds now) const { return 1e-9 * static_cast<double>(now) / (1.0 + drift); }  // s
  std::string clock(Nanoseconds now) const {
    const auto ms = clock_start + static_cast<std::int64_t>(std::floor(1e3 * deviceTime(now)));
    return summed(encoded(static_cast<std::uint32_t>(ms % (1 << 24)), 4)) + "\n";
  }
  void answer(const std::string& command, Nanoseconds now) {
    commands.push_back(command);
    if (silent) return;
    if (jitter > 0) now += std::uniform_int_distribution<Nanoseconds>(0, jitter)(random);
    const std::string code = command.substr(0, 2);
    std::string status = "00", text;
    if (old_protocol) {
      if (command == "SCIP2.0") old_protocol = false;
      return say(command + "\n" + (old_protocol ? "E" : "0") + "\n\n", now);
    }
    if (statuses.count(code) > 0) {
      status = statuses[code];
    } else if (refused.count(code) > 0 || (time_mode && code != "TM")) {
      status = "0E";
    } else if (code == "QT") {
      streaming_.clear();
    } else if (code == "PP") {
      for (const char* line : {"MODL:Fake;", "DMIN:23;", "DMAX:60000;", "ARES:1440;", "AMIN:0;", "AMAX:1080;",
                               "AFRT:540;", "SCAN:2400;"}) {
        std::string without = line;
        without.pop_back();
        text += line + summed(without).substr(without.size()) + "\n";
      }
    } else if (code == "VV") {
      text = "VEND:Hokuyo Automatic Co.,Ltd.;[\nSERI:12345678;bad\nPROT:SCIP 2.0;N\n";
    } else if (code == "II") {
      if (!streaming_.empty()) status = state_while_measuring;
      if (status.empty()) return;
      const std::string line = "STAT:" + state;
      text = "SCSP:Initial(2400[rpm])<-Default setting by user;1\n" + line + ";" + summed(line).back() + "\n";
    } else if (command == "TM0") {
      status = time_mode ? "02" : "00";
      time_mode = true;
    } else if (command == "TM1") {
      text = clock(now);
    } else if (command == "TM2") {
      status = time_mode ? "00" : "03";
      time_mode = false;
    } else if (code == "RS") {
      clock_start = -static_cast<std::int64_t>(1e3 * deviceTime(now));
    } else if (code[0] == 'M' && command.size() != 15) {
      status = "0C";
    } else if (code == "MD" || code == "ME" || code == "ND" || code == "NE") {
      stream(command, now + 50 * kMillisecond);
    } else {
      status = "0E";
    }
    say(command + "\n" + summed(status) + "\n" + text + "\n", now);
  }
  void scan() {
    const int first = std::stoi(streaming_.substr(2, 4)), last = std::stoi(streaming_.substr(6, 4));
    const int cluster = std::max(1, std::stoi(streaming_.substr(10, 2))), skip = streaming_[12] - '0';
    const bool has_intensities = streaming_[1] == 'E';
    const int rays = (last - first + 1) / cluster;
    std::string data;
    for (int step = first; step + cluster - 1 <= last; step += cluster) {
      const std::uint32_t near = distance(scans, step);
      data += encoded(near, 3) + (has_intensities ? encoded(300 + static_cast<std::uint32_t>(step), 3) : "");
      if (streaming_[0] != 'N' || !hasSecondEcho(step)) continue;
      data += "&" + encoded(near + 500, 3);
      if (has_intensities) data += encoded(900 + static_cast<std::uint32_t>(step), 3);
    }
    std::string message = streaming_ + "\n99b\n" + clock(next_scan_);
    for (std::size_t i = 0; i < data.size(); i += 64) message += summed(data.substr(i, 64)) + "\n";
    message += "\n";
    passed[scans] = next_scan_;
    if (has_intensities && rays > stalls_beyond && ++streamed_ > 20) message.clear();
    const auto turn = static_cast<Nanoseconds>(1e9 * period * (1.0 + drift));
    if (damage) message = damage(message, scans);
    say(message, next_scan_ + turn * 3 / 4 + latency);
    next_scan_ += turn * (skip + 1);
    ++scans;
  }

  std::string line_, streaming_;
  Nanoseconds next_scan_ = 0;
  int streamed_ = 0;  // scans, since the start
  std::deque<std::pair<Nanoseconds, std::string>> output_;
};

}  // namespace hokuyo_sick_drivers
