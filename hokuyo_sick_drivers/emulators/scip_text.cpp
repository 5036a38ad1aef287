// SPDX-License-Identifier: BSD-3-Clause
#include "scip_text.h"

namespace device_emulators {

char scipSum(const std::string& line) {
  unsigned sum = 0;
  for (const char c : line) sum += static_cast<unsigned char>(c);
  return static_cast<char>((sum & 0x3f) + 0x30);
}

std::string scipEncode(std::uint32_t value, int characters) {
  std::string text(characters, '0');
  for (int i = characters; i-- > 0; value >>= 6) text[i] = static_cast<char>((value & 0x3f) + 0x30);
  return text;
}

std::string scipLine(const std::string& line) {
  return line + scipSum(line) + '\n';
}

std::string scipKeyLine(const std::string& key, const std::string& value, bool sum_semicolon) {
  const std::string text = key + ':' + value;
  return text + ';' + scipSum(sum_semicolon ? text + ';' : text) + '\n';
}

std::string scipRows(const std::string& data) {
  constexpr std::size_t kRow = 64;
  std::string rows;
  for (std::size_t i = 0; i < data.size(); i += kRow) rows += scipLine(data.substr(i, kRow));
  return rows;
}

std::string scipReply(const std::string& echo, const std::string& status, const std::string& contents) {
  return echo + '\n' + scipLine(status) + contents + '\n';
}

}  // namespace device_emulators
