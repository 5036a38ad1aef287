// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

namespace mapping_common {

/// Bytes as they are, or compressed by zstd where they get shorter, as numbers of 4 bytes do once the first
/// bytes of all come first, then the second ones.
std::string compress(const std::string& bytes);
/// @throws std::runtime_error where it isn't what `compress` made of as many bytes
std::string decompress(const std::string& stored, std::size_t size);

}  // namespace mapping_common
