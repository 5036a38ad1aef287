// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "hokuyo_sick_drivers/zf/byte_source.h"

namespace hokuyo_sick_drivers {

/// The lines of a text of any size, without CR, LF and blanks at their ends. Blank lines are left out, but
/// counted.
class LineReader {
 public:
  /// Where a line starts.
  struct Position {
    std::uint64_t offset = 0, line = 1;
  };

  explicit LineReader(ByteSource& source) : LineReader(source, Position()) {}
  LineReader(ByteSource& source, Position start);

  /// @return false at the end
  /// @throws std::runtime_error for a line of more than 64 KiB: then it is no text
  bool next(std::string_view& line);
  /// Of the line that next() gave last, or of the end.
  Position position() const { return {line_start_, line_}; }
  /// The part of the source that was read, 0 to 1.
  double progress() const;
  /// @throws std::runtime_error with the number of the line that next() gave last
  [[noreturn]] void fail(const std::string& what) const;

 private:
  bool refill();

  ByteSource& source_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // what of the buffer is still to be read
  std::uint64_t buffer_end_offset_;  // in the source
  std::uint64_t line_start_, line_, next_line_;
};

}  // namespace hokuyo_sick_drivers
