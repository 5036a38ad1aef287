// SPDX-License-Identifier: BSD-3-Clause
#include "sick_scan.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "lms_telegram.h"

namespace device_emulators {
namespace {

constexpr unsigned kReflectivityMode = 0x3f;
// Distances of the codes from the largest value that a range can have.
constexpr unsigned kNotValid = 0, kDazzled = 1, kTooFar = 8, kLargestRange = 9;

unsigned rangeWord(float range, double unit, unsigned max) {
  if (std::isnan(range)) return max - kNotValid;
  if (range < 0.0f) return max - kDazzled;
  const double value = std::round(static_cast<double>(range) / unit);
  return value > max - kLargestRange ? max - kTooFar : static_cast<unsigned>(value);
}

unsigned intensityWord(float intensity, double scale) {
  const double value = intensity * scale;
  return value > 0.0 ? static_cast<unsigned>(std::lround(std::min(value, 65535.0))) : 0;
}

unsigned countWord(std::size_t count, const SickConfiguration& configuration) {
  return static_cast<unsigned>(count) | configuration.unitBits() << 14;
}

}  // namespace

SickConfiguration::SickConfiguration(std::size_t size)
    // Highest availability, 8/80 m, cm; contours and the rest as devices come.
    : bytes_(
          "\x00\x00\x00\x00\x01\x00\x00\x00\x00\x02\x02\x00\x00\x00\x0a\x0a\x50\x64\x00\x0a\x0a\x50\x64\x00"
          "\x0a\x0a\x50\x64\x00\x00\x00\x00\x02\x00",
          34) {
  if (size != 32 && size != 34) throw std::runtime_error("the configuration has 32 or 34 bytes");
  bytes_.resize(size);
}

bool SickConfiguration::write(const std::string& bytes) {
  constexpr unsigned char kModes[] = {0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0d, 0x0e, 0x0f, 0x3f};
  if (bytes.size() != bytes_.size()) return false;
  const auto mode = static_cast<unsigned char>(bytes[5]), unit = static_cast<unsigned char>(bytes[6]);
  if (std::find(std::begin(kModes), std::end(kModes), mode) == std::end(kModes) || unit > 2) return false;
  bytes_ = bytes;
  return true;
}

double SickConfiguration::unit() const {
  constexpr double kUnits[] = {0.01, 0.001, 0.1};
  return kUnits[unitBits()];
}

int SickConfiguration::rangeBits() const {
  switch (mode()) {
    case 0x03:
    case 0x04:
      return 14;
    case 0x05:
    case 0x06:
      return 15;
    case 0x0f:
    case kReflectivityMode:
      return 16;
    default:
      return 13;
  }
}

SentScan measure(const Scan* scan, const SickVariant& variant, const SickConfiguration& configuration,
                 const SickCoding& coding, int first, int last, double offset) {
  SentScan sent;
  sent.first_step = first;
  sent.resolution = configuration.unit();
  const bool wide = coding.wide_codes && configuration.hasIntensityMode();
  const unsigned max = (1u << (wide ? 16 : configuration.rangeBits())) - 1;
  for (int index = first; index <= last; ++index) {
    const double degrees = -variant.angle / 2.0 + offset + (index - 1) * variant.resolution / 100.0;
    const int beam = scan ? beamAt(*scan, degrees * M_PI / 180.0) : -1;
    const bool has_intensity = beam >= 0 && !scan->intensities.empty();
    const unsigned intensity =
        has_intensity ? intensityWord(scan->intensities[0][beam], coding.intensity_scale) : 0;
    const unsigned range =
        beam < 0 ? max - kNotValid : rangeWord(scan->ranges[0][beam], configuration.unit(), max);
    sent.ranges.push_back(configuration.mode() == kReflectivityMode ? intensity : range);
    sent.intensities.push_back(intensity);
  }
  return sent;
}

SentScan meanOf(const std::vector<SentScan>& scans, const SickConfiguration& configuration) {
  const unsigned largest = (1u << configuration.rangeBits()) - 1 - kLargestRange;
  SentScan mean = scans.back();
  mean.start = scans.front().start;
  for (std::size_t i = 0; i < mean.ranges.size(); ++i) {
    double sum = 0.0;
    int count = 0;
    for (const SentScan& scan : scans) {
      if (scan.ranges[i] > largest) continue;
      sum += scan.ranges[i];
      ++count;
    }
    if (count > 0) mean.ranges[i] = static_cast<unsigned>(std::lround(sum / count));
  }
  return mean;
}

std::string encodeRanges(const std::string& head, const SentScan& scan,
                         const SickConfiguration& configuration, int partial, unsigned char index) {
  std::string payload = head;
  const unsigned partial_bits = partial < 0 ? 0 : 0x2000u | static_cast<unsigned>(partial) << 11;
  appendWord(payload, countWord(scan.ranges.size(), configuration) | partial_bits);
  for (const unsigned range : scan.ranges) appendWord(payload, range);
  if (configuration.sendsIndex()) payload += static_cast<char>(index);
  return payload;
}

std::string encodeIntensities(const std::vector<SentScan>& scans, const SickConfiguration& configuration,
                              const SickCoding& coding, unsigned char index, bool wrong_count) {
  std::string payload = "\xf5";
  appendWord(payload, static_cast<unsigned>(scans.size()));
  for (const SentScan& scan : scans) {
    const std::size_t count = scan.ranges.size();
    appendWord(payload, static_cast<unsigned>(scan.first_step));
    appendWord(payload, static_cast<unsigned>(scan.first_step + count - 1));
    appendWord(payload, countWord(count + (wrong_count ? 1 : 0), configuration));
    wrong_count = false;
    for (std::size_t i = 0; i < count; ++i) {
      appendWord(payload, scan.ranges[i] | coding.flags << 13);
      appendWord(payload, scan.intensities[i]);
    }
    if (configuration.sendsIndex() && !coding.index_at_end) payload += static_cast<char>(index);
  }
  if (configuration.sendsIndex() && coding.index_at_end) payload += static_cast<char>(index);
  return payload;
}

std::string encodeReflectivities(const SentScan& scan, const SickGroup& group,
                                 const SickConfiguration& configuration, unsigned char index) {
  std::string payload = "\xc4";
  appendWord(payload, countWord(scan.ranges.size(), configuration));
  for (const unsigned range : scan.ranges) appendWord(payload, range);
  appendWord(payload, static_cast<unsigned>(group.last - group.first + 1));
  appendWord(payload, static_cast<unsigned>(group.first));
  appendWord(payload, static_cast<unsigned>(group.last));
  for (int i = group.first; i <= group.last; ++i)
    payload += static_cast<char>(std::min(scan.intensities[i - 1], 255u));
  if (configuration.sendsIndex()) payload += static_cast<char>(index);
  return payload;
}

}  // namespace device_emulators
