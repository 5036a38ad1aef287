// SPDX-License-Identifier: BSD-3-Clause
//
// Real intensities: walls in a recording of a SICK TiM781S, which stands still.
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>

#include "laser_intensity_calib/ros/bag_samples.h"
#include "laser_intensity_calib/statistics.h"

namespace laser_intensity_calib {
namespace {

const char kRecording[] = "sick_tim781s_rssi/tim781s_static_a.bag";

std::vector<Sample> wall(const std::string& bag, int first, int last) {
  BagSamplesOptions options;
  options.topic = "/scan";
  options.region.first_beam = first;
  options.region.last_beam = last;
  BagSamplesReport report;
  std::vector<Sample> samples = collectSamples(bag, options, report);
  EXPECT_EQ(500u, report.messages);
  EXPECT_EQ(0u, report.malformed);
  return samples;
}

TEST(Recordings, ATableEvensOutTheIntensitiesOfAWall) {
  const std::string bag = mapping_common::findRecording(kRecording);
  if (bag.empty()) GTEST_SKIP() << mapping_common::withoutRecording(kRecording);
  // Three flat walls of one room, at 0.75 to 1.9 m and up to 50 degrees.
  std::vector<Sample> training, test;
  for (const auto& [first, last] : {std::pair{112, 185}, {200, 262}, {272, 338}}) {
    const std::vector<Sample> samples = wall(bag, first, last);
    EXPECT_GT(samples.size(), 0.9 * 500 * (last - first));
    for (const Sample& s : samples) (s.scan < 250 ? training : test).push_back(s);
  }
  FitOptions options;
  options.range_cell = 0.05;
  options.range_step = 0.025;
  options.normal_incidence = 0.5 * M_PI;
  const Calibration c = calibrate(training, options);
  const Residuals raw = residualsOf(c, ModelType::kRaw, test), lut = residualsOf(c, ModelType::kLut, test);
  EXPECT_GT(lut.covered, 0.95);
  EXPECT_GT(raw.rms, 0.045);
  EXPECT_LT(lut.rms, 0.025) << "of scans that the table wasn't fitted to";
  EXPECT_LT(lut.rms, 0.5 * raw.rms);
}

}  // namespace
}  // namespace laser_intensity_calib
