// SPDX-License-Identifier: BSD-3-Clause
#include "faults.h"

#include <algorithm>
#include <stdexcept>

namespace device_emulators {
namespace {

constexpr std::array<const char*, kNumFaults> kNames = {"bytes-lost",
                                                        "bits-flipped",
                                                        "cut",
                                                        "garbage",
                                                        "silence",
                                                        "stall",
                                                        "disconnect",
                                                        "reboot",
                                                        "wrong-sum",
                                                        "unstable",
                                                        "error-status",
                                                        "nak",
                                                        "count-mismatch",
                                                        "already-streaming",
                                                        "half-message"};

bool needsNoMessage(Fault fault) {
  return fault == Fault::kSilence || fault == Fault::kStall || fault == Fault::kDisconnect ||
         fault == Fault::kReboot;
}

}  // namespace

const char* faultName(Fault fault) {
  return kNames[static_cast<std::size_t>(fault)];
}

Fault faultNamed(const std::string& name) {
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found != kNames.end()) return static_cast<Fault>(found - kNames.begin());
  std::string known;
  for (const char* other : kNames) known += std::string(" ") + other;
  throw std::runtime_error("unknown fault '" + name + "'; known are" + known);
}

std::vector<Fault> allFaults() {
  std::vector<Fault> faults;
  for (std::size_t i = 0; i < kNumFaults; ++i) faults.push_back(static_cast<Fault>(i));
  return faults;
}

bool FaultInjector::momentCame(Fault fault, Nanoseconds now) {
  auto& moments = options_.moments;
  const auto due = std::find_if(moments.begin(), moments.end(), [&](const FaultOptions::Moment& moment) {
    return moment.fault == fault && moment.when <= now;
  });
  if (due == moments.end()) return false;
  moments.erase(due);
  ++counts_[static_cast<std::size_t>(fault)];
  return true;
}

bool FaultInjector::hits(Fault fault, Nanoseconds now) {
  if (momentCame(fault, now)) return true;
  const double rate = options_.rate(fault);
  if (rate <= 0.0 || !std::bernoulli_distribution(std::min(rate, 1.0))(random_)) return false;
  ++counts_[static_cast<std::size_t>(fault)];
  return true;
}

Nanoseconds FaultInjector::nextMoment() const {
  Nanoseconds next = kNever;
  for (const auto& moment : options_.moments)
    if (needsNoMessage(moment.fault)) next = std::min(next, moment.when);
  return next;
}

}  // namespace device_emulators
