// SPDX-License-Identifier: BSD-3-Clause
//
// What a camera sees in the simulated street or another world, whose geometry is known.
#pragma once

#include <mapping_simulation/sensors.h>
#include <mapping_simulation/testing/worlds.h>

#include <opencv2/core.hpp>
#include <string>

namespace ibuild_loop_closure {

class SimulatedStreet {
 public:
  /// @param world_seed of the houses
  explicit SimulatedStreet(std::uint32_t world_seed = 0, const std::string& world = "street_walk")
      : world_(mapping_simulation::loadWorld(fileOf(world), world_seed)),
        walks_(mapping_simulation::loadTrajectory(fileOf(world))),
        sensor_(mapping_simulation::loadSensor(mapping_simulation::configFile("simulator/camera.yaml"))) {}

  /// 640 x 360 pixels
  mapping_simulation::CameraModel& camera() { return sensor_.camera; }
  /// Of the camera on the two walks, the second of which begins at 40 s; optical frame -> map frame.
  Eigen::Isometry3d walkAt(double time) const { return walks_.at(time) * sensor_.mount; }
  /// Looks along the street from eye height; yaw to the left, rad.
  Eigen::Isometry3d poseAt(double x, double y, double yaw) const {
    return mapping_simulation::makePose(x, y, 0.0, yaw) * sensor_.mount;
  }
  /// CV_8UC1; each has noise of its own. @param time decides on the light, and where people are
  cv::Mat imageAt(const Eigen::Isometry3d& pose, double exposure = 1.0, double time = 0.0) {
    mapping_simulation::CameraModel camera = sensor_.camera;
    camera.exposure *= exposure;
    const auto image = mapping_simulation::renderImage(camera, world_.at(time), pose, ++images_);
    return cv::Mat(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data.data())).clone();
  }
  /// Along the optical axis, m, of what a pixel shows.
  double depthAt(const Eigen::Isometry3d& pose, const cv::Point2f& pixel) const {
    const Eigen::Vector3d ray = sensor_.camera.direction(pixel.x, pixel.y);
    return ray.z() * world_.cast({pose.translation(), pose.linear() * ray}, 0.0).range;
  }

 private:
  static std::string fileOf(const std::string& world) {
    return mapping_simulation::configFile("worlds/" + world + ".yaml");
  }

  mapping_simulation::World world_;
  mapping_simulation::Trajectory walks_;
  mapping_simulation::SensorConfig sensor_;
  std::uint64_t images_ = 0;
};

}  // namespace ibuild_loop_closure
