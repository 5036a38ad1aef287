// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <iosfwd>
#include <sstream>
#include <string>

namespace mapping_common {

/// How far a tool is that takes long, on stderr: on a terminal a line that is written over and over,
/// elsewhere, as in a log, a line each ten seconds. Its name and a colon are before each line.
class Progress {
 public:
  explicit Progress(std::string name);
  Progress(std::string name, std::ostream& out, bool is_terminal);
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  /// Leaves a terminal's line empty.
  ~Progress();

  /// Shows what is written to a stream one part after the other, if it is time to.
  template <class... Parts>
  void show(const Parts&... parts) {
    if (isTime()) write(joined(parts...));
  }
  /// The same, as a line that stays.
  template <class... Parts>
  void say(const Parts&... parts) {
    stay(joined(parts...));
  }

 private:
  using Clock = std::chrono::steady_clock;
  template <class... Parts>
  static std::string joined(const Parts&... parts) {
    std::ostringstream text;
    (text << ... << parts);
    return text.str();
  }
  bool isTime() const { return Clock::now() >= next_; }
  void write(const std::string& text);
  void stay(const std::string& text);

  std::string name_;
  std::ostream& out_;
  bool is_terminal_, is_open_ = false;
  Clock::time_point next_;
};

}  // namespace mapping_common
