// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_scan.h"

#include <algorithm>
#include <cmath>

#include "scip_text.h"

namespace device_emulators {
namespace {

constexpr int kMaxEchoes = 3;
constexpr std::uint32_t kMax18Bits = (1u << 18) - 1, kMax12Bits = (1u << 12) - 1;

std::uint32_t rangeCode(float range, const HokuyoModel& model) {
  if (std::isnan(range)) return model.code_invalid;
  const double mm = std::round(range * 1000.0);
  if (mm > model.dmax) return model.code_far;
  if (mm < model.dmin) return range == 0.0f ? model.code_invalid : model.code_near;
  return static_cast<std::uint32_t>(mm);
}

std::uint32_t intensityCode(double intensity) {
  return intensity > 0.0 ? static_cast<std::uint32_t>(std::lround(std::min<double>(intensity, kMax18Bits)))
                         : 0;
}

bool isRange(std::uint32_t code, const HokuyoModel& model) {
  return code >= static_cast<std::uint32_t>(model.dmin);
}

}  // namespace

SentScan measure(const Scan* scan, const HokuyoModel& model, const HokuyoRequest& request,
                 bool partial_group) {
  SentScan sent;
  sent.first_step = request.first;
  sent.cluster = request.cluster;
  const auto angle = [&](int step) { return (step - model.afrt) * 2.0 * M_PI / model.ares; };
  for (int group = request.first; group <= request.last; group += request.cluster) {
    int group_end = group + request.cluster - 1;
    if (group_end > request.last) {
      if (!partial_group) break;
      group_end = request.last;
    }
    // The smallest distance of the group, codes left out; a code where there is nothing else.
    int best = -1;
    std::uint32_t best_code = model.code_invalid;
    for (int step = group; step <= group_end; ++step) {
      const int beam = scan ? beamAt(*scan, angle(step)) : -1;
      const std::uint32_t code = beam < 0 ? model.code_invalid : rangeCode(scan->ranges[0][beam], model);
      const bool better = isRange(code, model) && (!isRange(best_code, model) || code < best_code);
      if (step == group || better) {
        best = beam;
        best_code = code;
      }
    }
    int echoes = 0;
    const int available = request.multi_echo && best >= 0 ? static_cast<int>(scan->ranges.size()) : 1;
    for (int echo = 0; echo < std::min(available, kMaxEchoes); ++echo) {
      if (echo > 0 && std::isnan(scan->ranges[echo][best])) break;
      sent.ranges.push_back(echo == 0 ? best_code : rangeCode(scan->ranges[echo][best], model));
      if (request.two_characters) sent.ranges.back() = std::min(sent.ranges.back(), kMax12Bits);
      if (request.intensity) {
        const bool has_intensity = best >= 0 && !scan->intensities.empty();
        sent.intensities.push_back(
            has_intensity ? intensityCode(model.intensity_scale * scan->intensities[echo][best]) : 0);
      }
      ++echoes;
    }
    if (request.multi_echo) sent.echoes.push_back(static_cast<std::uint8_t>(echoes));
  }
  return sent;
}

std::string encodeScan(const SentScan& scan, const HokuyoRequest& request) {
  std::string data;
  std::size_t value = 0;
  const std::size_t steps = scan.echoes.empty() ? scan.ranges.size() : scan.echoes.size();
  for (std::size_t step = 0; step < steps; ++step) {
    const int echoes = scan.echoes.empty() ? 1 : scan.echoes[step];
    for (int echo = 0; echo < echoes; ++echo, ++value) {
      if (echo > 0) data += '&';
      data += scipEncode(scan.ranges[value], request.two_characters ? 2 : 3);
      if (request.intensity) data += scipEncode(scan.intensities[value], 3);
    }
  }
  return data;
}

}  // namespace device_emulators
