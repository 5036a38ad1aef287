// SPDX-License-Identifier: BSD-3-Clause
//
// SCIP 2, the protocol of Hokuyo's scanners: lines of ASCII, each reply ended by an empty one, sums of six
// bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers::scip {

/// The sum character of a line.
char sum(std::string_view line);

/// The line without the sum at its end.
/// @return nothing where the sum is wrong or the line is empty
std::optional<std::string_view> checked(std::string_view line);

/// A number of up to 5 characters with 6 bits each, the highest first.
/// @return nothing where a character isn't of the code
std::optional<std::uint32_t> decode(std::string_view characters);

/// Characters of a reply's data, rows of 64 and one with the rest, each with its sum.
struct Rows {
  enum class Fault { kNone, kSum, kLength };
  std::string characters;
  Fault fault = Fault::kNone;
};
Rows joinRows(const std::vector<std::string_view>& lines, std::size_t first);

/// The KEY:value;S lines of VV, PP and II. A sum may be that of the line with or without the semicolon, and
/// of a value with or without the comment from `<-` on: devices differ.
struct KeyValues {
  std::map<std::string, std::string> values;
  int bad_sums = 0;  ///< among the lines that were taken anyway
  int bad_lines = 0;
};
KeyValues parseKeyValues(const std::vector<std::string_view>& lines, std::size_t first);

/// A status with its meaning where that isn't about the command, e.g. "status 0L (abnormal state)".
std::string describeStatus(std::string_view status);

/// One reply: echo, status, what else there is.
struct Message {
  std::vector<std::string_view> lines;
  Nanoseconds begun = 0;  ///< when the first byte came

  std::string_view echo() const { return lines.empty() ? std::string_view() : lines[0]; }
  /// Without its sum; empty where that is wrong. A lone character (SCIP 1.1) is as it is.
  std::string_view status() const;
};

/// Cuts a stream of bytes into messages. Whatever comes, it goes on with the next empty line, or with the
/// next echo of the command at work.
class MessageReader {
 public:
  /// The command whose echo is known to begin a message.
  void expect(const std::string& echo) { expected_ = echo; }
  void clear();
  /// Takes bytes up to the end of a message, or all.
  /// @return how many it took
  std::size_t consume(std::string_view bytes, Nanoseconds now);
  /// Whether the bytes taken last ended a message.
  bool complete() const { return complete_; }
  /// Valid until the next consume().
  const Message& message() const { return message_; }
  /// Messages that were cut off by the echo of the next, or that never ended.
  std::uint64_t broken() const { return broken_; }

 private:
  void endLine(Nanoseconds now);
  bool isExpected(std::string_view line) const;

  std::string expected_;
  std::string text_;                    // of the message so far, without LF
  std::vector<std::size_t> line_ends_;  // in the text
  Nanoseconds begun_ = 0, line_begun_ = 0;
  bool complete_ = false;
  std::uint64_t broken_ = 0;
  Message message_;
};

}  // namespace hokuyo_sick_drivers::scip
