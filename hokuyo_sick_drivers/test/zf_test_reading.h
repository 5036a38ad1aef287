// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

/// A file in memory and its reader.
class MemoryFile {
 public:
  MemoryFile(std::string bytes, const std::string& name, const ReadOptions& options = {})
      : bytes_(std::move(bytes)),
        reader(openScanFile(openMemory(bytes_.data(), bytes_.size()), name, options)) {}

  std::vector<ScanPoint> points(std::size_t scan = 0) { return readAll(*reader, scan); }

  static std::vector<ScanPoint> readAll(ScanFileReader& reader, std::size_t scan = 0) {
    std::vector<ScanPoint> all;
    double last = 0.0;
    EXPECT_TRUE(reader.read(scan, [&](const std::vector<ScanPoint>& points, double progress) {
      EXPECT_GE(progress, last);
      last = progress;
      all.insert(all.end(), points.begin(), points.end());
      return true;
    }));
    EXPECT_EQ(1.0, last);
    return all;
  }

 private:
  const std::string bytes_;

 public:
  std::unique_ptr<ScanFileReader> reader;
};

inline ReadOptions withIntensity(IntensityScale scale, Limits limits = {0.0, 1.0}) {
  ReadOptions options;
  options.intensity = scale;
  options.intensity_limits = limits;
  return options;
}

}  // namespace hokuyo_sick_drivers
