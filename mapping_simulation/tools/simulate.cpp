// SPDX-License-Identifier: BSD-3-Clause
//
// Drives simulated laser scanners and cameras through a world and writes what they see as a bag, or as
// images.
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <mapping_simulation/ros/simulation_bag.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace po = boost::program_options;

namespace {

const char kUsage[] =
    "Usage: simulate --world WORLD.yaml --sensor SENSOR.yaml [--sensor ...] [--out OUT.bag] [--images DIR] "
    "[options]\n"
    "\n"
    "Drives simulated laser scanners and cameras through a world and writes a bag: LaserScan or PointCloud2 "
    "with\n"
    "intensities, Image and CameraInfo, /tf, /tf_static, /odom, /ground_truth and /clock; or the images of "
    "each camera\n"
    "as DIR/TOPIC/000000.png and so on, and its poses as DIR/TOPIC.tum.\n";

struct Arguments {
  std::string world, trajectory, out, images, ground_truth;
  std::vector<std::string> sensors;
  double duration = 0.0;
  std::uint64_t seed = 0;
  std::uint32_t world_seed = 0;
  bool no_map_tf = false;
  mapping_simulation::SimulationBagOptions options;
};

/// False if help was asked for and printed. Throws po::error for wrong usage.
bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto& o = a.options;
  auto add = all.add_options();
  add("help,h", "print this");
  add("world", po::value(&a.world)->required(), "YAML file of the world");
  add("sensor", po::value(&a.sensors)->required(), "YAML file of a sensor; once for each sensor");
  add("out", po::value(&a.out), "bag to write");
  add("images", po::value(&a.images), "folder for the images of cameras; made if it isn't there");
  add("trajectory", po::value(&a.trajectory),
      "path of base_link: a .tum file, or YAML with the key trajectory; "
      "by default that of the world file");
  add("duration", po::value(&a.duration), "s; by default once along the trajectory");
  add("seed", po::value(&a.seed)->default_value(a.seed), "of all noise; the same seed gives the same bag");
  add("world-seed", po::value(&a.world_seed)->default_value(a.world_seed),
      "of what the world leaves to chance: stains, houses, windows");
  add("ground-truth", po::value(&a.ground_truth), "file for the true poses of base_link, in TUM format");
  add("start", po::value(&o.start_time)->default_value(o.start_time), "ROS time at the start (s)");
  add("clock-rate", po::value(&o.clock_rate)->default_value(o.clock_rate), "rate of /clock (Hz), 0: none");
  add("odometry-rate", po::value(&o.odometry_rate)->default_value(o.odometry_rate),
      "rate of /tf, /odom and /ground_truth (Hz)");
  add("translation-noise", po::value(&o.odometry_noise.translation)->default_value(0.0, "0"),
      "drift of the odometry (m per square root of a metre)");
  add("rotation-noise", po::value(&o.odometry_noise.rotation)->default_value(0.0, "0"),
      "drift of the odometry (rad per square root of a metre, or of a radian turned)");
  add("no-map-tf", po::bool_switch(&a.no_map_tf), "leave map -> odom to a SLAM node");
  const auto given = mapping_common::parseArguments(argc, argv, kUsage, all);
  if (!given) return false;
  if (a.out.empty() && a.images.empty()) throw po::error("give --out, --images or both");
  if (given->count("duration") && !(a.duration > 0.0 && a.duration < 1e7)) {
    throw po::error("--duration must be in (0, 1e7) s");
  }
  if (!(o.odometry_noise.translation >= 0.0 && o.odometry_noise.rotation >= 0.0)) {
    throw po::error("--translation-noise and --rotation-noise must not be negative");
  }
  o.map_to_odom = !a.no_map_tf;
  return true;
}

// Files of the images and poses of each camera.
class ImageFolders {
 public:
  explicit ImageFolders(const std::string& folder) : folder_(folder) {}

  void write(const std::string& topic, const mapping_simulation::Sweep& sweep) {
    const std::string name = folder_ + "/" + topic;
    std::vector<mapping_simulation::TimedPose>& poses = poses_[name];
    if (poses.empty()) std::filesystem::create_directories(name);
    std::ostringstream file;
    file << name << '/' << std::setw(6) << std::setfill('0') << poses.size() << ".png";
    const mapping_simulation::Image& image = sweep.image;
    cv::Mat bgr(image.height, image.width, CV_8UC(image.channels),
                const_cast<std::uint8_t*>(image.data.data()));
    if (image.channels == 3) cv::cvtColor(bgr.clone(), bgr, cv::COLOR_RGB2BGR);
    if (!cv::imwrite(file.str(), bgr)) throw std::runtime_error(file.str() + " can't be written");
    poses.push_back({sweep.stamp, sweep.pose});
  }
  void writePoses() const {
    for (const auto& [name, poses] : poses_) mapping_simulation::writeTum(name + ".tum", poses);
  }

 private:
  std::string folder_;
  std::map<std::string, std::vector<mapping_simulation::TimedPose>> poses_;
};

void run(const Arguments& a) {
  mapping_simulation::Simulation simulation{
      mapping_simulation::loadWorld(a.world, a.world_seed),
      mapping_simulation::loadTrajectory(a.trajectory.empty() ? a.world : a.trajectory),
      {},
      a.duration,
      a.seed};
  for (const std::string& sensor : a.sensors)
    simulation.sensors.push_back(mapping_simulation::loadSensor(sensor));
  if (!(simulation.duration > 0.0)) {
    simulation.duration = simulation.trajectory.endTime() - simulation.trajectory.startTime();
    if (!(simulation.duration > 0.0))
      throw std::runtime_error("the trajectory has a single pose: give --duration");
  }
  mapping_common::Progress progress("simulate");
  std::size_t sweeps = 0;
  ImageFolders folders(a.images);
  const auto watch = [&](const mapping_simulation::SensorConfig& sensor,
                         const mapping_simulation::Sweep& sweep) {
    ++sweeps;
    if (!a.images.empty() && sensor.type == mapping_simulation::SensorConfig::Type::kCamera)
      folders.write(sensor.topic, sweep);
    const double elapsed = sweep.stamp + sensor.sweepDuration() - simulation.startTime();
    progress.show(static_cast<int>(100.0 * elapsed / simulation.duration + 1e-6), " % of ",
                  simulation.duration, " s");
  };
  if (a.out.empty())
    mapping_simulation::simulate(simulation, watch);
  else
    mapping_simulation::writeSimulationBag(a.out, simulation, a.options, watch);
  folders.writePoses();
  if (!a.ground_truth.empty()) {
    mapping_simulation::writeTum(
        a.ground_truth,
        mapping_simulation::groundTruth(simulation, a.options.odometry_rate, a.options.start_time));
  }
  progress.say(sweeps, " sweeps in ", simulation.duration, " s -> ", a.out, a.out.empty() ? "" : " ",
               a.images);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "simulate", kUsage, parse, run);
}
