// SPDX-License-Identifier: BSD-3-Clause
#include <laser_intensity_calib/statistics.h>
#include <mapping_common/files.h>
#include <rosbag_tests/evaluations/calibration_evaluation.h>

#include <algorithm>
#include <cstdio>
#include <numeric>
#include <ostream>
#include <stdexcept>

namespace rosbag_tests {
namespace {

using laser_intensity_calib::Calibration;
using laser_intensity_calib::kModelTypes;
using laser_intensity_calib::ModelType;
using laser_intensity_calib::Sample;

// Reflectivities by model, empty where one of them has none.
std::map<ModelType, float> reflectivitiesOf(const Calibration& calibration, const Sample& sample) {
  std::map<ModelType, float> values;
  for (const ModelType type : kModelTypes) {
    if (!calibration.has(type)) continue;
    const laser_intensity_calib::Response f = calibration.at(type, sample.range, sample.incidence);
    const float intensity = calibration.withoutOffset(sample.intensity, sample.laser);
    if (!f.inside || std::isnan(intensity)) return {};
    values[type] = (type == ModelType::kRaw ? sample.intensity : intensity) / f.intensity;
  }
  return values;
}

double mean(const std::vector<float>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

template <class... Arguments>
std::string text(const char* format, Arguments... arguments) {
  char buffer[200];
  std::snprintf(buffer, sizeof(buffer), format, arguments...);
  return buffer;
}

}  // namespace

Calibration trainOnFirstPart(Surfaces& surfaces, const std::vector<std::string>& references, double part,
                             const laser_intensity_calib::FitOptions& options,
                             std::vector<std::string>* problems) {
  for (const std::string& name : references)
    if (surfaces.count(name) == 0) throw std::invalid_argument("there is no surface " + name);
  int last = 0;
  for (const auto& [name, samples] : surfaces)
    for (const Sample& s : samples) last = std::max(last, s.scan);
  const double end = part * (last + 1);
  std::vector<Sample> training;
  for (auto& [name, samples] : surfaces) {
    const auto rest = std::stable_partition(samples.begin(), samples.end(),
                                            [end](const Sample& s) { return s.scan < end; });
    if (std::count(references.begin(), references.end(), name) > 0)
      training.insert(training.end(), samples.begin(), rest);
    samples.erase(samples.begin(), rest);
  }
  return laser_intensity_calib::calibrate(training, options, problems);
}

JudgedSurfaces judge(const Calibration& calibration, const Surfaces& surfaces) {
  if (!calibration.has(ModelType::kLut)) throw std::invalid_argument("the calibration has no table");
  JudgedSurfaces judged;
  for (const auto& [name, samples] : surfaces) {
    JudgedSurface& surface = judged[name];
    surface.samples = samples.size();
    for (const Sample& s : samples) {
      for (const auto& [type, value] : reflectivitiesOf(calibration, s))
        surface.reflectivities[type].push_back(value);
    }
  }
  return judged;
}

void printJudgement(std::ostream& out, const JudgedSurfaces& surfaces) {
  using namespace laser_intensity_calib;
  out << text("%-12s %-6s %9s %8s %8s %8s %6s\n", "surface", "model", "samples", "covered", "mean", "sd/mean",
              "modes");
  for (const auto& [name, surface] : surfaces) {
    if (surface.reflectivities.empty()) out << text("%-12s not covered\n", name.c_str());
    for (const auto& [type, values] : surface.reflectivities) {
      const double covered = static_cast<double>(values.size()) / static_cast<double>(surface.samples);
      out << text("%-12s %-6s %9zu %6.1f %% %8.3f %7.1f %% %6d\n", name.c_str(), toString(type).c_str(),
                  values.size(), 100.0 * covered, mean(values), 100.0 * coefficientOfVariation(values),
                  modes(values));
    }
  }
  out << text("\n%-26s", "overlap of histograms");
  for (const ModelType type : kModelTypes) out << text(" %8s", toString(type).c_str());
  for (auto a = surfaces.begin(); a != surfaces.end(); ++a) {
    for (auto b = std::next(a); b != surfaces.end(); ++b) {
      out << text("\n%-12s  %-12s", a->first.c_str(), b->first.c_str());
      for (const ModelType type : kModelTypes) {
        const auto in_a = a->second.reflectivities.find(type), in_b = b->second.reflectivities.find(type);
        if (in_a == a->second.reflectivities.end() || in_b == b->second.reflectivities.end())
          out << text(" %8s", "-");
        else
          out << text(" %6.1f %%", 100.0 * overlap(in_a->second, in_b->second));
      }
    }
  }
  out << '\n';
}

void writeHistograms(const std::string& file, const JudgedSurfaces& surfaces) {
  mapping_common::writeFile(file, [&surfaces](std::ostream& out) {
    constexpr std::size_t kBins = 350;
    constexpr double kMax = 3.5;
    out << "surface,model,reflectivity,share\n";
    for (const auto& [name, surface] : surfaces) {
      for (const auto& [type, values] : surface.reflectivities) {
        const std::vector<double> shares = laser_intensity_calib::histogram(values, 0.0, kMax, kBins);
        for (std::size_t i = 0; i < kBins; ++i)
          out << name << ',' << toString(type) << ',' << (i + 0.5) * kMax / kBins << ',' << shares[i] << '\n';
      }
    }
  });
}

}  // namespace rosbag_tests
