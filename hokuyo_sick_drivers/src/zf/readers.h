// SPDX-License-Identifier: BSD-3-Clause
//
// What openScanFile() chooses from, and what the readers share.
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

std::unique_ptr<ScanFileReader> openE57(std::shared_ptr<ByteSource> source, const ReadOptions& options);
std::unique_ptr<ScanFileReader> openPtx(std::shared_ptr<ByteSource> source, const ReadOptions& options);
std::unique_ptr<ScanFileReader> openPts(std::shared_ptr<ByteSource> source, const ReadOptions& options);
std::unique_ptr<ScanFileReader> openAsc(std::shared_ptr<ByteSource> source, const ReadOptions& options);

constexpr std::size_t kChunkPoints = 4096;  ///< that a sink gets at once

/// From the file's values to those that were asked for.
class IntensityMap {
 public:
  /// @param limits of the file's values, if it or its format tells; without them kNormalised leaves values
  /// alone
  IntensityMap(const ReadOptions& options, const std::optional<Limits>& limits) {
    std::optional<Limits> used;
    if (options.intensity == IntensityScale::kNormalised) used = limits;
    if (options.intensity == IntensityScale::kLimits) used = options.intensity_limits;
    if (used && used->max > used->min) {
      offset_ = used->min;
      range_ = used->max - used->min;
    }
  }
  float operator()(double value) const { return static_cast<float>((value - offset_) / range_); }

 private:
  double offset_ = 0.0, range_ = 1.0;
};

/// Whether a position is one. Exactly (0, 0, 0), the scanner's own place, is what many programs write where
/// nothing was measured.
inline bool isMeasured(double x, double y, double z) {
  return std::isfinite(x) && std::isfinite(y) && std::isfinite(z) && (x != 0.0 || y != 0.0 || z != 0.0);
}

/// To 0..255, rounded; NaN is 0.
inline std::uint8_t toColour(double value) {
  return value >= 255.0 ? 255 : value > 0.0 ? static_cast<std::uint8_t>(value + 0.5) : 0;
}

/// Fills chunks for a sink.
class ChunkWriter {
 public:
  explicit ChunkWriter(const PointSink& sink) : sink_(sink) {}
  /// @return false if the sink wants no more. `progress` is called once per chunk.
  template <class Progress>
  bool add(const ScanPoint& point, const Progress& progress) {
    points_.push_back(point);
    return points_.size() < kChunkPoints || flush(progress());
  }
  bool flush(double progress) {
    const bool go_on = sink_(points_, progress);
    points_.clear();
    return go_on;
  }

 private:
  const PointSink& sink_;
  std::vector<ScanPoint> points_;
};

}  // namespace hokuyo_sick_drivers
