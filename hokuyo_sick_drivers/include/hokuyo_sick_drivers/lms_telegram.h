// SPDX-License-Identifier: BSD-3-Clause
//
// Telegrams of SICK LMS 2xx laser scanners: frames, checksum, and what is in the answers. All numbers are
// little-endian. Sources: SICK's telegram listing (8 007 954) as the drivers of CARMEN, Player, sicktoolbox
// and MIT's DARPA Urban Challenge team follow it.
#pragma once

#include <mapping_common/options.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace hokuyo_sick_drivers::lms {

/// First byte of what follows the header. The answer to a command has the code command + 80h.
enum Code : std::uint8_t {
  kPowerOn = 0x90,         ///< unasked, after a start
  kUnknown = 0x92,         ///< an unknown or impossible command
  kModeChanged = 0xA0,     ///< to 20h
  kRanges = 0xB0,          ///< to 30h, or streamed
  kStatus = 0xB1,          ///< to 31h
  kType = 0xBA,            ///< to 3Ah
  kVariant = 0xBB,         ///< to 3Bh
  kReflectivities = 0xC4,  ///< to 44h, or streamed: a byte per value
  kConfiguration = 0xF4,   ///< to 74h
  kIntensities = 0xF5,     ///< to 75h, or streamed: a word per value
  kConfigured = 0xF7       ///< to 77h
};

/// What an answer takes besides command, data and status: header, length and checksum.
constexpr std::size_t kOverhead = 6;
/// The LMS limits a telegram to 812 bytes; real-time indices may come on top.
constexpr std::size_t kMaxTelegram = 812, kMaxGroups = 5;

/// Checksum over a telegram from its first byte (02h) to the last data byte.
std::uint16_t crc(std::string_view bytes);
/// The whole telegram that carries a command with its data to the LMS.
std::string encode(std::string_view command);
/// Low byte, high byte.
std::string word(int value);

/// An answer, or what is streamed.
struct Telegram {
  std::uint8_t code = 0;
  std::string data;         ///< without code and status
  std::uint8_t status = 0;  ///< always the last byte before the checksum

  /// Number of bytes on the line.
  std::size_t size() const { return kOverhead + 2 + data.size(); }
};

/// Rates of the line in baud, and the operating modes (20h) that set them.
constexpr std::array<std::pair<int, char>, 4> kBaudRates = {
    {{9600, 0x42}, {19200, 0x41}, {38400, 0x40}, {500000, 0x48}}};

/// Bits of the status byte.
struct Status {
  explicit Status(std::uint8_t byte) : severity(byte & 7), implausible(byte & 0x40), pollution(byte & 0x80) {}
  int severity;  ///< 0 none, 1 info, 2 warning, 3 error, 4 fatal error
  bool implausible, pollution;
};

/// Cuts the stream from an LMS into telegrams, whatever else is in it. A telegram that is broken or was cut
/// off by the answer to a command hides no other: the search for the next header goes on at its second byte.
class Parser {
 public:
  enum class Event { kNone, kTelegram, kAck, kNak };
  struct Counts {
    std::size_t bad_crc = 0, bad_length = 0, cut = 0;  ///< telegrams
    std::size_t skipped = 0;                           ///< bytes
  };

  void add(std::string_view bytes) { buffer_.append(bytes); }
  /// @param telegram set on kTelegram
  Event next(Telegram& telegram);
  /// No more is to come of what was begun.
  void endOfTelegram();
  void clear();
  /// Bytes behind what was returned last.
  std::size_t pending() const { return buffer_.size() - begin_; }
  const Counts& counts() const { return counts_; }

 private:
  void skip(std::size_t count);
  void skipToHeader();

  std::string buffer_;
  std::size_t begin_ = 0;
  bool in_step_ = true;  // between telegrams, where alone 06h and 15h mean anything
  Counts counts_;
};

/// Why an answer is not what it should be.
enum class Defect { kSize, kCount, kUnit, kOtherVariant, kIndex };
constexpr std::size_t kNumDefects = 5;

struct DecodeError : std::runtime_error {
  DecodeError(Defect d, const std::string& what) : std::runtime_error(what), defect(d) {}
  Defect defect;
};

enum class Unit : std::uint8_t { kCentimetre = 0, kMillimetre = 1, kDecimetre = 2 };
/// Those that a device can be set to.
constexpr auto choicesOf(Unit) {
  return mapping_common::choices<Unit>(
      {{"cm", Unit::kCentimetre, "up to 81 m"}, {"mm", Unit::kMillimetre, "up to 8 m"}});
}
/// m
double toMetres(Unit unit);

/// Neighbouring values of one scan, words as they were sent.
struct Values {
  Unit unit = Unit::kCentimetre;
  std::optional<int> partial_scan;  ///< quarters of a degree by which its angles are shifted
  int total = 0;                    ///< values of the telegram, of all groups
  int start = 1, stop = 0;          ///< indices of the first and the last value, the first of the scan is 1
  std::vector<std::uint16_t> ranges;
  std::vector<std::uint16_t> intensities;       ///< one for each range, or none
  std::optional<std::uint8_t> real_time_index;  ///< turns of the mirror
};

/// B0h. @throws DecodeError
Values decodeRanges(const Telegram& telegram);
/// F5h, one for each group. Real-time indices may be missing, come once, or after each group.
/// @throws DecodeError
std::vector<Values> decodeIntensities(const Telegram& telegram);
/// C4h. The ranges are those of the reflectivities, if the telegram has more of them. @throws DecodeError
Values decodeReflectivities(const Telegram& telegram);

struct Variant {
  int angle = 180;       ///< degrees: 180 or 100
  int resolution = 100;  ///< hundredths of a degree: 100, 50 or 25

  /// Whether the LMS knows it, interlaced or not.
  bool valid() const;
  std::string text() const;
  int values() const { return angle * 100 / resolution + 1; }
  bool operator==(const Variant& other) const {
    return angle == other.angle && resolution == other.resolution;
  }
  bool operator!=(const Variant& other) const { return !(*this == other); }
};

/// BBh
struct VariantReply {
  bool accepted = false;
  Variant variant;
};
/// @throws DecodeError
VariantReply decodeVariant(const Telegram& telegram);

/// B1h, what of it drivers agree on. Firmware differs; each field may be nonsense.
struct DeviceStatus {
  std::string software_version;
  Variant variant;
};
/// @throws DecodeError
DeviceStatus decodeStatus(const Telegram& telegram);

/// BAh, e.g. "LMS291;S05;V02.30"
std::string decodeType(const Telegram& telegram);

/// A0h: 0 changed, 1 wrong password, 2 fault in the device. @throws DecodeError
int decodeModeChange(const Telegram& telegram);

/// Offsets in the block that F4h reads and 77h writes. The device keeps it in its EEPROM.
enum ConfigurationByte { kSensitivity = 3, kAvailability = 4, kMeasuringMode = 5, kUnit = 6 };
/// Bits of the byte kAvailability.
constexpr int kHighestAvailability = 1, kSendRealTimeIndex = 2, kIgnoreDazzling = 4;

/// F4h: 34 bytes, 32 from older firmware. @throws DecodeError
std::string decodeConfiguration(const Telegram& telegram);
/// F7h. @return whether it was accepted. @throws DecodeError
bool decodeConfigured(const Telegram& telegram);

}  // namespace hokuyo_sick_drivers::lms
