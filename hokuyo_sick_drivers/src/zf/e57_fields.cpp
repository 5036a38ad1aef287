// SPDX-License-Identifier: BSD-3-Clause
#include "e57_fields.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kSectionHeader = 32, kPacketHeader = 6, kPaddingPacket = 8;
constexpr std::size_t kSpare = 9;  // so that nine bytes can be loaded for every value
constexpr std::size_t kBuffer = std::size_t{1} << 16U;
enum PacketType : unsigned char { kIndex = 0, kData = 1, kEmpty = 2 };

template <class T>
T littleEndian(const void* bytes) {
  T value = 0;
  for (std::size_t i = sizeof(T); i-- > 0;) {
    value =
        static_cast<T>(static_cast<std::uint64_t>(value) << 8U | static_cast<const unsigned char*>(bytes)[i]);
  }
  return value;
}

template <class T>
T load(const unsigned char* bytes) {  // of a little-endian machine
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

}  // namespace

unsigned E57Field::bits() const {
  switch (type) {
    case Type::kFloat:
      return 32;
    case Type::kDouble:
      return 64;
    case Type::kString:
      return 8;
    default:
      break;
  }
  std::uint64_t range = static_cast<std::uint64_t>(maximum) - static_cast<std::uint64_t>(minimum);
  unsigned bits = 0;
  for (; range > 0; range >>= 1U) ++bits;
  return bits;
}

E57Section readSection(E57Pages& pages, std::uint64_t physical_offset, std::size_t fields) {
  unsigned char header[kSectionHeader];
  const std::uint64_t start = pages.toLogical(physical_offset);
  pages.read(start, header, sizeof header);
  if (header[0] != 1) {
    throw std::runtime_error("has no points at byte " + std::to_string(physical_offset) +
                             ", where its XML part says");
  }
  const auto length = littleEndian<std::uint64_t>(header + 8);
  if (length > pages.size() - start) {
    throw std::runtime_error("has points that go on beyond its end: it is truncated or damaged");
  }
  E57Section section;
  section.fields = fields;
  section.end = start + length;
  section.first_packet = pages.toLogical(littleEndian<std::uint64_t>(header + 16));
  if (section.first_packet < start + kSectionHeader || section.first_packet > section.end) {
    throw std::runtime_error("has points that start outside of their section");
  }
  return section;
}

E57Stream::E57Stream(E57Pages& pages, const E57Section& section, const E57Field& field, std::size_t index)
    : pages_(pages),
      section_(section),
      field_(field),
      index_(index),
      packet_(section.first_packet),
      buffer_(kBuffer + kSpare) {}

bool E57Stream::nextPacket() {
  while (section_.end - packet_ >= 4) {
    unsigned char start[kPacketHeader] = {};
    pages_.read(packet_, start, 4);
    const std::uint64_t packet = packet_;
    const std::size_t length = std::size_t{littleEndian<std::uint16_t>(start + 2)} + 1;
    const auto fail = [&](const std::string& what) {
      throw std::runtime_error("has a packet of points that " + what + " (at logical byte " +
                               std::to_string(packet) + ')');
    };
    if (length % 4 != 0 || length > section_.end - packet) fail("has a wrong length");
    packet_ += length;
    if (start[0] == kIndex || start[0] == kEmpty) continue;
    if (start[0] != kData) fail("is of an unknown kind");
    if (length < kPacketHeader + 2) fail("is too short");
    pages_.read(packet, start, sizeof start);
    const std::size_t streams = littleEndian<std::uint16_t>(start + 4);
    if (streams != section_.fields) {
      if (length == kPaddingPacket) continue;
      fail("has " + std::to_string(streams) + " streams instead of " + std::to_string(section_.fields));
    }
    header_.resize(2 * streams);
    if (kPacketHeader + header_.size() > length) fail("is too short");
    pages_.read(packet + kPacketHeader, header_.data(), header_.size());
    std::uint64_t at = kPacketHeader + header_.size();
    for (std::size_t i = 0; i < index_; ++i) at += littleEndian<std::uint16_t>(header_.data() + 2 * i);
    slice_left_ = littleEndian<std::uint16_t>(header_.data() + 2 * index_);
    if (at + slice_left_ > length) fail("is shorter than its streams");
    slice_ = packet + at;
    if (slice_left_ > 0) return true;
  }
  return false;
}

void E57Stream::fill(std::size_t bytes) {
  if (end_ - begin_ >= bytes) return;
  std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
  end_ -= begin_;
  begin_ = 0;
  while (end_ < bytes) {
    if (slice_left_ == 0 && !nextPacket()) {
      throw std::runtime_error("ends in the field " + field_.name + " after " + std::to_string(done_) +
                               " points");
    }
    const std::size_t part = std::min<std::uint64_t>(slice_left_, kBuffer - end_);
    pages_.read(slice_, buffer_.data() + end_, part);
    slice_ += part;
    slice_left_ -= part;
    end_ += part;
  }
}

void E57Stream::read(double* values, std::size_t count) {
  const unsigned bits = field_.bits();
  if (bits == 0) {
    std::fill_n(values, count, static_cast<double>(field_.minimum) * field_.scale + field_.offset);
    return;
  }
  const std::uint64_t mask = bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
  const std::size_t most = 8 * (kBuffer / 2) / bits;
  while (count > 0) {
    const std::size_t part = std::min(count, most);
    fill((bit_ + part * bits + 7) / 8);
    const unsigned char* bytes = buffer_.data() + begin_;
    if (field_.type == E57Field::Type::kFloat) {
      for (std::size_t i = 0; i < part; ++i) values[i] = static_cast<double>(load<float>(bytes + 4 * i));
    } else if (field_.type == E57Field::Type::kDouble) {
      for (std::size_t i = 0; i < part; ++i) values[i] = load<double>(bytes + 8 * i);
    } else {
      std::size_t at = bit_;
      for (std::size_t i = 0; i < part; ++i, at += bits) {
        const unsigned shift = at % 8;
        std::uint64_t raw = load<std::uint64_t>(bytes + at / 8) >> shift;
        if (bits + shift > 64) raw |= static_cast<std::uint64_t>(bytes[at / 8 + 8]) << (64 - shift);
        const std::uint64_t value = static_cast<std::uint64_t>(field_.minimum) + (raw & mask);
        values[i] = static_cast<double>(static_cast<std::int64_t>(value)) * field_.scale + field_.offset;
      }
    }
    const std::size_t end = bit_ + part * bits;
    begin_ += end / 8;
    bit_ = end % 8;
    done_ += part;
    values += part;
    count -= part;
  }
}

}  // namespace hokuyo_sick_drivers
