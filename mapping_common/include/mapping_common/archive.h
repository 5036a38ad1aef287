// SPDX-License-Identifier: BSD-3-Clause
//
// Binary files: magic (8 bytes), version (uint32), content, checksum, all little endian. The checksum is one
// of 64 bits over all before it; up to a version that the format tells it is a CRC-32.
#pragma once

#include <mapping_common/options.h>

#include <cstdint>
#include <cstring>
#include <functional>
#include <ostream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "archives are written as values are in memory");

namespace mapping_common {

struct ArchiveFormat {
  const char* magic;                     ///< 8 characters
  const char* what;                      ///< that such a file is, e.g. "an R-tree occupancy map"
  std::uint32_t oldest = 1, newest = 1;  ///< versions that are read; the newest is written
  std::uint32_t last_with_crc = 0;       ///< version; later ones have the checksum of 64 bits
};

/// FNV-1a over words of 8 bytes in four lanes: a gigabyte takes a quarter of a second. What is added at once
/// doesn't matter.
class Checksum {
 public:
  void add(const char* data, std::size_t size);
  std::uint64_t value() const;

 private:
  void mix(const char* block);
  std::uint64_t lanes_[4] = {kOffset, kOffset + 1, kOffset + 2, kOffset + 3};
  char block_[32] = {};
  std::size_t filled_ = 0;

  static constexpr std::uint64_t kOffset = 14695981039346656037u, kPrime = 1099511628211u;
};

/// Whether a value can be written and read as the bytes it lies in. The points of OpenCV 4.5.1 are not
/// trivially copyable, by copy constructors that do just that.
template <class T>
inline constexpr bool kIsItsBytes = std::is_trivially_copyable_v<T> ||
                                    (std::is_standard_layout_v<T> && std::is_trivially_destructible_v<T>);

/// Writes an archive's content: numbers and plain structs as they are in memory, strings with their length
/// (uint32) and vectors with their count (uint64) before them.
class ArchiveWriter {
 public:
  explicit ArchiveWriter(std::ostream& out) : out_(out) {}
  ArchiveWriter(const ArchiveWriter&) = delete;
  ArchiveWriter& operator=(const ArchiveWriter&) = delete;

  template <class T>
  void operator()(const T& value) {
    static_assert(kIsItsBytes<T>);
    bytes(&value, sizeof(T));
  }
  void operator()(const std::string& text);
  template <class T>
  void operator()(const std::vector<T>& values) {
    static_assert(kIsItsBytes<T>);
    (*this)(static_cast<std::uint64_t>(values.size()));
    bytes(values.data(), values.size() * sizeof(T));
  }
  /// By their names, as text.
  void operator()(const OptionList& options);
  void bytes(const void* data, std::size_t size);
  /// Writes the checksum of all before it. Nothing may follow.
  void finish();

 private:
  void flush();
  std::ostream& out_;
  std::string buffer_;
  Checksum checksum_;
};

/// Reads what ArchiveWriter wrote. All throw std::runtime_error that says what is wrong with the file, e.g.
/// "it is truncated".
class ArchiveReader {
 public:
  ArchiveReader(const char* begin, const char* end, std::uint32_t version)
      : at_(begin), end_(end), version_(version) {}

  std::uint32_t version() const { return version_; }
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }

  template <class T>
  void operator()(T& value) {
    static_assert(kIsItsBytes<T>);
    copy(&value, 1, sizeof(T));
  }
  void operator()(bool& value);
  void operator()(std::string& text);
  template <class T>
  void operator()(std::vector<T>& values) {
    static_assert(kIsItsBytes<T>);
    values.resize(count(sizeof(T)));
    copy(values.data(), values.size(), sizeof(T));
  }
  template <class T>
  T next() {
    T value{};
    (*this)(value);
    return value;
  }
  /// A number (uint64) of things of at least that many bytes each.
  std::size_t count(std::size_t size);
  /// Options that the file doesn't have keep their values: they are newer than it. One that isn't in the list
  /// is an error, as what it does isn't known.
  void operator()(OptionList options);

 private:
  void copy(void* to, std::size_t count, std::size_t size);
  const char *at_, *end_;
  std::uint32_t version_;
};

/// Writes a file that is whole or isn't there, see writeFile.
/// @throws std::runtime_error that names the file
void writeArchive(const std::string& path, const ArchiveFormat& format,
                  const std::function<void(ArchiveWriter&)>& write);
/// What is in such a file.
std::string toArchive(const ArchiveFormat& format, const std::function<void(ArchiveWriter&)>& write);

/// @param read has to read all
/// @throws std::runtime_error that names the file and says what is wrong with it: not there, foreign, of
/// another
///   version, truncated, corrupted, or what `read` throws
void readArchive(const std::string& path, const ArchiveFormat& format,
                 const std::function<void(ArchiveReader&)>& read);
/// The same from memory.
/// @param begin, end of what is in such a file
/// @param name in messages, instead of a file's
void readArchive(const char* begin, const char* end, const std::string& name, const ArchiveFormat& format,
                 const std::function<void(ArchiveReader&)>& read);

}  // namespace mapping_common
