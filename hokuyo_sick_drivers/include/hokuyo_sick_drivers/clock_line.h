// SPDX-License-Identifier: BSD-3-Clause
//
// How two clocks run against each other: their offset is a straight line over time, as each has a quartz.
#pragma once

#include <algorithm>
#include <deque>
#include <vector>

#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// A moment that two clocks have shown.
struct ClockOffset {
  Nanoseconds time = 0;    ///< of one clock
  Nanoseconds offset = 0;  ///< that the other was ahead of it
};

/// An offset that changes evenly.
struct ClockLine {
  ClockOffset point;   ///< the line passes through it
  double drift = 0.0;  ///< change of the offset per time, of no unit
  Nanoseconds offsetAt(Nanoseconds time) const;
};

/// The straight line of the fastest messages.
///
/// A message's time of arrival less the time at which its sender says that it was sent is the offset of the
/// two clocks, plus a constant delay, plus a jitter of zero or more. The jitter has no upper bound, but that
/// of some messages is next to nothing: these lie on a straight line, and all others above it (Moon, Skelly,
/// Towsley: Estimation and removal of clock skew from network delay measurements, INFOCOM 1999).
/// @param points one or more, in the order of time
/// @return of all lines that no point lies below and whose drift is within the bounds, the one that is
/// closest
///   to the points on average
ClockLine lineBelow(const std::deque<ClockOffset>& points, double min_drift, double max_drift);

struct Interval {
  double least, greatest;
  double middle() const { return (least + greatest) / 2.0; }
  bool contains(double value, double slack) const {
    return value >= least - slack && value <= greatest + slack;
  }
  void include(double value) {
    least = std::min(least, value);
    greatest = std::max(greatest, value);
  }
};

/// All straight lines that pass close by each of some points, within the same bounds below and above. They
/// are kept as a convex polygon whose coordinates are a line's offset at the first point and its drift.
class LineSet {
 public:
  /// @param points one or more
  /// @param below, above how far a line may pass below and above a point, ns
  /// @param max_drift of a line, either way
  /// @param tolerance by which both bounds are widened, ns; doubled until there is a line
  LineSet(const std::deque<ClockOffset>& points, Nanoseconds below, Nanoseconds above, double max_drift,
          Nanoseconds tolerance);
  /// The offsets of all these lines at a time, ns.
  Interval offsetsAt(Nanoseconds time) const;
  Interval drifts() const;

 private:
  struct Line {
    double offset, drift;
    double offsetAt(double age) const { return offset + drift * age; }
  };
  ClockOffset origin_;
  std::vector<Line> corners_;  // of the polygon; offsets are relative to the origin
};

}  // namespace hokuyo_sick_drivers
