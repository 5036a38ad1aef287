// SPDX-License-Identifier: BSD-3-Clause
//
// How well models of intensity tell surfaces apart (thesis, 3.5.1, Fig. 3.4): reflectivities of surfaces that
// are seen at many distances and angles of incidence, for the raw, the range and the lookup table model.
#include <laser_intensity_calib/calibration_file.h>
#include <laser_intensity_calib/ros/bag_samples.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/evaluations/calibration_evaluation.h>

#include <boost/program_options.hpp>
#include <cstdio>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
using namespace laser_intensity_calib;
using rosbag_tests::Surfaces;

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

struct Arguments {
  std::string calibration, world, sensor, bag, topic, scans, histograms, save;
  std::vector<std::string> surfaces, reference;
  double train = 0.5;
  int step = 1;
  std::uint64_t seed = 1;
  FitOptions fit;
  CloudIncidenceOptions cloud;
};

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
      "step", with_default(&a.step), "take each N-th scan")(
      "offsets", po::bool_switch(&a.fit.offsets), "of 3D scans: fit what each laser adds to its intensities")(
      "save", po::value(&a.save), "write the calibration to this file")(
      "histograms", po::value(&a.histograms), "write them to this CSV file");
  for (const char* name : {"range_cell", "incidence_cell", "normal_incidence", "max_edge"})
    mapping_common::addOption(all, name, a.fit, name);
  for (const char* name : {"neighbors", "radius", "leaf"})
    mapping_common::addOption(all, name, a.cloud, name);
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
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
  mapping_common::validate(a.fit);
  mapping_common::validate(a.cloud);
  return true;
}

Surfaces readSurfaces(const Arguments& a) {
  if (!a.world.empty())
    return rosbag_tests::simulateSurfaces(mapping_simulation::loadWorld(a.world),
                                          mapping_simulation::loadTrajectory(a.world),
                                          mapping_simulation::loadSensor(a.sensor), a.seed, a.cloud);
  if (!a.bag.empty()) return readBag(a);
  const auto source = rosbag_tests::openScans(a.scans);
  mapping_common::Progress progress("evaluate_calibration");
  return readStreet(*source, a.step, a.cloud,
                    [&](int scan) { progress.show("scan ", scan + 1, " of ", source->size()); });
}

Calibration train(const Arguments& a, Surfaces& surfaces) {
  std::vector<std::string> problems;
  Calibration calibration = rosbag_tests::trainOnFirstPart(surfaces, a.reference, a.train, a.fit, &problems);
  for (const std::string& problem : problems) std::cerr << problem << '\n';
  calibration.reference = "first part of the recording";
  return calibration;
}

void evaluate(const Arguments& a) {
  Surfaces surfaces = readSurfaces(a);
  const Calibration calibration = a.calibration.empty() ? train(a, surfaces) : loadCalibration(a.calibration);
  if (!a.save.empty()) saveCalibration(calibration, a.save);
  const rosbag_tests::JudgedSurfaces judged = rosbag_tests::judge(calibration, surfaces);
  printJudgement(std::cout, judged);
  if (!a.histograms.empty()) writeHistograms(a.histograms, judged);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "evaluate_calibration", kUsage, parse, evaluate);
}
