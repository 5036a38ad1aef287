// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/progress.h"

#include <unistd.h>

#include <iostream>
#include <utility>

namespace mapping_common {
namespace {

constexpr std::chrono::milliseconds kOnTerminal{100}, kInLog{10000};
constexpr char kEmptyLine[] = "\r\033[K";

}  // namespace

Progress::Progress(std::string name) : Progress(std::move(name), std::cerr, isatty(STDERR_FILENO) != 0) {}

Progress::Progress(std::string name, std::ostream& out, bool is_terminal)
    : name_(std::move(name)), out_(out), is_terminal_(is_terminal) {
  if (!is_terminal_) next_ = Clock::now() + kInLog;
}

Progress::~Progress() {
  if (is_open_) out_ << kEmptyLine << std::flush;
}

void Progress::write(const std::string& text) {
  next_ = Clock::now() + (is_terminal_ ? kOnTerminal : kInLog);
  out_ << (is_terminal_ ? kEmptyLine : "") << name_ << ": " << text << (is_terminal_ ? "" : "\n")
       << std::flush;
  is_open_ = is_terminal_;
}

void Progress::stay(const std::string& text) {
  out_ << (is_terminal_ ? kEmptyLine : "") << name_ << ": " << text << std::endl;
  is_open_ = false;
}

}  // namespace mapping_common
