// SPDX-License-Identifier: BSD-3-Clause
//
// How well models of intensity tell surfaces apart (thesis, 3.5.1, Fig. 3.4): reflectivities of surfaces that
// are seen at many distances and angles of incidence, for the raw, the range and the lookup table model.
#include <laser_intensity_calib/calibration_file.h>
#include <laser_intensity_calib/fit.h>
#include <laser_intensity_calib/incidence.h>
#include <laser_intensity_calib/ros/bag_samples.h>
#include <laser_intensity_calib/statistics.h>
#include <mapping_common/files.h>
#include <rosbag_tests/scan_files.h>
#include <rosbag_tests/simulator.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cstdio>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
using namespace laser_intensity_calib;

namespace {

const char kUsage[] =
    "Usage: evaluate_calibration --calibration FILE --world WORLD.yaml --sensor SENSOR.yaml [options]\n"
    "       evaluate_calibration --bag FILE --topic TOPIC --surface NAME:FIRST:LAST ... --reference NAME "
    "...\n"
    "       evaluate_calibration --scans FOLDER\n"
    "\n"
    "Judges the raw, the range and the lookup table model by the reflectivities of surfaces.\n"
    "1. A simulated planar scanner, mounted upright (push-broom), drives along the world's trajectory. "
    "Surfaces are\n"
    "   the objects whose names start with \"surface\".\n"
    "2. A recording of 2D scans. Surfaces are ranges of beams; models are fitted to the reference surfaces "
    "in the\n"
    "   first part of the scans and judged by the rest.\n"
    "3. Recorded 3D scans of a street. Surfaces are the road and its side, in the plane of the ground, and "
    "planar\n"
    "   faces above the sensor; the latter are the reference in the first part of the scans.\n";

// Samples by the name of the surface.
using Surfaces = std::map<std::string, std::vector<Sample>>;

struct Arguments {
  std::string calibration, world, sensor, bag, topic, scans, histograms, save;
  std::vector<std::string> surfaces, reference;
  double train = 0.5;
  int step = 1;
  std::uint64_t seed = 1;
  FitOptions fit;
  CloudIncidenceOptions cloud;
};

// ------------------------------------------------------------------------------------------------ where from

// The scanner looks up and sweeps the plane across the way.
Eigen::Isometry3d pushBroomMount() {
  Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();
  mount.linear().col(0) = Eigen::Vector3d::UnitZ();
  mount.linear().col(1) = Eigen::Vector3d::UnitY();
  mount.linear().col(2) = -Eigen::Vector3d::UnitX();
  mount.translation() = Eigen::Vector3d(0.0, 0.0, 0.7);
  return mount;
}

Surfaces simulateSurfaces(const Arguments& a) {
  rosbag_tests::Simulation simulation{rosbag_tests::loadWorld(a.world),
                                      rosbag_tests::loadTrajectory(a.world),
                                      {rosbag_tests::loadSensor(a.sensor)},
                                      0.0,
                                      a.seed};
  simulation.sensors[0].mount = pushBroomMount();
  simulation.duration = simulation.trajectory.endTime() - simulation.trajectory.startTime();
  std::vector<Eigen::Vector3f> points, viewpoints;
  std::vector<Sample> samples;
  std::vector<int> shapes;
  int scan = 0;
  rosbag_tests::simulate(
      simulation, [&](const rosbag_tests::SensorConfig& sensor, const rosbag_tests::Sweep& sweep) {
        for (int column = 0; column < sensor.columns; ++column) {
          const rosbag_tests::Echo& echo = sweep.echoes[column];
          if (!std::isfinite(echo.range)) continue;
          const Eigen::Isometry3d pose =
              simulation.trajectory.at(sweep.stamp + column * sensor.timeIncrement()) * sensor.mount;
          points.push_back((pose * (echo.range * sensor.direction(column, 0))).cast<float>());
          viewpoints.push_back(pose.translation().cast<float>());
          samples.push_back({static_cast<float>(echo.range), 0.0F, static_cast<float>(echo.intensity), scan});
          shapes.push_back(echo.truth.shape);
        }
        ++scan;
      });
  const auto n = static_cast<Eigen::Index>(points.size());
  const Eigen::ArrayXf incidence =
      cloudIncidence(Eigen::Map<const Eigen::Matrix3Xf>(points.data()->data(), 3, n),
                     Eigen::Map<const Eigen::Matrix3Xf>(viewpoints.data()->data(), 3, n), a.cloud);
  Surfaces surfaces;
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::string& name = simulation.world.shapes()[shapes[i]].name;
    samples[i].incidence = incidence[i];
    if (name.rfind("surface", 0) == 0) surfaces[name].push_back(samples[i]);
  }
  return surfaces;
}

Surfaces readBag(const Arguments& a) {
  Surfaces surfaces;
  for (const std::string& text : a.surfaces) {
    char name[64];
    BagSamplesOptions options;
    options.topic = a.topic;
    options.step = a.step;
    if (std::sscanf(text.c_str(), "%63[^:]:%d:%d", name, &options.region.first_beam,
                    &options.region.last_beam) != 3) {
      throw po::error("--surface is " + text + ", expected is NAME:FIRST:LAST");
    }
    BagSamplesReport report;
    surfaces[name] = collectSamples(a.bag, options, report);
  }
  return surfaces;
}

// The height (m) of the ground in the sensor's frame: the fullest layer below it.
float groundHeight(const pcl::PointCloud<pcl::PointXYZI>& cloud) {
  constexpr float kLayer = 0.05F;
  std::map<int, int> layers;
  for (const pcl::PointXYZI& p : cloud) {
    if (p.z < -0.5F && std::hypot(p.x, p.y) < 15.0F) ++layers[static_cast<int>(std::floor(p.z / kLayer))];
  }
  if (layers.empty()) return -1e9F;
  const auto fewer = [](const auto& l, const auto& r) { return l.second < r.second; };
  return (std::max_element(layers.begin(), layers.end(), fewer)->first + 0.5F) * kLayer;
}

Surfaces readStreet(const Arguments& a) {
  constexpr float kGround = 0.2F, kLane = 2.5F, kSideMin = 4.5F, kSideMax = 8.0F, kAboveSensor = 0.5F;  // m
  const auto source = rosbag_tests::openScans(a.scans);
  rosbag_tests::PosedScan scan;
  Surfaces surfaces;
  for (int i = 0; source->next(scan); ++i) {
    if (i % a.step != 0) continue;
    std::cerr << "\rscan " << i + 1 << " of " << source->size() << std::flush;
    const auto n = static_cast<Eigen::Index>(scan.cloud.size());
    Eigen::Matrix3Xf points(3, n);
    for (Eigen::Index j = 0; j < n; ++j) points.col(j) = scan.cloud[j].getVector3fMap();
    const Eigen::Matrix3Xf sensor = Eigen::Matrix3Xf::Zero(3, 1);
    const Eigen::ArrayXf incidence = cloudIncidence(points, sensor, a.cloud),
                         ranges = cloudRanges(points, sensor);
    const float ground = groundHeight(scan.cloud);
    for (Eigen::Index j = 0; j < n; ++j) {
      const float across = std::abs(points(1, j)), height = points(2, j);
      const bool low = std::abs(height - ground) < kGround;
      const char* name = low && across < kLane                           ? "road"
                         : low && across > kSideMin && across < kSideMax ? "roadside"
                         : height > kAboveSensor                         ? "facades"
                                                                         : nullptr;
      if (name != nullptr) surfaces[name].push_back({ranges[j], incidence[j], scan.cloud[j].intensity, i});
    }
  }
  std::cerr << '\n';
  return surfaces;
}

// ------------------------------------------------------------------------------------------------ judgement

// Takes the scans of the first part away from the surfaces and fits the models to those of the reference.
Calibration train(const Arguments& a, Surfaces& surfaces) {
  int last = 0;
  for (const auto& [name, samples] : surfaces) {
    for (const Sample& s : samples) last = std::max(last, s.scan);
  }
  const double end = a.train * (last + 1);
  std::vector<Sample> training;
  for (const std::string& name : a.reference) {
    if (surfaces.count(name) == 0)
      throw po::error("--reference is " + name + ", which is none of the surfaces");
  }
  for (auto& [name, samples] : surfaces) {
    const auto rest = std::stable_partition(samples.begin(), samples.end(),
                                            [end](const Sample& s) { return s.scan < end; });
    if (std::count(a.reference.begin(), a.reference.end(), name) > 0) {
      training.insert(training.end(), samples.begin(), rest);
    }
    samples.erase(samples.begin(), rest);
  }
  std::vector<std::string> problems;
  Calibration calibration = calibrate(training, a.fit, &problems);
  for (const std::string& problem : problems) std::cerr << problem << '\n';
  calibration.reference = "first part of the recording";
  return calibration;
}

// Reflectivities of one surface, by model; only of samples that all models have a value for.
using Reflectivities = std::map<ModelType, std::vector<float>>;

Reflectivities judge(const Calibration& calibration, const std::vector<Sample>& samples) {
  Reflectivities result;
  for (const Sample& s : samples) {
    std::map<ModelType, float> values;
    for (const ModelType type : kModelTypes) {
      if (!calibration.has(type)) continue;
      const Response f = calibration.at(type, s.range, s.incidence);
      if (!f.inside) break;
      values[type] = s.intensity / f.intensity;
    }
    if (values.count(ModelType::kLut) == 0) continue;
    for (const auto& [type, value] : values) result[type].push_back(value);
  }
  return result;
}

double mean(const std::vector<float>& values) {
  double sum = 0.0;
  for (const float v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

void print(const Calibration& calibration, const Surfaces& surfaces, const std::string& histograms) {
  std::map<std::string, Reflectivities> judged;
  std::printf("%-12s %-6s %9s %8s %8s %8s %6s\n", "surface", "model", "samples", "covered", "mean", "sd/mean",
              "modes");
  for (const auto& [name, samples] : surfaces) {
    Reflectivities& r = judged[name] = judge(calibration, samples);
    for (const auto& [type, values] : r) {
      std::printf("%-12s %-6s %9zu %6.1f %% %8.3f %7.1f %% %6d\n", name.c_str(), toString(type),
                  values.size(),
                  100.0 * static_cast<double>(values.size()) / static_cast<double>(samples.size()),
                  mean(values), 100.0 * coefficientOfVariation(values), modes(values));
    }
  }
  std::printf("\n%-26s", "overlap of histograms");
  for (const ModelType type : kModelTypes) std::printf(" %8s", toString(type));
  for (auto a = judged.begin(); a != judged.end(); ++a) {
    for (auto b = std::next(a); b != judged.end(); ++b) {
      std::printf("\n%-12s  %-12s", a->first.c_str(), b->first.c_str());
      for (const ModelType type : kModelTypes)
        std::printf(" %6.1f %%", 100.0 * overlap(a->second[type], b->second[type]));
    }
  }
  std::printf("\n");
  if (histograms.empty()) return;
  mapping_common::writeFile(histograms, [&judged](std::ostream& out) {
    constexpr std::size_t kBins = 350;
    constexpr double kMax = 3.5;
    out << "surface,model,reflectivity,share\n";
    for (const auto& [name, reflectivities] : judged) {
      for (const auto& [type, values] : reflectivities) {
        const std::vector<double> shares = histogram(values, 0.0, kMax, kBins);
        for (std::size_t i = 0; i < kBins; ++i) {
          out << name << ',' << toString(type) << ',' << (i + 0.5) * kMax / kBins << ',' << shares[i] << '\n';
        }
      }
    }
  });
}

/// False if help was asked for and printed. Throws po::error or std::invalid_argument for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  const auto with_default = [](auto* value) { return po::value(value)->default_value(*value); };
  po::options_description all("Options");
  all.add_options()("help,h", "print this")("calibration", po::value(&a.calibration),
                                            "file that calibrate wrote")(
      "world", po::value(&a.world), "YAML file of the world")("sensor", po::value(&a.sensor),
                                                              "YAML file of a planar sensor")(
      "seed", with_default(&a.seed), "of the simulation's noise")("bag", po::value(&a.bag), "recording")(
      "topic", po::value(&a.topic)->default_value("scan"), "its LaserScan with intensities")(
      "surface", po::value(&a.surfaces)->multitoken(), "NAME:FIRST:LAST, beams that are on it")(
      "reference", po::value(&a.reference)->multitoken(), "surfaces that the models are fitted to")(
      "scans", po::value(&a.scans), "3D scans: NNNN.bin[.xz], PCD, UOS, or an OctoMap .graph file")(
      "train", with_default(&a.train), "share of the scans that the models are fitted to")(
      "step", with_default(&a.step), "take each N-th scan")("range-cell", with_default(&a.fit.range_cell),
                                                            "m, samples are summed up in cells")(
      "normal-incidence", po::value<double>()->default_value(15.0)->notifier([&a](double degrees) {
        a.fit.normal_incidence = degrees * M_PI / 180.0;
      }),
      "deg, up to which the range model is fitted")(
      "max-edge", with_default(&a.fit.max_edge), "cells, wider gaps aren't interpolated across; 0: all are")(
      "neighbors", with_default(&a.cloud.neighbors), "points that a normal is estimated from")(
      "radius", with_default(&a.cloud.radius), "m, those farther away are left out")(
      "leaf", with_default(&a.cloud.leaf), "m, voxels that a cloud is thinned to for normals; 0: not")(
      "save", po::value(&a.save), "write the calibration to this file")(
      "histograms", po::value(&a.histograms), "write them to this CSV file");
  po::variables_map values;
  po::store(po::parse_command_line(
                argc, argv, all, po::command_line_style::unix_style ^ po::command_line_style::allow_guessing),
            values);
  if (values.count("help")) {
    std::cout << kUsage << '\n' << all;
    return false;
  }
  po::notify(values);
  if ((a.world.empty() ? 0 : 1) + (a.bag.empty() ? 0 : 1) + (a.scans.empty() ? 0 : 1) != 1) {
    throw po::error("one of --world, --bag and --scans is needed");
  }
  if (!a.world.empty() && (a.sensor.empty() || a.calibration.empty())) {
    throw po::error("--world needs --sensor and --calibration");
  }
  if (!a.bag.empty() && a.surfaces.empty()) throw po::error("--bag needs --surface");
  if (!(a.train > 0.0 && a.train < 1.0)) throw po::error("--train must be in (0, 1)");
  if (a.step < 1) throw po::error("--step must be at least 1");
  if (!a.scans.empty() && a.reference.empty()) a.reference = {"facades"};
  if (a.calibration.empty() && a.reference.empty()) throw po::error("--reference or --calibration is needed");
  a.fit.range_step = 0.5 * a.fit.range_cell;
  a.fit.validate();
  a.cloud.validate();
  return true;
}

void evaluate(const Arguments& a) {
  Surfaces surfaces = !a.world.empty() ? simulateSurfaces(a) : !a.bag.empty() ? readBag(a) : readStreet(a);
  const Calibration calibration = a.calibration.empty() ? train(a, surfaces) : loadCalibration(a.calibration);
  if (!a.save.empty()) saveCalibration(calibration, a.save);
  print(calibration, surfaces, a.histograms);
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  try {
    if (parse(argc, argv, arguments)) evaluate(arguments);
    return 0;
  } catch (const po::error& e) {
    std::cerr << "evaluate_calibration: " << e.what() << "\n\n"
              << kUsage << "See evaluate_calibration --help\n";
    return 2;
  } catch (const std::exception& e) {
    std::cerr << "\nevaluate_calibration: " << e.what() << '\n';
    return 1;
  }
}
