// SPDX-License-Identifier: BSD-3-Clause
//
// Calibration files: round trip, and files that aren't one.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include "laser_intensity_calib/calibration_file.h"
#include "scanner_model.h"

namespace laser_intensity_calib {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

class CalibrationFile : public testing::Test {
 protected:
  static Calibration example() {
    FitOptions options;
    options.range_step = 0.2;
    options.incidence_step = 4.0 * kRadians;
    Calibration c = calibrate(observe(0.8, 10, 2000), options);
    c.scanner = "UTM-30LX \"left\"";
    c.reference = "white paper: 80 g";
    c.date = "2026-01-31T12:00:00Z";
    c.source = "wall.bag /scan";
    return c;
  }
  std::string saved() {
    const std::string path = dir_.path("calibration.yaml");
    saveCalibration(example(), path);
    return path;
  }
  std::string errorOfText(const std::string& text) {
    const std::string path = dir_.write("changed.yaml", text);
    const std::string error = errorOf([&] { loadCalibration(path); });
    EXPECT_TRUE(mentions(error, {"changed.yaml"}));
    return error;
  }
  static std::string replaced(std::string text, const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    EXPECT_NE(std::string::npos, at) << from;
    return text.replace(at, from.size(), to);
  }

  mapping_common::TempDir dir_;
};

TEST_F(CalibrationFile, ComesBackAsItWas) {
  const Calibration c = example(), read = loadCalibration(saved());
  EXPECT_EQ(c.scanner, read.scanner);
  EXPECT_EQ(c.reference, read.reference);
  EXPECT_EQ(c.date, read.date);
  EXPECT_EQ(c.source, read.source);
  EXPECT_EQ(c.samples, read.samples);
  EXPECT_EQ(c.scans, read.scans);
  EXPECT_NEAR(c.range.max, read.range.max, 1e-6);
  EXPECT_NEAR(c.incidence.max, read.incidence.max, 1e-6);
  EXPECT_NEAR(c.residuals[2].rms, read.residuals[2].rms, 1e-6);
  for (const Sample& s : observe(0.8, 1, 1000, 0.0, 7)) {
    for (const ModelType type : kModelTypes) {
      const Response a = c.at(type, s.range, s.incidence), b = read.at(type, s.range, s.incidence);
      ASSERT_EQ(a.inside, b.inside);
      ASSERT_NEAR(1.0, b.intensity / a.intensity, 1e-5);
    }
  }
}

TEST_F(CalibrationFile, KeepsOffsets) {
  Calibration c = example();
  c.offsets = {-12.5F, std::numeric_limits<float>::quiet_NaN(), 40.0F};
  const std::string path = dir_.path("offsets.yaml");
  saveCalibration(c, path);
  const Calibration read = loadCalibration(path);
  ASSERT_EQ(3u, read.offsets.size());
  EXPECT_EQ(-12.5F, read.offsets[0]);
  EXPECT_TRUE(std::isnan(read.offsets[1]));
  EXPECT_EQ(40.0F, read.offsets[2]);
  EXPECT_TRUE(loadCalibration(saved()).offsets.empty());
  c.offsets[0] = std::numeric_limits<float>::infinity();
  saveCalibration(c, path);
  EXPECT_TRUE(mentions(errorOf([&] { loadCalibration(path); }), {"offsets"}));
}

TEST_F(CalibrationFile, MayLackModels) {
  Calibration c = example();
  c.polynomial = RangePolynomial();
  c.table = LookupTable();
  saveCalibration(c, dir_.path("raw.yaml"));
  const Calibration read = loadCalibration(dir_.path("raw.yaml"));
  EXPECT_TRUE(read.has(ModelType::kRaw));
  EXPECT_FALSE(read.has(ModelType::kRange));
  EXPECT_FALSE(read.has(ModelType::kLut));
}

TEST_F(CalibrationFile, RefusesWhatIsNone) {
  EXPECT_TRUE(mentions(errorOf([] { loadCalibration("/nowhere/none.yaml"); }), {"/nowhere/none.yaml"}));
  EXPECT_TRUE(mentions(errorOfText(""), {"no calibration"}));
  EXPECT_TRUE(mentions(errorOfText("resolution: 0.2\n"), {"no calibration"}));
  EXPECT_TRUE(mentions(errorOfText(std::string(1000, '\0')), {"no calibration"}));
  EXPECT_TRUE(mentions(errorOf([this] { loadCalibration(dir_.path()); }), {dir_.path().c_str()}))
      << "a folder";
}

TEST_F(CalibrationFile, RefusesEveryTruncation) {
  const std::string text = mapping_common::readFile(saved());
  for (std::size_t size = 0; size < text.size(); size += 97) {
    EXPECT_NE("", errorOfText(text.substr(0, size))) << size;
  }
  EXPECT_NE("", errorOfText(text.substr(0, text.size() - 1)));
}

TEST_F(CalibrationFile, RefusesChanges) {
  const std::string text = mapping_common::readFile(saved());
  EXPECT_TRUE(mentions(errorOfText(replaced(text, "samples: 2", "samples: 3")), {"checksum"}));
  EXPECT_TRUE(mentions(errorOfText(replaced(text, "version: 1", "version: 2")), {"version 2", "version 1"}));
  EXPECT_NE("", errorOfText(text + "raw: 1\n"));
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    std::string changed = text;
    changed[random() % text.size()] ^= static_cast<char>(1 + random() % 127);
    EXPECT_NE("", errorOfText(changed));
  }
}

TEST_F(CalibrationFile, AFailureLeavesTheOldFile) {
  const std::string path = saved();
  EXPECT_NE("", errorOf([] { saveCalibration(Calibration(), "/nowhere/none.yaml"); }));
  EXPECT_NO_THROW(loadCalibration(path));
}

}  // namespace
}  // namespace laser_intensity_calib
