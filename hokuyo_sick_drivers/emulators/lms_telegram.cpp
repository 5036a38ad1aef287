// SPDX-License-Identifier: BSD-3-Clause
#include "lms_telegram.h"

namespace device_emulators {
namespace {

constexpr char kStx = 0x02, kHostAddress = 0x00;
constexpr unsigned char kDeviceAddress = 0x80;
constexpr std::size_t kHeader = 4, kCrc = 2, kMaxTelegram = 812;

unsigned byteAt(std::string_view bytes, std::size_t position) {
  return static_cast<unsigned char>(bytes[position]);
}

}  // namespace

std::uint16_t lmsCrc(std::string_view bytes) {
  unsigned crc = 0, previous = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const unsigned byte = byteAt(bytes, i);
    const bool carry = crc & 0x8000;
    crc = (crc << 1) & 0xffff;
    if (carry) crc ^= 0x8005;
    crc ^= previous << 8 | byte;
    previous = byte;
  }
  return static_cast<std::uint16_t>(crc);
}

void appendWord(std::string& bytes, unsigned value) {
  bytes += static_cast<char>(value & 0xff);
  bytes += static_cast<char>(value >> 8 & 0xff);
}

unsigned wordAt(const std::string& bytes, std::size_t position) {
  return byteAt(bytes, position) | byteAt(bytes, position + 1) << 8;
}

std::string lmsTelegram(const std::string& payload, unsigned char status) {
  std::string telegram{kStx, static_cast<char>(kDeviceAddress)};
  appendWord(telegram, static_cast<unsigned>(payload.size()) + 1);
  telegram += payload;
  telegram += static_cast<char>(status);
  appendWord(telegram, lmsCrc(telegram));
  return telegram;
}

std::vector<LmsReader::Telegram> LmsReader::read(std::string_view bytes, Nanoseconds now) {
  if (now - last_ > byte_gap_) buffer_.clear();
  last_ = now;
  buffer_ += bytes;
  std::vector<Telegram> telegrams;
  for (;;) {
    const std::size_t stx = buffer_.find(kStx);
    buffer_.erase(0, stx);
    if (buffer_.size() < 2) break;
    if (buffer_[1] != kHostAddress) {
      buffer_.erase(0, 1);
      continue;
    }
    if (buffer_.size() < kHeader) break;
    const std::size_t length = wordAt(buffer_, 2), size = kHeader + length + kCrc;
    if (length == 0 || size > kMaxTelegram) {
      telegrams.push_back({});
      buffer_.erase(0, kHeader);
      continue;
    }
    if (buffer_.size() < size) break;
    const bool good =
        lmsCrc(std::string_view(buffer_).substr(0, kHeader + length)) == wordAt(buffer_, kHeader + length);
    telegrams.push_back({buffer_.substr(kHeader, length), good});
    buffer_.erase(0, size);
  }
  return telegrams;
}

}  // namespace device_emulators
