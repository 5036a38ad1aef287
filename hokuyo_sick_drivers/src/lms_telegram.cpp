// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/lms_telegram.h"

#include <algorithm>

namespace hokuyo_sick_drivers::lms {
namespace {

constexpr char kStx = 0x02, kAddress = '\x80', kAck = 0x06, kNak = 0x15;
constexpr std::size_t kHeader = 4;  // 02h, address, length

int byteAt(std::string_view bytes, std::size_t i) {
  return static_cast<std::uint8_t>(bytes[i]);
}
int wordAt(std::string_view bytes, std::size_t i) {
  return byteAt(bytes, i) | byteAt(bytes, i + 1) << 8;
}

// Reads an answer's data from the start to the end.
class Reader {
 public:
  explicit Reader(std::string_view data) : data_(data) {}
  std::size_t left() const { return data_.size() - at_; }
  int byte() {
    need(1);
    return byteAt(data_, at_++);
  }
  int word() {
    need(2);
    at_ += 2;
    return wordAt(data_, at_ - 2);
  }
  void need(std::size_t count) const {
    if (left() < count) throw DecodeError(Defect::kSize, "an answer is too short");
  }

 private:
  std::string_view data_;
  std::size_t at_ = 0;
};

Unit decodeUnit(int bits) {
  if (bits > 2) throw DecodeError(Defect::kUnit, "a scan has no known unit");
  return static_cast<Unit>(bits);
}

void readIndex(Reader& reader, Values& values) {
  if (reader.left() > 1)
    throw DecodeError(Defect::kSize, "a scan is longer than the number of its values says");
  if (reader.left() == 1) values.real_time_index = static_cast<std::uint8_t>(reader.byte());
}

// The word before the ranges of B0h and C4h.
Values decodeHead(int head) {
  Values values;
  values.total = values.stop = head & 0x3FF;
  values.unit = decodeUnit(head >> 14);
  if (head & 0x2000) values.partial_scan = head >> 11 & 3;
  return values;
}

void readWords(Reader& reader, int count, std::vector<std::uint16_t>& words) {
  reader.need(2 * static_cast<std::size_t>(count));
  words.resize(count);
  for (auto& w : words) w = static_cast<std::uint16_t>(reader.word());
}

std::vector<Values> readGroups(std::string_view data, bool index_in_each) {
  Reader reader(data);
  const std::size_t count = reader.word();
  if (count < 1 || count > kMaxGroups) {
    throw DecodeError(Defect::kCount, "a scan has an impossible number of groups");
  }
  std::vector<Values> groups(count);
  int total = 0;
  for (Values& group : groups) {
    group.start = reader.word();
    group.stop = reader.word();
    const int head = reader.word(), values = head & 0x3FFF;
    group.unit = decodeUnit(head >> 14);
    if (group.start < 1 || group.stop < group.start || values != group.stop - group.start + 1) {
      throw DecodeError(Defect::kCount, "the number of values of a scan is not that of its indices");
    }
    reader.need(4 * static_cast<std::size_t>(values));
    for (int i = group.start; i <= group.stop; ++i) {
      group.ranges.push_back(static_cast<std::uint16_t>(reader.word()));
      group.intensities.push_back(static_cast<std::uint16_t>(reader.word()));
    }
    if (index_in_each) group.real_time_index = static_cast<std::uint8_t>(reader.byte());
    total += values;
  }
  if (!index_in_each) {
    readIndex(reader, groups.back());
    for (Values& group : groups) group.real_time_index = groups.back().real_time_index;
  } else if (reader.left() > 0) {
    throw DecodeError(Defect::kSize, "a scan is longer than the number of its values says");
  }
  for (Values& group : groups) group.total = total;
  return groups;
}

}  // namespace

std::uint16_t crc(std::string_view bytes) {
  std::uint16_t crc = 0;
  int previous = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const int b = byteAt(bytes, i);
    crc = static_cast<std::uint16_t>((crc << 1) ^ (crc >> 15) * 0x8005 ^ (previous << 8 | b));
    previous = b;
  }
  return crc;
}

std::string word(int value) {
  return {static_cast<char>(value & 0xFF), static_cast<char>(value >> 8 & 0xFF)};
}

std::string encode(std::string_view command) {
  std::string telegram = std::string{kStx, '\0'} + word(static_cast<int>(command.size()));
  telegram += command;
  return telegram + word(crc(telegram));
}

// --------------------------------------------------------------------------------------------------------
// stream

Parser::Event Parser::next(Telegram& telegram) {
  while (pending() > 0) {
    const std::string_view bytes = std::string_view(buffer_).substr(begin_);
    if (in_step_ && (bytes[0] == kAck || bytes[0] == kNak)) {
      const bool ack = bytes[0] == kAck;
      ++begin_;
      return ack ? Event::kAck : Event::kNak;
    }
    if (bytes[0] != kStx || (bytes.size() > 1 && bytes[1] != kAddress)) {
      skipToHeader();
      continue;
    }
    if (bytes.size() < kHeader) break;
    const std::size_t length = wordAt(bytes, 2), size = length + kOverhead;
    if (length < 2 || size > kMaxTelegram + kMaxGroups) {
      ++counts_.bad_length;
      skip(1);
      continue;
    }
    if (bytes.size() < size) break;
    if (crc(bytes.substr(0, size - 2)) != wordAt(bytes, size - 2)) {
      ++counts_.bad_crc;
      skip(1);
      continue;
    }
    telegram.code = static_cast<std::uint8_t>(bytes[kHeader]);
    telegram.data = bytes.substr(kHeader + 1, length - 2);
    telegram.status = static_cast<std::uint8_t>(bytes[size - 3]);
    begin_ += size;
    in_step_ = true;
    return Event::kTelegram;
  }
  buffer_.erase(0, begin_);
  begin_ = 0;
  return Event::kNone;
}

void Parser::skip(std::size_t count) {
  begin_ += count;
  counts_.skipped += count;
  in_step_ = false;
}

void Parser::skipToHeader() {
  std::size_t at = begin_;
  do {
    at = std::min(buffer_.find(kStx, at + 1), buffer_.size());
  } while (at + 1 < buffer_.size() && buffer_[at + 1] != kAddress);
  skip(at - begin_);
}

void Parser::endOfTelegram() {
  if (pending() == 0) return;
  ++counts_.cut;
  skip(1);
}

void Parser::clear() {
  buffer_.clear();
  begin_ = 0;
  in_step_ = true;
}

// --------------------------------------------------------------------------------------------------------
// answers

double toMetres(Unit unit) {
  switch (unit) {
    case Unit::kMillimetre:
      return 0.001;
    case Unit::kDecimetre:
      return 0.1;
    default:
      return 0.01;
  }
}

Values decodeRanges(const Telegram& telegram) {
  Reader reader(telegram.data);
  Values values = decodeHead(reader.word());
  readWords(reader, values.total, values.ranges);
  readIndex(reader, values);
  return values;
}

std::vector<Values> decodeIntensities(const Telegram& telegram) {
  try {
    return readGroups(telegram.data, false);
  } catch (const DecodeError&) {  // the layout is open where there are several groups
    try {
      return readGroups(telegram.data, true);
    } catch (const DecodeError&) {
    }
    throw;
  }
}

Values decodeReflectivities(const Telegram& telegram) {
  Reader reader(telegram.data);
  Values values = decodeHead(reader.word());
  readWords(reader, values.total, values.ranges);
  const int count = reader.word();
  values.start = reader.word();
  values.stop = reader.word();
  if (values.start < 1 || count < 1 || count != values.stop - values.start + 1) {
    throw DecodeError(Defect::kCount, "the number of reflectivities of a scan is not that of their indices");
  }
  reader.need(count);
  for (int i = 0; i < count; ++i) values.intensities.push_back(static_cast<std::uint16_t>(reader.byte()));
  readIndex(reader, values);
  if (values.total > count && values.stop <= values.total) {
    const auto first = values.ranges.begin() + values.start - 1;
    values.ranges = std::vector<std::uint16_t>(first, first + count);
  } else if (values.total != count) {
    throw DecodeError(Defect::kCount, "a scan has more reflectivities than ranges");
  }
  return values;
}

bool Variant::valid() const {
  const bool known_angle = angle == 180 || angle == 100;
  return known_angle && (resolution == 100 || resolution == 50 || resolution == 25);
}

std::string Variant::text() const {
  const char* step = resolution == 100 ? "1" : resolution == 50 ? "0.5" : "0.25";
  return std::to_string(angle) + " degrees by " + step;
}

VariantReply decodeVariant(const Telegram& telegram) {
  Reader reader(telegram.data);
  VariantReply reply;
  reply.accepted = reader.byte() == 1;
  reply.variant.angle = reader.word();
  reply.variant.resolution = reader.word();
  return reply;
}

DeviceStatus decodeStatus(const Telegram& telegram) {
  constexpr std::size_t kVersion = 7, kAngle = 106, kResolution = 108;  // offsets behind the code
  const std::string& data = telegram.data;
  if (data.size() < kResolution + 2) throw DecodeError(Defect::kSize, "an answer is too short");
  DeviceStatus status;
  for (char c : data.substr(0, kVersion)) {
    if (c > ' ' && c <= '~') status.software_version += c;
  }
  status.variant.angle = wordAt(data, kAngle);
  status.variant.resolution = wordAt(data, kResolution);
  return status;
}

std::string decodeType(const Telegram& telegram) {
  std::string type;
  for (char c : telegram.data) {
    if (c >= ' ' && c <= '~') type += c;
  }
  type.erase(type.find_last_not_of(' ') + 1);
  return type;
}

int decodeModeChange(const Telegram& telegram) {
  return Reader(telegram.data).byte();
}

std::string decodeConfiguration(const Telegram& telegram) {
  constexpr std::size_t kOldSize = 32;
  if (telegram.data.size() < kOldSize) throw DecodeError(Defect::kSize, "a configuration is too short");
  return telegram.data;
}

bool decodeConfigured(const Telegram& telegram) {
  return Reader(telegram.data).byte() == 1;
}

}  // namespace hokuyo_sick_drivers::lms
