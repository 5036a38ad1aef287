// SPDX-License-Identifier: BSD-3-Clause
//
// Calibrates a laser scanner's intensities from a bag in which it observes a reference surface.
#include <laser_intensity_calib/calibration_file.h>
#include <laser_intensity_calib/ros/bag_samples.h>
#include <laser_intensity_calib/ros/report.h>
#include <mapping_common/figures.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/date_time/posix_time/posix_time.hpp>
#include <boost/program_options.hpp>
#include <filesystem>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
using namespace laser_intensity_calib;
using mapping_common::addOption;

namespace {

const char kUsage[] =
    "Usage: calibrate --bag FILE --topic TOPIC --out CALIBRATION.yaml [--report FOLDER] [options]\n"
    "\n"
    "Learns from a recording what intensity the scanner reports of a reference surface (such as white paper, "
    "or a\n"
    "white wall) over range and angle of incidence. The surface should be seen from all distances and angles "
    "that\n"
    "matter. Which beams are on it say --beams, --box and --plane; those that are in all of them are "
    "taken.\n";

struct Arguments {
  std::string bag, out, report, scanner, reference;
  BagSamplesOptions samples;
  FitOptions fit;
};

std::vector<double> numbers(const std::string& option, const std::string& text, char separator,
                            std::size_t count) {
  std::vector<double> values;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) {
    std::size_t end = 0;
    try {
      values.push_back(std::stod(part, &end));
    } catch (const std::exception&) {
      end = std::string::npos;
    }
    if (end != part.size()) break;
  }
  if (values.size() != count ||
      std::count(text.begin(), text.end(), separator) + 1 != static_cast<long>(count)) {
    throw po::error("--" + option + " is " + text + ", expected are " + std::to_string(count) +
                    " numbers, separated by '" + separator + "'");
  }
  return values;
}

void readRegion(const std::string& beams, const std::string& box, Region& region) {
  if (!beams.empty()) {
    const auto range = numbers("beams", beams, ':', 2);
    if (!(range[0] >= 0.0 && range[1] >= range[0] && range[1] < 1e9)) {
      throw po::error("--beams is " + beams + ", expected is FIRST:LAST, 0 <= FIRST <= LAST");
    }
    region.first_beam = static_cast<int>(range[0]);
    region.last_beam = static_cast<int>(range[1]);
  }
  if (box.empty()) return;
  const auto corners = numbers("box", box, ',', 6);
  region.box.emplace(Eigen::Vector3d(corners[0], corners[1], corners[2]),
                     Eigen::Vector3d(corners[3], corners[4], corners[5]));
  if (region.box->isEmpty()) throw po::error("--box is " + box + ", expected is min < max along each axis");
}

/// False if help was asked for and printed. Throws po::error or std::invalid_argument for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  std::string beams, box;
  po::options_description main("Options"), region("Reference surface"), normals("Normals"), fit("Models");
  main.add_options()("help,h", "print this")("bag", po::value(&a.bag)->required(), "recording")(
      "topic", po::value(&a.samples.topic)->required(), "LaserScan or PointCloud2 with intensities")(
      "out", po::value(&a.out)->required(), "calibration to write")("report", po::value(&a.report),
                                                                    "folder for figures and their data")(
      "scanner", po::value(&a.scanner), "its name, for file and figures; by default bag and topic")(
      "reference", po::value(&a.reference)->default_value("white paper"), "the surface's name, for the same");
  addOption(main, "step", a.samples, "step");
  region.add_options()("beams", po::value(&beams), "FIRST:LAST beam of a scan that is on it")(
      "box", po::value(&box), "XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX it is in, m")(
      "frame", po::value(&a.samples.region.frame),
      "frame of the box, found by the bag's tf; by default that of the sensor")(
      "plane", po::bool_switch(&a.samples.region.plane),
      "the largest plane (of a scan: straight line) is it");
  addOption(region, "plane-tolerance", a.samples, "plane_tolerance");
  addOption(normals, "accumulate", a.samples, "accumulate");
  for (const char* name : {"range_noise", "min_window", "min_length"})
    addOption(normals, name, a.samples.scan, name);
  for (const char* name : {"neighbors", "radius", "leaf"}) addOption(normals, name, a.samples.cloud, name);
  addOption(normals, "max-error", a.samples.scan, "max_error_deg");
  fit.add_options()("offsets", po::bool_switch(&a.fit.offsets),
                    "of a cloud with the field ring: fit what each laser adds to its intensities");
  for (const char* name : {"range_cell", "incidence_cell", "min_samples", "max_edge", "range_step",
                           "incidence_step", "normal_incidence", "max_degree", "folds"})
    addOption(fit, name, a.fit, name);
  po::options_description all;
  all.add(main).add(region).add(normals).add(fit);
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  a.samples.cloud.max_error = a.samples.scan.max_error;
  readRegion(beams, box, a.samples.region);
  mapping_common::validate(a.samples);
  mapping_common::validate(a.fit);
  return true;
}

// Before hours of work are lost.
void checkFolderOf(const std::string& file) {
  const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
  if (!std::filesystem::is_directory(folder)) {
    throw std::runtime_error(file + " can't be written: there is no folder " + folder.string());
  }
}

std::string whyNoSample(const BagSamplesReport& report) {
  const std::string all = "none of the " + std::to_string(report.messages) + " messages ";
  if (report.messages == 0) return "the topic has no message";
  if (report.malformed == report.messages) return all + "can be used: " + report.last_problem;
  if (report.malformed + report.without_transform == report.messages) {
    return all + "has a transform into --frame: " + report.last_problem;
  }
  if (report.in_region == 0) {
    return "no beam is on the reference surface: check --beams, --box, --frame, --plane. Ranges out of the "
           "scan's "
           "range_min to range_max don't count";
  }
  return "none of the " + std::to_string(report.in_region) +
         " beams on the reference surface has an angle of incidence: their neighbours must be on it, too. "
         "See "
         "--range-noise, --min-window, --min-length, --max-error; for clouds --neighbors, --radius, --leaf, "
         "--accumulate";
}

// Where many samples have the greatest intensity, the scanner saturates, or gives no intensities at all.
void checkIntensities(const std::vector<Sample>& samples) {
  const auto brighter = [](const Sample& a, const Sample& b) { return a.intensity < b.intensity; };
  const float max = std::max_element(samples.begin(), samples.end(), brighter)->intensity;
  if (!(max > 0.0F)) {
    throw std::runtime_error(
        "all intensities on the reference surface are 0: the scanner or its driver doesn't give any");
  }
  const auto at_max =
      std::count_if(samples.begin(), samples.end(), [max](const Sample& s) { return s.intensity == max; });
  const double share = static_cast<double>(at_max) / static_cast<double>(samples.size());
  if (share > 0.01) {
    std::cerr << "calibrate: " << 100.0 * share << " % of the samples have the intensity " << max
              << ": if the scanner is saturated there, take a darker reference surface; if all are the same, "
                 "it gives "
                 "no intensities\n";
  }
}

Calibration fit(const Arguments& a, const std::vector<Sample>& samples, std::vector<std::string>& problems) {
  mapping_common::Progress progress("calibrate");
  const auto show = [&](double share) { progress.show("fitting ", static_cast<int>(100.0 * share), " %"); };
  try {
    return calibrate(samples, a.fit, &problems, show);
  } catch (const std::invalid_argument& e) {
    throw std::runtime_error(
        std::string(e.what()) + ". " + std::to_string(samples.size()) +
        " samples are too few, or too much alike: observe the surface from more distances and at "
        "more angles, mark more of the beams, or try a lower --min-samples or larger --range-cell "
        "and --incidence-cell");
  }
}

void run(const Arguments& a) {
  checkFolderOf(a.out);
  BagSamplesReport report;
  mapping_common::Progress progress("calibrate");
  const std::vector<Sample> samples = collectSamples(a.bag, a.samples, report, [&progress](double share) {
    progress.show("reading ", static_cast<int>(100.0 * share), " %");
  });
  progress.say(report.messages, " messages, ", report.in_region, " beams on the surface, of which ",
               report.without_incidence, " without an angle of incidence");
  if (report.malformed + report.without_transform > 0) {
    std::cerr << "calibrate: left out " << report.malformed << " malformed messages and "
              << report.without_transform << " without a transform: " << report.last_problem << '\n';
  }
  if (samples.empty()) throw std::runtime_error(whyNoSample(report));
  checkIntensities(samples);
  const auto of_another = [&samples](const Sample& s) { return s.laser != samples[0].laser; };
  if (a.fit.offsets && std::none_of(samples.begin(), samples.end(), of_another))
    throw std::runtime_error(
        "all samples are of one laser: --offsets is for clouds of several, with the field ring");
  std::vector<std::string> problems;
  Calibration calibration = fit(a, samples, problems);
  calibration.reference = a.reference;
  calibration.date =
      boost::posix_time::to_iso_extended_string(boost::posix_time::second_clock::universal_time()) + "Z";
  calibration.source = std::filesystem::path(a.bag).filename().string() + ' ' + a.samples.topic;
  calibration.scanner = a.scanner.empty() ? "scanner of " + calibration.source : a.scanner;
  saveCalibration(calibration, a.out);

  Coverage coverage;
  if (calibration.has(ModelType::kLut))
    coverage = coverageOf(sumUp(samples, a.fit), calibration.table, a.fit);
  coverage.advice.insert(coverage.advice.begin(), problems.begin(), problems.end());
  std::cout << describe(calibration, coverage);
  if (!a.report.empty()) {
    writeReport(a.report, samples, calibration, a.fit);
    mapping_common::drawFigures("calibrate", "plot_calibration.py", {a.out, a.report});
  }
  std::cerr << "calibrate: wrote " << a.out << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "calibrate", kUsage, parse, run);
}
