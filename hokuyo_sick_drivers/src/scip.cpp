// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/scip.h"

#include <algorithm>

namespace hokuyo_sick_drivers::scip {
namespace {

constexpr std::size_t kRowLength = 64;
constexpr std::size_t kLongestLine = 512;
constexpr std::size_t kLongestMessage = 65536;  // 1,440 steps of three echoes with intensities are 27 kB
constexpr std::size_t kTellingEcho = 8;         // so many characters don't end a data row by chance
constexpr char kZero = '0';

bool isPrintable(char c) {
  return c >= ' ' && c <= '~';
}

bool endsWith(std::string_view text, std::string_view end) {
  return text.size() >= end.size() && text.substr(text.size() - end.size()) == end;
}

}  // namespace

char sum(std::string_view line) {
  unsigned total = 0;
  for (const char c : line) total += static_cast<unsigned char>(c);
  return static_cast<char>((total & 0x3f) + kZero);
}

std::optional<std::string_view> checked(std::string_view line) {
  if (line.empty()) return std::nullopt;
  const std::string_view text = line.substr(0, line.size() - 1);
  if (sum(text) != line.back()) return std::nullopt;
  return text;
}

std::optional<std::uint32_t> decode(std::string_view characters) {
  std::uint32_t value = 0;
  for (const char c : characters) {
    const int bits = c - kZero;
    if (bits < 0 || bits > 0x3f) return std::nullopt;
    value = value << 6 | static_cast<std::uint32_t>(bits);
  }
  return value;
}

Rows joinRows(const std::vector<std::string_view>& lines, std::size_t first) {
  Rows rows;
  for (std::size_t i = first; i < lines.size(); ++i) {
    const auto row = checked(lines[i]);
    if (!row) {
      rows.fault = Rows::Fault::kSum;
      return rows;
    }
    const bool is_last = i + 1 == lines.size();
    if (row->empty() || row->size() > kRowLength || (row->size() < kRowLength && !is_last)) {
      rows.fault = Rows::Fault::kLength;
      return rows;
    }
    rows.characters += *row;
  }
  return rows;
}

KeyValues parseKeyValues(const std::vector<std::string_view>& lines, std::size_t first) {
  KeyValues result;
  for (std::size_t i = first; i < lines.size(); ++i) {
    const std::string_view line = lines[i];
    // Before the sum, which may be a semicolon too.
    const std::size_t colon = line.find(':'), semicolon = line.size() - 2;
    if (!std::all_of(line.begin(), line.end(), isPrintable) || line.size() < 2 || line[semicolon] != ';' ||
        colon >= semicolon) {
      ++result.bad_lines;
      continue;
    }
    const std::string_view text = line.substr(0, semicolon);
    const std::string_view without_comment = text.substr(0, text.find("<-"));
    const char expected = line.back();
    if (sum(text) != expected && sum(line.substr(0, semicolon + 1)) != expected &&
        sum(without_comment) != expected) {
      ++result.bad_sums;
    }
    result.values[std::string(text.substr(0, colon))] = text.substr(colon + 1);
  }
  return result;
}

std::string describeStatus(std::string_view status) {
  struct Meaning {
    std::string_view first, last, words;
  };
  static constexpr Meaning kMeanings[] = {
      {"0A", "0A", "internal error"},     {"0B", "0B", "busy or out of memory"},
      {"0I", "0I", "waits for firmware"}, {"0L", "0L", "abnormal state"},
      {"0M", "0M", "unstable"},           {"10", "10", "denied in this state"},
      {"21", "49", "verifies an error"},  {"50", "97", "hardware trouble"}};
  std::string text = "status " + std::string(status);
  for (const Meaning& meaning : kMeanings) {
    if (status >= meaning.first && status <= meaning.last) text += " (" + std::string(meaning.words) + ')';
  }
  return text;
}

std::string_view Message::status() const {
  if (lines.size() < 2) return {};
  if (lines[1].size() == 1) return lines[1];
  const auto text = checked(lines[1]);
  return text && text->size() == 2 ? *text : std::string_view();
}

void MessageReader::clear() {
  text_.clear();
  line_ends_.clear();
  complete_ = false;
}

std::size_t MessageReader::consume(std::string_view bytes, Nanoseconds now) {
  if (complete_) clear();
  std::size_t taken = 0;
  while (taken < bytes.size() && !complete_) {
    const std::size_t end = bytes.find('\n', taken);
    const std::string_view piece = bytes.substr(taken, end == std::string_view::npos ? end : end - taken);
    const std::size_t line_begin = line_ends_.empty() ? 0 : line_ends_.back();
    if (text_.size() == line_begin) line_begun_ = now;
    if (text_.empty()) begun_ = now;
    if (text_.size() - line_begin + piece.size() > kLongestLine ||
        text_.size() + piece.size() > kLongestMessage) {
      ++broken_;
      clear();
    } else {
      text_ += piece;
    }
    taken += piece.size();
    if (end == std::string_view::npos) break;
    ++taken;
    endLine(now);
  }
  return taken;
}

void MessageReader::endLine(Nanoseconds now) {
  const std::size_t begin = line_ends_.empty() ? 0 : line_ends_.back();
  if (text_.size() > begin && text_.back() == '\r') text_.pop_back();  // some end lines with CR LF
  const std::string_view line = std::string_view(text_).substr(begin);
  if (line.empty()) {
    if (line_ends_.empty()) return;  // an empty line too many
    message_.lines.clear();
    std::size_t from = 0;
    for (const std::size_t to : line_ends_) {
      message_.lines.push_back(std::string_view(text_).substr(from, to - from));
      from = to;
    }
    message_.begun = begun_;
    complete_ = true;
    return;
  }
  const bool is_first = line_ends_.empty();
  if (isExpected(line) && (!is_first || line.size() > expected_.size())) {
    ++broken_;
    begun_ = line.size() > expected_.size() ? now : line_begun_;
    text_ = expected_;
    line_ends_.clear();
  }
  line_ends_.push_back(text_.size());
}

bool MessageReader::isExpected(std::string_view line) const {
  return !expected_.empty() &&
         (expected_.size() < kTellingEcho ? line == expected_ : endsWith(line, expected_));
}

}  // namespace hokuyo_sick_drivers::scip
