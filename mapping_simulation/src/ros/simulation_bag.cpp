// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/posed_scan.h>
#include <mapping_simulation/ros/conversions.h>
#include <mapping_simulation/ros/simulation_bag.h>
#include <mapping_simulation/ros/stamped.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosgraph_msgs/Clock.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <system_error>
#include <vector>

namespace mapping_simulation {
namespace {

geometry_msgs::Vector3 makeVector(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 message;
  message.x = v.x();
  message.y = v.y();
  message.z = v.z();
  return message;
}

// As image_transport does: beside the image's topic.
std::string infoTopic(const SensorConfig& sensor) {
  return sensor.topic.substr(0, sensor.topic.rfind('/') + 1) + "camera_info";
}

void check(const Simulation& simulation, const SimulationBagOptions& options) {
  const auto require = [](bool good, const std::string& what) {
    if (!good) throw std::invalid_argument(what);
  };
  require(simulation.duration > 0.0, "the duration must be positive");
  require(options.start_time > 0.0 && options.start_time + simulation.duration < 4e9,
          "the start time must be in (0, 4e9) s");
  require(options.clock_rate >= 0.0 && options.clock_rate <= 1e4,
          "the rate of /clock must be in [0, 10000] Hz");
  require(options.odometry_rate > 0.0 && options.odometry_rate <= 1e4,
          "the rate of the odometry must be in (0, 10000] Hz");
  std::set<std::string> topics{"/clock", "/tf", "/tf_static", "/odom", "/ground_truth"};
  std::set<std::string> frames{"map", "odom", "base_link"};
  for (const SensorConfig& sensor : simulation.sensors) {
    std::vector<std::string> of_sensor{sensor.topic};
    if (sensor.type == SensorConfig::Type::kCamera) of_sensor.push_back(infoTopic(sensor));
    for (const std::string& topic : of_sensor)
      require(topics.insert("/" + topic).second, "topic '" + topic + "' is taken twice");
    require(frames.insert(sensor.frame_id).second, "frame '" + sensor.frame_id + "' is taken twice");
  }
}

// Writes what happens between sweeps up to a time, in order.
class Recorder {
 public:
  Recorder(rosbag::Bag& bag, const Simulation& simulation, const SimulationBagOptions& options)
      : bag_(bag),
        simulation_(simulation),
        options_(options),
        odometry_(driftingOdometry(simulation.trajectory, options.odometry_noise, options.odometry_rate,
                                   simulation.duration, simulation.seed)) {
    const ros::Time start(options.start_time);
    std::vector<geometry_msgs::TransformStamped> mounts;
    for (const SensorConfig& sensor : simulation.sensors)
      mounts.push_back(makeTransform(start, "base_link", sensor.frame_id, sensor.mount));
    writeStaticTransforms(bag, start, mounts);
  }

  // `elapsed`: s since the start.
  void recordUntil(double elapsed) {
    while (true) {
      const double odometry = odometry_count_ / options_.odometry_rate;
      const double clock = options_.clock_rate > 0.0 ? clock_count_ / options_.clock_rate : INFINITY;
      if (std::min(odometry, clock) > elapsed + 1e-9) return;
      if (clock <= odometry) {
        rosgraph_msgs::Clock message;
        message.clock = ros::Time(options_.start_time + clock);
        bag_.write("/clock", message.clock, message);
        ++clock_count_;
      } else {
        writePoses(odometry);
        ++odometry_count_;
      }
    }
  }

  void record(const SensorConfig& sensor, Sweep sweep) {
    const double begin = sweep.stamp - simulation_.startTime(), end = begin + sensor.sweepDuration();
    recordUntil(end);
    sweep.stamp = options_.start_time + begin;
    const ros::Time receipt(options_.start_time + end);
    if (sensor.type == SensorConfig::Type::kPlanar) {
      bag_.write("/" + sensor.topic, receipt, toLaserScan(toPlanarScan(sensor, sweep), sensor.frame_id));
    } else if (sensor.type == SensorConfig::Type::kCamera) {
      const std_msgs::Header header = makeHeader(ros::Time(sweep.stamp), sensor.frame_id);
      bag_.write("/" + infoTopic(sensor), receipt, toCameraInfo(sensor.camera, header));
      bag_.write("/" + sensor.topic, receipt, toImage(sweep.image, header));
    } else {
      bag_.write("/" + sensor.topic, receipt,
                 toPointCloud2(toPosedScan(sensor, sweep).cloud,
                               makeHeader(ros::Time(sweep.stamp), sensor.frame_id), sensor.timeIncrement()));
    }
  }

 private:
  void writePoses(double elapsed) {
    const double stamp = options_.start_time + elapsed, time = simulation_.startTime() + elapsed;
    const Eigen::Isometry3d truth = simulation_.trajectory.at(time), odom = odometry_.at(time);
    tf2_msgs::TFMessage tf;
    if (options_.map_to_odom)
      tf.transforms.push_back(makeTransform(ros::Time(stamp), "map", "odom", truth * odom.inverse()));
    tf.transforms.push_back(makeTransform(ros::Time(stamp), "odom", "base_link", odom));
    bag_.write("/tf", ros::Time(stamp), tf);
    writeOdometry("/odom", "odom", stamp, odometry_, time);
    writeOdometry("/ground_truth", "map", stamp, simulation_.trajectory, time);
  }

  void writeOdometry(const std::string& topic, const std::string& frame, double stamp,
                     const Trajectory& trajectory, double time) {
    const double step = 1.0 / options_.odometry_rate;
    const Eigen::Isometry3d pose = trajectory.at(time), motion = pose.inverse() * trajectory.at(time + step);
    const Eigen::AngleAxisd turn(motion.linear());
    nav_msgs::Odometry message;
    message.header = makeHeader(ros::Time(stamp), frame);
    message.child_frame_id = "base_link";
    message.pose.pose = toPose(pose);
    message.twist.twist.linear = makeVector(motion.translation() / step);
    message.twist.twist.angular = makeVector(turn.angle() / step * turn.axis());
    bag_.write(topic, ros::Time(stamp), message);
  }

  rosbag::Bag& bag_;
  const Simulation& simulation_;
  const SimulationBagOptions& options_;
  Trajectory odometry_;
  std::size_t clock_count_ = 0, odometry_count_ = 0;
};

}  // namespace

std::size_t writeSimulationBag(const std::string& file, const Simulation& simulation,
                               const SimulationBagOptions& options,
                               const std::function<void(const SensorConfig&, const Sweep&)>& watch) {
  check(simulation, options);
  const std::string part = file + ".part";
  std::size_t sweeps = 0;
  try {
    rosbag::Bag bag(part, rosbag::bagmode::Write);
    Recorder recorder(bag, simulation, options);
    simulate(simulation, [&](const SensorConfig& sensor, const Sweep& sweep) {
      recorder.record(sensor, sweep);
      ++sweeps;
      if (watch) watch(sensor, sweep);
    });
    recorder.recordUntil(simulation.duration);
    bag.close();
    std::filesystem::rename(part, file);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
    throw;
  }
  return sweeps;
}

sensor_msgs::Image toImage(const Image& image, const std_msgs::Header& header) {
  sensor_msgs::Image message;
  message.header = header;
  message.width = image.width;
  message.height = image.height;
  message.encoding = image.channels == 3 ? "rgb8" : "mono8";
  message.step = image.width * image.channels;
  message.data = image.data;
  return message;
}

sensor_msgs::CameraInfo toCameraInfo(const CameraModel& camera, const std_msgs::Header& header) {
  sensor_msgs::CameraInfo message;
  message.header = header;
  message.width = camera.width;
  message.height = camera.height;
  message.distortion_model = "plumb_bob";
  message.D.assign(5, 0.0);
  message.K = {camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0};
  message.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  message.P = {camera.fx, 0.0,       camera.cx, -camera.fx * camera.baseline,  //
               0.0,       camera.fy, camera.cy, 0.0,                           //
               0.0,       0.0,       1.0,       0.0};
  return message;
}

sensor_msgs::LaserScan toLaserScan(const PlanarScan& scan, const std::string& frame_id) {
  sensor_msgs::LaserScan message;
  message.header = makeHeader(ros::Time(scan.stamp), frame_id);
  message.angle_min = static_cast<float>(scan.angle_min);
  message.angle_max = static_cast<float>(scan.angle_max);
  message.angle_increment = static_cast<float>(scan.angle_increment);
  message.time_increment = static_cast<float>(scan.time_increment);
  message.scan_time = static_cast<float>(scan.scan_time);
  message.range_min = static_cast<float>(scan.range_min);
  message.range_max = static_cast<float>(scan.range_max);
  message.ranges = scan.ranges;
  message.intensities = scan.intensities;
  return message;
}

}  // namespace mapping_simulation
