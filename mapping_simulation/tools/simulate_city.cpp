// SPDX-License-Identifier: BSD-3-Clause
//
// Visits the places of a city by day and by night with scanners and cameras, and writes what they see.
#include <mapping_common/files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <mapping_simulation/city.h>
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/sensors.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;
namespace fs = std::filesystem;
using namespace mapping_simulation;

namespace {

const char kUsage[] =
    "Usage: simulate_city --sensor SENSOR.yaml [--sensor ...] --out DIR   [options]\n"
    "\n"
    "Visits the places of a city, whose streets are built alike, by day and by night in random order, and "
    "writes for\n"
    "each sensor the folder DIR/TOPIC of clouds (000000.bin, float32 x y z intensity, in the sensor's frame) "
    "or images\n"
    "(000000.png) with poses.txt (a row a visit: its number and the 3 x 4 pose of the sensor), and "
    "DIR/visits.csv.\n";

struct Arguments {
  std::vector<std::string> sensors;
  std::string out;
  CityOptions city;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  CityOptions& c = a.city;
  add("help,h", "print this");
  add("sensor", po::value(&a.sensors)->required()->composing(),
      "scanner or camera, a YAML file as in config/simulator");
  add("out", po::value(&a.out)->required(), "folder to write");
  add("places", po::value(&c.places)->default_value(c.places), "of four kinds of street in turn");
  add("visits", po::value(&c.visits)->default_value(c.visits), "of each place, by day and by night in turn");
  add("shift", po::value(&c.shift)->default_value(c.shift),
      "m, of visits from the middle of a place, at most");
  add("occupancy", po::value(&c.occupancy)->default_value(c.occupancy),
      "part of the parking lots with a car, another one at each visit");
  add("seed", po::value(&c.seed)->default_value(c.seed), "of the city and of all noise");
  add("along", po::bool_switch(&c.along),
      "visits look along the road or back, within 10 degrees, as cars do, not anywhere");
  add("by-day", po::bool_switch(&c.by_day), "all visits are by day");
  bool in_order = false;
  add("in-order", po::bool_switch(&in_order), "all places in turn, then all again");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  c.random_order = !in_order;
  return true;
}

void writeCloud(const SensorConfig& sensor, const Sweep& sweep, const std::string& path) {
  mapping_common::writeFile(path, [&](std::ostream& out) {
    for (const pcl::PointXYZI& p : toPosedScan(sensor, sweep).cloud) {
      const float values[] = {p.x, p.y, p.z, p.intensity};
      if (std::isfinite(p.x)) out.write(reinterpret_cast<const char*>(values), sizeof(values));
    }
  });
}

void writeImage(const Image& image, const std::string& path) {
  cv::Mat picture(image.height, image.width, CV_8UC(image.channels),
                  const_cast<std::uint8_t*>(image.data.data()));
  if (image.channels == 3) cv::cvtColor(picture.clone(), picture, cv::COLOR_RGB2BGR);
  if (!cv::imwrite(path, picture)) throw std::runtime_error(path + " can't be written");
}

void run(const Arguments& a) {
  const std::vector<CityVisit> visits = cityVisits(a.city);
  std::vector<SensorConfig> sensors;
  std::set<std::string> topics;
  for (const std::string& file : a.sensors) {
    sensors.push_back(loadSensor(file));
    if (sensors.back().type == SensorConfig::Type::kPlanar)
      throw std::runtime_error(file + ": a planar scanner, where lidars and cameras visit the city");
    if (!topics.insert(sensors.back().topic).second)
      throw std::runtime_error(file + ": two sensors with the topic " + sensors.back().topic);
    fs::create_directories(a.out + '/' + sensors.back().topic);
  }
  std::vector<std::ostringstream> poses(sensors.size());
  std::ostringstream table;
  table << "number,place,visit,night\n";
  mapping_common::Progress progress("simulate_city");
  for (std::size_t i = 0; i < visits.size(); ++i) {
    const CityVisit& visit = visits[i];
    table << i << ',' << visit.place << ',' << visit.visit << ',' << visit.night << '\n';
    const World world = cityAt(a.city, visit);
    const Trajectory base({TimedPose{0.0, visit.pose}});
    for (std::size_t s = 0; s < sensors.size(); ++s) {
      const Sweep seen = sweep(sensors[s], world, base, 0.0, a.city.seed + 1000003u * i + s);
      std::ostringstream name;
      name << a.out << '/' << sensors[s].topic << '/' << std::setw(6) << std::setfill('0') << i;
      if (sensors[s].type == SensorConfig::Type::kCamera)
        writeImage(seen.image, name.str() + ".png");
      else
        writeCloud(sensors[s], seen, name.str() + ".bin");
      poses[s] << i << std::setprecision(12);
      const Eigen::Matrix4d pose = seen.pose.matrix();
      for (int k = 0; k < 12; ++k) poses[s] << ' ' << pose(k / 4, k % 4);
      poses[s] << '\n';
    }
    progress.show(i + 1, " of ", visits.size(), " visits");
  }
  for (std::size_t s = 0; s < sensors.size(); ++s)
    mapping_common::writeFile(a.out + '/' + sensors[s].topic + "/poses.txt",
                              [&](std::ostream& out) { out << poses[s].str(); });
  mapping_common::writeFile(a.out + "/visits.csv", [&](std::ostream& out) { out << table.str(); });
  progress.say(visits.size(), " visits -> ", a.out);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "simulate_city", kUsage, parse, run);
}
