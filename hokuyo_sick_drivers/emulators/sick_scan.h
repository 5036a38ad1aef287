// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "scan_source.h"
#include "transmitter.h"

namespace device_emulators {

/// Sector and resolution of the LMS, command 3Bh.
struct SickVariant {
  int angle = 180;       ///< degrees, symmetric about straight ahead
  int resolution = 100;  ///< 1/100 degree

  int values() const { return angle * 100 / resolution + 1; }
  /// Of the mirror, which sees 1 degree per turn.
  int turns() const { return 100 / resolution; }
};

/// Block of the LMS's EEPROM, commands 74h and 77h.
class SickConfiguration {
 public:
  /// @param size 34, or 32 as in old firmware
  explicit SickConfiguration(std::size_t size = 34);

  const std::string& bytes() const { return bytes_; }
  /// @return false, and nothing is changed, for a block of another size or with values that don't exist
  bool write(const std::string& bytes);

  bool sendsIndex() const { return bytes_[4] & 0x02; }
  unsigned mode() const { return static_cast<unsigned char>(bytes_[5]); }
  bool hasIntensityMode() const { return mode() == 0x0d || mode() == 0x0e; }
  unsigned unitBits() const { return static_cast<unsigned char>(bytes_[6]); }
  double unit() const;  ///< m
  int rangeBits() const;

 private:
  std::string bytes_;
};

/// What may differ between devices and isn't documented.
struct SickCoding {
  bool wide_codes = false;  ///< codes for "no reading" from FFFFh down in modes 0Dh and 0Eh, else from 1FFFh
  unsigned flags = 0;       ///< set in the upper three bits of every range of F5h
  bool index_at_end = false;     ///< of F5h: one real-time index after the last group, else one after each
  double intensity_scale = 1.0;  ///< from the source's intensities to those sent
};

/// Values from `first` to `last`, counted from 1 at the right end, as words. A null scan has no readings.
/// @param offset of the values to the left (degrees)
SentScan measure(const Scan* scan, const SickVariant& variant, const SickConfiguration& configuration,
                 const SickCoding& coding, int first, int last, double offset = 0.0);

struct SickGroup {
  int first = 1, last = 1;
};

/// What the LMS is to send of its scans.
struct SickRequest {
  unsigned mode = 0;              ///< that streams it
  std::vector<SickGroup> groups;  ///< of values; empty: all
  int scans = 1;                  ///< the mean of so many is sent
};

/// The mean of scans of the same size; of values without a reading, the last.
SentScan meanOf(const std::vector<SentScan>& scans, const SickConfiguration& configuration);

/// Ranges alone: B0h; B6h, with the number of scans whose mean they are; B7h, with the first and last index
/// of a part; BFh, with both.
/// @param head what comes before the number of values
/// @param partial -1: a whole scan, else the number of the partial scan
std::string encodeRanges(const std::string& head, const SentScan& scan,
                         const SickConfiguration& configuration, int partial, unsigned char index);
/// F5h. @param wrong_count whether the first count is one too many
std::string encodeIntensities(const std::vector<SentScan>& scans, const SickConfiguration& configuration,
                              const SickCoding& coding, unsigned char index, bool wrong_count);
/// C4h: all ranges, a byte of reflectivity for those of the group.
std::string encodeReflectivities(const SentScan& scan, const SickGroup& group,
                                 const SickConfiguration& configuration, unsigned char index);

}  // namespace device_emulators
