// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/hokuyo_scan.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kDigits = 3;  // of a distance or an intensity
constexpr int kMaxEchoes = 3;
constexpr int kMaxStep = 9999;          // four digits
constexpr int kCodesUpToReach = 20000;  // mm; devices of longer reach tell by codes why there is no distance
constexpr double kTolerance = 1e-6;     // steps

int number(const scip::KeyValues& reply, const std::string& key, int min, int max) {
  const auto found = reply.values.find(key);
  if (found == reply.values.end()) throw std::runtime_error("the device's parameters lack " + key);
  const std::string& text = found->second;
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < min || value > max) {
    throw std::runtime_error("the device's parameter " + key + " is '" + text + "', possible is " +
                             std::to_string(min) + " to " + std::to_string(max));
  }
  return value;
}

}  // namespace

HokuyoGeometry HokuyoGeometry::parse(const scip::KeyValues& reply) {
  if (reply.bad_sums > 0 || reply.bad_lines > 0)
    throw std::runtime_error("the device's parameters came damaged");
  HokuyoGeometry geometry;
  geometry.min_distance = number(reply, "DMIN", 0, 1 << 18);
  geometry.max_distance = number(reply, "DMAX", geometry.min_distance + 1, 1 << 18);
  geometry.resolution = number(reply, "ARES", 1, kMaxStep);
  geometry.first_step = number(reply, "AMIN", 0, kMaxStep);
  geometry.last_step = number(reply, "AMAX", geometry.first_step,
                              std::min(kMaxStep, geometry.first_step + geometry.resolution));
  geometry.front_step = number(reply, "AFRT", 0, kMaxStep);
  geometry.speed = number(reply, "SCAN", 1, 100000);
  return geometry;
}

double HokuyoGeometry::angleIncrement() const {
  return 2.0 * M_PI / resolution;
}

double HokuyoGeometry::angle(double step) const {
  return (step - front_step) * angleIncrement();
}

Nanoseconds HokuyoGeometry::period() const {
  return 60 * kSecond / speed;
}

HokuyoRequest HokuyoRequest::make(const HokuyoSettings& settings, const HokuyoGeometry& geometry) {
  const auto toStep = [&](double angle) { return angle / geometry.angleIncrement() + geometry.front_step; };
  const auto limit = [&](double step) {
    return std::clamp(step, geometry.first_step - 1.0, geometry.last_step + 1.0);
  };
  HokuyoRequest request;
  request.first = std::max(geometry.first_step,
                           static_cast<int>(std::ceil(limit(toStep(settings.angle_min) - kTolerance))));
  request.last = std::min(geometry.last_step,
                          static_cast<int>(std::floor(limit(toStep(settings.angle_max) + kTolerance))));
  request.cluster = settings.cluster;
  request.skip = settings.skip;
  request.intensity = settings.intensity;
  request.multi_echo = settings.multi_echo;
  request.last -= std::max(0, request.last - request.first + 1) % request.cluster;
  if (request.last < request.first) {
    throw std::invalid_argument("between " + std::to_string(settings.angle_min) + " and " +
                                std::to_string(settings.angle_max) + " rad the device has no " +
                                std::to_string(settings.cluster) + " steps; it sees from " +
                                std::to_string(geometry.angle(geometry.first_step)) + " to " +
                                std::to_string(geometry.angle(geometry.last_step)));
  }
  return request;
}

std::string HokuyoRequest::command() const {
  char text[32];
  std::snprintf(text, sizeof(text), "%c%c%04d%04d%02d%d00", multi_echo ? 'N' : 'M', intensity ? 'E' : 'D',
                first, last, cluster, skip);
  return text;
}

void selectEchoes(const HokuyoScan& scan, Echo echo, std::vector<float>& ranges,
                  std::vector<float>& intensities) {
  const bool has_intensities = !scan.intensities.empty();
  ranges.resize(scan.rays());
  intensities.resize(has_intensities ? scan.rays() : 0);
  for (std::size_t ray = 0; ray < scan.rays(); ++ray) {
    const std::uint32_t begin = scan.first_echo[ray], end = scan.first_echo[ray + 1];
    std::uint32_t chosen = echo == Echo::kLast ? end - 1 : begin;
    if (echo == Echo::kMostIntense && has_intensities) {
      const auto data = scan.intensities.begin();
      chosen = static_cast<std::uint32_t>(std::max_element(data + begin, data + end) - data);
    }
    ranges[ray] = scan.ranges[chosen];
    if (has_intensities) intensities[ray] = scan.intensities[chosen];
  }
}

float toRange(std::uint32_t distance, const HokuyoGeometry& geometry) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const int millimetres = static_cast<int>(distance);
  if (millimetres > geometry.max_distance) return kInfinity;
  if (millimetres > 0 && millimetres >= geometry.min_distance) return static_cast<float>(1e-3 * millimetres);
  const bool has_codes = geometry.max_distance > kCodesUpToReach;
  if (has_codes && millimetres == 1) return kInfinity;
  if (has_codes && millimetres == 2) return -kInfinity;
  return std::numeric_limits<float>::quiet_NaN();
}

HokuyoScan describeScan(const HokuyoRequest& request, const HokuyoGeometry& geometry) {
  HokuyoScan scan;
  scan.angle_min = geometry.angle(request.step(0));
  scan.angle_max = geometry.angle(request.step(request.rays() - 1));
  scan.angle_increment = request.cluster * geometry.angleIncrement();
  const double period = 1e-9 * static_cast<double>(geometry.period());
  scan.time_increment = request.cluster * period / geometry.resolution;
  scan.scan_time = period * (request.skip + 1);
  scan.range_min = 1e-3 * geometry.min_distance;
  scan.range_max = 1e-3 * geometry.max_distance;
  return scan;
}

bool decodeScan(const std::string& characters, const HokuyoRequest& request, const HokuyoGeometry& geometry,
                HokuyoScan& scan) {
  const auto rays = static_cast<std::size_t>(request.rays());
  const std::size_t width = request.intensity ? 2 * kDigits : kDigits;
  scan.first_echo.assign(1, 0);
  scan.first_echo.reserve(rays + 1);
  scan.ranges.clear();
  scan.ranges.reserve(rays);
  scan.intensities.clear();
  const std::string_view text = characters;
  std::size_t at = 0;
  while (at < text.size()) {
    const bool is_further = text[at] == '&';
    const auto echo = static_cast<std::uint32_t>(scan.ranges.size());
    if (is_further) {
      if (!request.multi_echo || echo == 0 || echo - scan.first_echo[scan.rays() - 1] >= kMaxEchoes)
        return false;
      ++at;
    }
    if (text.size() - at < width || (!is_further && scan.rays() == rays)) return false;
    const auto distance = scip::decode(text.substr(at, kDigits));
    const auto intensity = scip::decode(text.substr(at + width - kDigits, kDigits));
    if (!distance || !intensity) return false;
    scan.ranges.push_back(toRange(*distance, geometry));
    if (request.intensity) scan.intensities.push_back(static_cast<float>(*intensity));
    if (is_further) {
      scan.first_echo.back() = echo + 1;
    } else {
      scan.first_echo.push_back(echo + 1);
    }
    at += width;
  }
  return scan.rays() == rays;
}

}  // namespace hokuyo_sick_drivers
