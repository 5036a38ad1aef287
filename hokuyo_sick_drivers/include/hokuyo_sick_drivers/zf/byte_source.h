// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace hokuyo_sick_drivers {

/// Bytes that can be read from anywhere in them, however many there are.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  virtual std::uint64_t size() const = 0;
  /// @return how many bytes there were from `offset` on: `count`, or fewer at the end
  /// @throws std::runtime_error where they can't be read
  virtual std::size_t read(std::uint64_t offset, char* to, std::size_t count) = 0;
};

/// @throws std::runtime_error that names the file
std::shared_ptr<ByteSource> openFile(const std::string& path);
/// @param bytes must outlive the source
std::shared_ptr<ByteSource> openMemory(const char* bytes, std::size_t size);

}  // namespace hokuyo_sick_drivers
