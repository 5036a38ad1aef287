// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/archive.h"

#include <boost/crc.hpp>
#include <sstream>

#include "mapping_common/files.h"

namespace mapping_common {
namespace {

constexpr std::size_t kMagicSize = 8, kHeaderSize = kMagicSize + sizeof(std::uint32_t), kBuffer = 1 << 16;

// @param size of the checksum, from `checked` on
bool isWhole(const char* begin, const char* checked, std::size_t size) {
  if (size == sizeof(std::uint32_t)) {
    boost::crc_32_type crc;
    crc.process_bytes(begin, static_cast<std::size_t>(checked - begin));
    const std::uint32_t sum = crc.checksum();
    return std::memcmp(&sum, checked, sizeof(sum)) == 0;
  }
  Checksum checksum;
  checksum.add(begin, static_cast<std::size_t>(checked - begin));
  const std::uint64_t sum = checksum.value();
  return std::memcmp(&sum, checked, sizeof(sum)) == 0;
}

void read(const char* begin, const char* end, const ArchiveFormat& format,
          const std::function<void(ArchiveReader&)>& read) {
  const auto available = static_cast<std::size_t>(end - begin);
  if (available < kMagicSize || std::memcmp(begin, format.magic, kMagicSize) != 0)
    throw std::runtime_error(std::string("it isn't ") + format.what);
  if (available < kHeaderSize) throw std::runtime_error("it is truncated");
  std::uint32_t version = 0;
  std::memcpy(&version, begin + kMagicSize, sizeof(version));
  if (version < format.oldest || version > format.newest) {
    throw std::runtime_error("it has format version " + std::to_string(version) + ", this program reads " +
                             (format.oldest == format.newest ? "" : std::to_string(format.oldest) + " to ") +
                             std::to_string(format.newest));
  }
  const std::size_t size = version <= format.last_with_crc ? sizeof(std::uint32_t) : sizeof(std::uint64_t);
  if (available < kHeaderSize + size) throw std::runtime_error("it is truncated");
  const char* checked = end - size;
  if (!isWhole(begin, checked, size))
    throw std::runtime_error("it is truncated or corrupted: its checksum is wrong");
  ArchiveReader reader(begin + kHeaderSize, checked, version);
  read(reader);
  if (reader.left() > 0) throw std::runtime_error("it holds more than it says");
}

void write(std::ostream& out, const ArchiveFormat& format, const std::function<void(ArchiveWriter&)>& write) {
  ArchiveWriter writer(out);
  writer.bytes(format.magic, kMagicSize);
  writer(format.newest);
  write(writer);
  writer.finish();
}

}  // namespace

void Checksum::add(const char* data, std::size_t size) {
  while (size > 0) {
    if (filled_ == 0 && size >= sizeof(block_)) {
      mix(data);
      data += sizeof(block_), size -= sizeof(block_);
      continue;
    }
    block_[filled_++] = *data++, --size;
    if (filled_ == sizeof(block_)) mix(block_), filled_ = 0;
  }
}

std::uint64_t Checksum::value() const {
  Checksum last = *this;
  const char end[sizeof(block_)] = {1};
  last.add(end, sizeof(block_) - filled_);
  std::uint64_t sum = kOffset;
  for (const std::uint64_t lane : last.lanes_) sum = (sum ^ lane ^ (lane >> 29)) * kPrime;
  return sum ^ (sum >> 32);
}

void Checksum::mix(const char* block) {
  for (int i = 0; i < 4; ++i) {
    std::uint64_t word;
    std::memcpy(&word, block + 8 * i, 8);
    lanes_[i] = (lanes_[i] ^ word) * kPrime;
    lanes_[i] ^= lanes_[i] >> 47;
  }
}

void ArchiveWriter::operator()(const std::string& text) {
  (*this)(static_cast<std::uint32_t>(text.size()));
  bytes(text.data(), text.size());
}

void ArchiveWriter::operator()(const OptionList& options) {
  (*this)(static_cast<std::uint32_t>(options.size()));
  for (const auto& [option, section] : options) {
    (*this)(option.name());
    (*this)(option.word());
  }
}

void ArchiveWriter::bytes(const void* data, std::size_t size) {
  if (buffer_.size() + size > kBuffer) flush();
  if (size <= kBuffer) {
    buffer_.append(static_cast<const char*>(data), size);
  } else {
    checksum_.add(static_cast<const char*>(data), size);
    out_.write(static_cast<const char*>(data), static_cast<std::streamsize>(size));
  }
}

void ArchiveWriter::flush() {
  checksum_.add(buffer_.data(), buffer_.size());
  out_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
  buffer_.clear();
}

void ArchiveWriter::finish() {
  flush();
  (*this)(checksum_.value());
  out_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
}

void ArchiveReader::operator()(bool& value) {
  value = next<std::uint8_t>() != 0;
}

void ArchiveReader::operator()(std::string& text) {
  const auto size = next<std::uint32_t>();
  if (left() < size) throw std::runtime_error("it is truncated");
  text.assign(at_, size);
  at_ += size;
}

std::size_t ArchiveReader::count(std::size_t size) {
  const auto count = next<std::uint64_t>();
  if (count > left() / size)
    throw std::runtime_error("it is inconsistent: it says that it holds more than it does");
  return count;
}

void ArchiveReader::operator()(OptionList options) {
  std::string name, value;
  for (auto count = next<std::uint32_t>(); count > 0; --count) {
    (*this)(name);
    (*this)(value);
    Option* option = options.find(name);
    if (option == nullptr)
      throw std::runtime_error("it has an option " + name + ", which this program doesn't know");
    option->parse(value);
  }
}

void ArchiveReader::copy(void* to, std::size_t count, std::size_t size) {
  if (left() / size < count) throw std::runtime_error("it is truncated");
  if (count > 0) std::memcpy(to, at_, count * size);
  at_ += count * size;
}

void writeArchive(const std::string& path, const ArchiveFormat& format,
                  const std::function<void(ArchiveWriter&)>& write_content) {
  writeFile(path, [&](std::ostream& out) { write(out, format, write_content); });
}

std::string toArchive(const ArchiveFormat& format, const std::function<void(ArchiveWriter&)>& write_content) {
  std::ostringstream out;
  write(out, format, write_content);
  return out.str();
}

void readArchive(const std::string& path, const ArchiveFormat& format,
                 const std::function<void(ArchiveReader&)>& read_content) {
  const std::string bytes = readFile(path);
  readArchive(bytes.data(), bytes.data() + bytes.size(), path, format, read_content);
}

void readArchive(const char* begin, const char* end, const std::string& name, const ArchiveFormat& format,
                 const std::function<void(ArchiveReader&)>& read_content) {
  try {
    read(begin, end, format, read_content);
  } catch (const std::exception& e) {
    throw std::runtime_error(name + " was not loaded: " + e.what());
  }
}

}  // namespace mapping_common
