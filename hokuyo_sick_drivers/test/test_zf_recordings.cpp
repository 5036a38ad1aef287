// SPDX-License-Identifier: BSD-3-Clause
//
// Files that other people's software wrote.
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>
#include <cstdlib>
#include <map>

#include "zf_test_reading.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::findRecording;
using mapping_common::withoutRecording;

struct Recording {
  std::string file;
  ScanFormat format;
  std::vector<std::size_t> points;  // of each scan
  std::size_t valid;                // of the first one
  std::size_t warnings;
};

class Recordings : public ::testing::TestWithParam<Recording> {};

TEST_P(Recordings, HoldTheirPoints) {
  const std::string path = findRecording("tls_formats/" + GetParam().file);
  if (path.empty()) GTEST_SKIP() << withoutRecording("tls_formats/" + GetParam().file);
  const auto reader = openScanFile(path);
  EXPECT_EQ(GetParam().format, reader->format());
  ASSERT_EQ(GetParam().points.size(), reader->scans().size());
  for (std::size_t i = 0; i < reader->scans().size(); ++i) {
    const auto points = MemoryFile::readAll(*reader, i);
    EXPECT_EQ(GetParam().points[i], points.size());
    std::size_t valid = 0;
    for (const ScanPoint& point : points) valid += point.valid ? 1 : 0;
    if (i == 0) {
      EXPECT_EQ(GetParam().valid, valid);
    }
  }
  EXPECT_EQ(GetParam().warnings, reader->warnings().size());
}

INSTANTIATE_TEST_SUITE_P(
    All, Recordings,
    ::testing::Values(Recording{"cryinc_bunnyInt32.e57", ScanFormat::kE57, {30571}, 30571, 0},
                      Recording{"cryinc_empty_pc.e57", ScanFormat::kE57, {0}, 0, 0},
                      Recording{"cryinc_float_intensity_without_min_max.e57", ScanFormat::kE57, {1}, 1, 0},
                      Recording{"cryinc_integer_intensity.e57", ScanFormat::kE57, {2}, 2, 0},
                      Recording{"cryinc_scaled_integer_intensity.e57", ScanFormat::kE57, {2}, 2, 0},
                      Recording{"cryinc_tinyCartesianFloatRgb.e57", ScanFormat::kE57, {2090}, 2090, 0},
                      Recording{"cryinc_tiny_spherical.e57", ScanFormat::kE57, {360}, 180, 0},
                      Recording{"pumpA.e57", ScanFormat::kE57, {155201}, 155201, 0},
                      Recording{"pdal_1.2-with-color.ptx", ScanFormat::kPtx, {1065}, 1065, 0},
                      Recording{"pdal_complex-transform.ptx", ScanFormat::kPtx, {12}, 4, 0},
                      Recording{"pdal_multiple-and-transform.ptx", ScanFormat::kPtx, {4, 4}, 4, 1},
                      Recording{"pdal_no-color.ptx", ScanFormat::kPtx, {15}, 15, 0},
                      Recording{"pdal_autzen.pts", ScanFormat::kPts, {10}, 10, 0},
                      Recording{"pdal_bunny_8.pts", ScanFormat::kPts, {8}, 8, 1},
                      Recording{"pdal_site_56_8.pts", ScanFormat::kPts, {8}, 8, 0},
                      Recording{"pdal_test.pts", ScanFormat::kPts, {19}, 19, 0}),
    [](const auto& info) {
      std::string name = info.param.file;
      for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
      return name;
    });

TEST(Recording, OneScanAsE57AndAsPtx) {
  const std::string e57_path = findRecording("tls_formats/pumpA.e57");
  const std::string ptx_path = findRecording("tls_formats/pumpA.ptx.xz");
  if (e57_path.empty() || ptx_path.empty()) GTEST_SKIP() << withoutRecording("tls_formats/pumpA");
  const mapping_common::TempDir dir;
  if (std::system(("xz -dc " + ptx_path + " >" + dir.path("a.ptx")).c_str()) != 0)
    GTEST_SKIP() << "xz isn't installed";

  const auto e57 = openScanFile(e57_path), ptx = openScanFile(dir.path("a.ptx"));
  for (const auto* reader : {e57.get(), ptx.get()}) {
    ASSERT_EQ(1u, reader->scans().size());
    EXPECT_EQ(1074u, reader->scans()[0].rows);
    EXPECT_EQ(345u, reader->scans()[0].columns);
  }
  const auto in_cells = [](ScanFileReader& reader) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, ScanPoint> cells;
    for (const ScanPoint& point : MemoryFile::readAll(reader)) {
      if (point.valid) cells[{point.row, point.column}] = point;
    }
    return cells;
  };
  const auto a = in_cells(*e57), b = in_cells(*ptx);
  ASSERT_EQ(155201u, a.size());
  ASSERT_EQ(155201u, b.size());
  for (const auto& [cell, point] : a) {
    const auto other = b.find(cell);
    ASSERT_NE(b.end(), other);
    // The text has six decimals.
    ASSERT_NEAR(point.x, other->second.x, 1e-6);
    ASSERT_NEAR(point.y, other->second.y, 1e-6);
    ASSERT_NEAR(point.z, other->second.z, 1e-6);
    ASSERT_NEAR(point.intensity, other->second.intensity, 1e-6);
    ASSERT_EQ(point.r, other->second.r);
    ASSERT_EQ(point.g, other->second.g);
    ASSERT_EQ(point.b, other->second.b);
  }
}

TEST(Recording, IntensitiesByTheirLimits) {
  for (const char* name : {"cryinc_integer_intensity.e57", "cryinc_scaled_integer_intensity.e57"}) {
    const std::string path = findRecording(std::string("tls_formats/") + name);
    if (path.empty()) GTEST_SKIP() << withoutRecording(name);
    const auto reader = openScanFile(path, withIntensity(IntensityScale::kNormalised));
    for (const ScanPoint& point : MemoryFile::readAll(*reader)) {
      EXPECT_GE(point.intensity, 0.0F) << name;
      EXPECT_LE(point.intensity, 1.0F) << name;
    }
  }
}

}  // namespace
}  // namespace hokuyo_sick_drivers
