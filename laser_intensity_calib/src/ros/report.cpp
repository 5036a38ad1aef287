// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/ros/report.h"

#include <mapping_common/files.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <sstream>
#include <stdexcept>

namespace laser_intensity_calib {
namespace {

constexpr double kDegrees = 180.0 / M_PI;
constexpr std::size_t kMaxRows = 20000;  // of a file

}  // namespace

void writeReport(const std::string& folder, const std::vector<Sample>& samples,
                 const Calibration& calibration, const FitOptions& options) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw std::runtime_error(folder + " can't be made: " + error.message());
  mapping_common::writeFile(folder + "/cells.csv", [&](std::ostream& out) {
    out << "range,incidence_deg,intensity,spread,samples\n";
    for (const Cell& c : sumUp(samples, options)) {
      out << c.range << ',' << c.incidence * kDegrees << ',' << c.intensity << ',' << c.spread << ','
          << c.samples << '\n';
    }
  });
  mapping_common::writeFile(folder + "/samples.csv", [&](std::ostream& out) {
    out << "range,incidence_deg,intensity,scan,raw,range_model,lut\n";
    const std::size_t step = samples.size() / kMaxRows + 1;
    for (std::size_t i = 0; i < samples.size(); i += step) {
      const Sample& s = samples[i];
      out << s.range << ',' << s.incidence * kDegrees << ',' << s.intensity << ',' << s.scan;
      for (const ModelType type : kModelTypes) {
        const Response f = calibration.has(type) ? calibration.at(type, s.range, s.incidence) : Response();
        out << ',';
        if (f.inside) out << calibration.withoutOffset(s.intensity, s.laser) / f.intensity;
      }
      out << '\n';
    }
  });
}

std::string describe(const Calibration& c, const Coverage& coverage) {
  std::ostringstream text;
  char line[200];
  std::snprintf(line, sizeof(line), "%zu samples of %zu scans, %.2f to %.2f m, %.0f to %.0f deg\n\n",
                c.samples, c.scans, c.range.min, c.range.max, c.incidence.min * kDegrees,
                c.incidence.max * kDegrees);
  text << line;
  text << "Relative error in scans left out     rms   median  covered\n";
  for (const ModelType type : kModelTypes) {
    const Residuals& r = c.residuals[static_cast<int>(type)];
    if (!c.has(type)) continue;
    std::string name = toString(type);
    if (type == ModelType::kRange)
      name += ", degree " + std::to_string(c.polynomial.coefficients().size() - 1);
    std::snprintf(line, sizeof(line), "  %-32s %5.1f %%  %5.1f %%  %5.1f %%\n", name.c_str(), 100.0 * r.rms,
                  100.0 * r.median, 100.0 * r.covered);
    text << line;
  }
  if (!c.offsets.empty()) {
    const auto known =
        std::count_if(c.offsets.begin(), c.offsets.end(), [](float o) { return !std::isnan(o); });
    float least = INFINITY, greatest = -INFINITY;
    for (const float o : c.offsets) {
      least = std::fmin(least, o);
      greatest = std::fmax(greatest, o);
    }
    std::snprintf(line, sizeof(line),
                  "\nOffsets of %td lasers: %.4g to %.4g, where the reference gives %.4g\n", known, least,
                  greatest, c.raw);
    text << line;
  }
  if (!coverage.map.empty()) text << "\nSamples over range and angle of incidence\n" << coverage.map;
  for (const std::string& sentence : coverage.advice) text << "- " << sentence << '\n';
  return text.str();
}

}  // namespace laser_intensity_calib
