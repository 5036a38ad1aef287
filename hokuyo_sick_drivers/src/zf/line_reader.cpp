// SPDX-License-Identifier: BSD-3-Clause
#include "line_reader.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 21U;
constexpr std::size_t kLongestLine = std::size_t{1} << 16U;
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

}  // namespace

LineReader::LineReader(ByteSource& source, Position start)
    : source_(source),
      buffer_(std::min<std::uint64_t>(kBlock + kLongestLine,
                                      std::max(source.size(), start.offset) - start.offset + 1)),
      buffer_end_offset_(start.offset),
      line_start_(start.offset),
      line_(start.line),
      next_line_(start.line) {
  if (start.offset > 0 || !refill()) return;
  if (std::string_view(buffer_.data(), end_).substr(0, 3) == kByteOrderMark) begin_ = kByteOrderMark.size();
}

bool LineReader::refill() {
  std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
  end_ -= begin_;
  begin_ = 0;
  const std::size_t got = source_.read(buffer_end_offset_, buffer_.data() + end_, buffer_.size() - end_);
  buffer_end_offset_ += got;
  end_ += got;
  return got > 0;
}

bool LineReader::next(std::string_view& line) {
  while (true) {
    const void* newline = std::memchr(buffer_.data() + begin_, '\n', end_ - begin_);
    if (!newline && end_ - begin_ < kLongestLine && refill()) continue;
    const char* start = buffer_.data() + begin_;
    line_ = next_line_++;
    line_start_ = buffer_end_offset_ - (end_ - begin_);
    const char* stop = newline ? static_cast<const char*>(newline) : buffer_.data() + end_;
    if (static_cast<std::size_t>(stop - start) >= kLongestLine) fail("is too long for a line of points");
    begin_ = static_cast<std::size_t>(stop - buffer_.data()) + (newline ? 1 : 0);
    while (stop != start && (stop[-1] == '\r' || stop[-1] == ' ' || stop[-1] == '\t')) --stop;
    line = std::string_view(start, static_cast<std::size_t>(stop - start));
    if (!line.empty()) return true;
    if (!newline) {
      begin_ = end_;
      --next_line_;
      return false;
    }
  }
}

double LineReader::progress() const {
  const std::uint64_t read = buffer_end_offset_ - (end_ - begin_);
  return source_.size() > 0 ? static_cast<double>(read) / static_cast<double>(source_.size()) : 1.0;
}

void LineReader::fail(const std::string& what) const {
  throw std::runtime_error("line " + std::to_string(line_) + " " + what);
}

}  // namespace hokuyo_sick_drivers
