// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/laser_faults.h"

namespace mapping_common {
namespace {

Drops::Options optionsOf(const std::string& nodelet) {
  Drops::Options options;
  options.name = nodelet;
  options.warning = "A scan isn't used as it says";
  options.key = "Not as it says";
  options.reasons = {"intensities", "range_max", "ranges", "raw intensities", "time_increment"};
  return options;
}

}  // namespace

LaserFaults::LaserFaults(const std::string& nodelet) : faults_(optionsOf(nodelet)) {}

void LaserFaults::add(const LaserReading& reading) {
  for (const auto& [what, why] : reading.warnings) faults_.add(what, why);
}

void LaserFaults::addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  faults_.addTo(status);
  if (faults_.recent() == 0) return;
  status.mergeSummaryf(diagnostic_msgs::DiagnosticStatus::WARN, "%zu scans aren't used as they say",
                       faults_.recent());
}

}  // namespace mapping_common
