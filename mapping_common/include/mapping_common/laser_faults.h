// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/arrivals.h>
#include <mapping_common/laser_scans.h>

#include <string>

namespace mapping_common {

/// Laser scans that are used, but in another way than they say (LaserReading::warnings): they are counted,
/// and a warning says why, as those that are dropped.
class LaserFaults {
 public:
  explicit LaserFaults(const std::string& nodelet);

  void add(const LaserReading& reading);
  void endReport() { faults_.endReport(); }
  /// Counts by the name of the field; a warning in the summary where there were any since `endReport`.
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  Drops faults_;
};

}  // namespace mapping_common
