// SPDX-License-Identifier: BSD-3-Clause
//
// Reads what users of a terrestrial scanner (e.g. Z+F Imager 5010C) export from its software: E57 (ASTM
// E2807), PTX, PTS and ASCII points. Points are streamed: memory doesn't grow with the file.
#pragma once

#include <mapping_common/options.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hokuyo_sick_drivers/zf/byte_source.h"

namespace hokuyo_sick_drivers {

enum class ScanFormat { kE57, kPtx, kPts, kAsc };
std::string toString(ScanFormat format);

struct Limits {
  double min = 0.0, max = 0.0;
};

/// What is known of a scan before its points are read.
struct ScanInfo {
  std::string name;
  std::uint64_t points = 0;             ///< records, missing points included; for ASC lines, headers included
  std::uint32_t rows = 0, columns = 0;  ///< of the grid; 0: the points have no order
  bool has_intensity = false, has_colour = false;
  std::optional<Limits> intensity_limits;                  ///< of the values in the file
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< of the scanner in the registered frame, m
  bool has_pose = false;

  bool hasGrid() const { return rows > 0 && columns > 0; }
};

struct ScanPoint {
  double x = 0.0, y = 0.0, z = 0.0;  ///< m, in the scanner's frame
  float intensity = 0.0F;            ///< as ReadOptions says; NaN: marked as invalid
  std::uint8_t r = 0, g = 0, b = 0;
  bool valid = true;  ///< false: nothing was measured, as exactly (0, 0, 0) says where there is no state
  std::uint32_t row = 0, column = 0;  ///< from 0; not checked against the size of the grid
};

enum class IntensityScale { kRaw, kNormalised, kLimits };
constexpr auto choicesOf(IntensityScale) {
  return mapping_common::choices<IntensityScale>(
      {{"raw", IntensityScale::kRaw, "the file's values"},
       {"normalised", IntensityScale::kNormalised,
        "0 to 1 by the file's limits, or by the convention of its format where it tells none"},
       {"limits", IntensityScale::kLimits, "0 to 1 by those below"}});
}

struct ReadOptions {
  IntensityScale intensity = IntensityScale::kRaw;
  Limits intensity_limits{0.0, 1.0};
  std::string columns;
  bool verify_checksums = true;
  /// Called from time to time while open() looks through the file, with the part that is done, 0 to 1.
  /// Where it returns false, open() throws ReadStopped.
  std::function<bool(double)> opening;

  void describe(mapping_common::OptionList& o) {
    o("intensity", intensity, "", "");
    o("intensity_min", intensity_limits.min, "", "limits: value that becomes 0");
    o("intensity_max", intensity_limits.max, "", "limits: value that becomes 1");
    o("columns", columns, "",
      "PTS, ASC: what the columns are, of x y z i r g b, _ for others, - before x y z to turn their sign, rf "
      "gf bf "
      "for colours from 0 to 1, e.g. \"_ _ x -y z i\". Empty: as a header names them, or else by their "
      "number");
    o("verify_checksums", verify_checksums, "", "E57: false: a damaged page is a warning, no error");
    o.require(intensity_limits.min < intensity_limits.max, "intensity_max", "more than intensity_min");
  }
};

struct ReadStopped : std::runtime_error {
  ReadStopped() : std::runtime_error("stopped") {}
};

/// Takes points as they are read, in the file's order; `progress` is the part that is done, 0 to 1. False:
/// stop.
using PointSink = std::function<bool(const std::vector<ScanPoint>& points, double progress)>;

class ScanFileReader {
 public:
  virtual ~ScanFileReader() = default;

  virtual ScanFormat format() const = 0;
  const std::vector<ScanInfo>& scans() const { return scans_; }
  /// @param scan from 0
  /// @return false if the sink stopped it
  /// @throws std::runtime_error that says what is wrong, and where
  virtual bool read(std::size_t scan, const PointSink& sink) = 0;
  /// What was wrong but could be helped, up to now.
  virtual std::vector<std::string> warnings() const { return warnings_; }

 protected:
  std::vector<ScanInfo> scans_;
  std::vector<std::string> warnings_;
};

/// By what is in it, and by the name only where that doesn't tell.
/// @throws std::runtime_error for what it can't be, with what to do about a scanner's native files
ScanFormat recogniseScanFile(ByteSource& source, const std::string& name);

/// @throws std::runtime_error that starts with the path
std::unique_ptr<ScanFileReader> openScanFile(const std::string& path, const ReadOptions& options = {});
std::unique_ptr<ScanFileReader> openScanFile(std::shared_ptr<ByteSource> source, const std::string& name,
                                             const ReadOptions& options = {});

}  // namespace hokuyo_sick_drivers
