// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "e57_pages.h"

namespace hokuyo_sick_drivers {

/// A field of an E57 scan's points, as the prototype describes it.
struct E57Field {
  enum class Type { kFloat, kDouble, kInteger, kScaledInteger, kString };

  std::string name;
  Type type = Type::kInteger;
  std::int64_t minimum = std::numeric_limits<std::int64_t>::min();  ///< integers: of the raw value
  std::int64_t maximum = std::numeric_limits<std::int64_t>::max();
  double scale = 1.0, offset = 0.0;    ///< ScaledInteger: value = raw * scale + offset
  bool bounded = false;                ///< whether the file tells minimum and maximum
  double lowest = 0.0, highest = 0.0;  ///< those, as values, if bounded

  /// Of a record; a string's least.
  unsigned bits() const;
};

/// Where a scan's packets are, in logical offsets.
struct E57Section {
  std::uint64_t first_packet = 0, end = 0;
  std::size_t fields = 0;  ///< streams in each packet
};

/// @param physical_offset of the section's header, from the attribute fileOffset
E57Section readSection(E57Pages& pages, std::uint64_t physical_offset, std::size_t fields);

/// The values of one field. Each field is a stream of its own that is cut to packets without regard to
/// records or to other fields, so each is followed through the packets on its own.
class E57Stream {
 public:
  E57Stream(E57Pages& pages, const E57Section& section, const E57Field& field, std::size_t index);

  /// @throws std::runtime_error where there are fewer left
  void read(double* values, std::size_t count);

 private:
  void fill(std::size_t bytes);
  bool nextPacket();

  E57Pages& pages_;
  E57Section section_;
  E57Field field_;
  std::size_t index_;
  std::uint64_t packet_;                      // the next one
  std::uint64_t slice_ = 0, slice_left_ = 0;  // our part of this one
  std::vector<char> header_;
  std::vector<unsigned char> buffer_;
  std::size_t begin_ = 0, end_ = 0;  // of what is still to be decoded
  unsigned bit_ = 0;                 // of the first byte, where the next value begins
  std::uint64_t done_ = 0;
};

}  // namespace hokuyo_sick_drivers
