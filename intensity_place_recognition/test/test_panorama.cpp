// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/slowness.h>

#include <chrono>
#include <cmath>
#include <ctime>

#include "../src/fast_atan2.h"
#include "intensity_place_recognition/panorama.h"

namespace intensity_place_recognition {
namespace {

PanoramaOptions sphere(int width, int height) {
  PanoramaOptions options;
  options.width = width;
  options.height = height;
  options.min_elevation = -M_PI / 2.0;
  options.max_elevation = M_PI / 2.0;
  return options;
}

Eigen::Vector3d toDirection(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

pcl::PointXYZI pointAt(const Eigen::Vector3d& position, float intensity) {
  pcl::PointXYZI p;
  p.getVector3fMap() = position.cast<float>();
  p.intensity = intensity;
  return p;
}

// A dark room 8 m around the sensor with round lights of 3 degrees, whose middle is known.
Cloud withLights(const std::vector<Eigen::Vector3d>& lights) {
  Cloud cloud;
  const double step = 0.002;
  for (double elevation = -M_PI / 2.0; elevation < M_PI / 2.0; elevation += step) {
    for (double azimuth = -M_PI; azimuth < M_PI; azimuth += step / std::max(0.05, std::cos(elevation))) {
      const Eigen::Vector3d direction = toDirection(azimuth, elevation);
      double light = 0.0;
      for (const Eigen::Vector3d& middle : lights) {
        const double angle = std::acos(std::min(1.0, direction.dot(middle))) / 0.05;
        light += std::exp(-0.5 * angle * angle);
      }
      cloud.push_back(pointAt(8.0 * direction, static_cast<float>(light)));
    }
  }
  return cloud;
}

// The intensities' centroid around a pixel, in an image that wraps around.
cv::Point2d centroid(const cv::Mat1f& image, const cv::Point2d& about, int reach) {
  double sum = 0.0, x = 0.0, y = 0.0;
  const int u = static_cast<int>(std::lround(about.x)), v = static_cast<int>(std::lround(about.y));
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) {
      if (std::hypot(u + dx - about.x, v + dy - about.y) > reach) continue;
      const float value = image(v + dy, (u + dx + image.cols) % image.cols);
      sum += value;
      x += value * (u + dx);
      y += value * (v + dy);
    }
  }
  return {x / sum, y / sum};
}

TEST(Panorama, ShowsDirectionsToATenthOfAPixel) {
  const std::vector<Eigen::Vector3d> lights = {toDirection(0.003, 0.002), toDirection(1.234, 0.2),
                                               toDirection(-2.0, -0.3), toDirection(M_PI - 0.004, 0.1)};
  const Panorama panorama = toPanorama(withLights(lights), sphere(720, 360));
  for (const Eigen::Vector3d& light : lights) {
    const cv::Point2d expected = panorama.pixelOf(light);
    EXPECT_LT((panorama.directionOf(expected) - light).norm(), 1e-9);
    // A circle on the sphere is wider where the panorama is stretched, its middle stays but for that.
    cv::Point2d at = centroid(panorama.intensity, expected, 24);
    EXPECT_NEAR(expected.x, at.x, 0.1) << light.transpose();
    EXPECT_NEAR(expected.y, at.y, 0.1) << light.transpose();
  }
  EXPECT_NEAR(8.0f, panorama.range(180, 360), 1e-4);
  // Forward is in the middle, left to the left, up at the top.
  EXPECT_NEAR(359.5, panorama.pixelOf({1.0, 0.0, 0.0}).x, 1e-9);
  EXPECT_NEAR(179.5, panorama.pixelOf({1.0, 1.0, 0.0}).y, 1e-9);
  EXPECT_NEAR(179.5, panorama.pixelOf({0.0, 1.0, 0.0}).x, 1e-9);
  EXPECT_NEAR(89.5, panorama.pixelOf({1.0, 0.0, 1.0}).y, 1e-9);
}

TEST(Panorama, ViewsAreThoseOfACamera) {
  const std::vector<Eigen::Vector3d> lights = {toDirection(0.1, 0.05), toDirection(M_PI - 0.2, -0.2),
                                               toDirection(0.4, M_PI / 2.0 - 0.3)};
  const Panorama panorama = toPanorama(withLights(lights), sphere(1440, 720), 20);
  const auto turn = [](double angle, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  };
  const Eigen::Matrix3d up = turn(-M_PI / 2.0, Eigen::Vector3d::UnitY());
  const std::vector<Eigen::Matrix3d> rotations = {Eigen::Matrix3d::Identity(),
                                                  turn(M_PI, Eigen::Vector3d::UnitZ()), up};
  for (std::size_t i = 0; i < lights.size(); ++i) {
    RectilinearView view;
    view.width = 300;
    view.height = 200;
    view.vertical_fov = 1.2;
    view.rotation = rotations[i];
    const Panorama image = rectilinear(panorama, view);
    EXPECT_EQ(cv::Size(300, 200), image.mask.size());
    // The pinhole camera's own equation.
    const Eigen::Vector3d ray = rotations[i].transpose() * lights[i];
    const double fx = 150.0 / std::tan(0.5 * view.horizontal_fov),
                 fy = 100.0 / std::tan(0.5 * view.vertical_fov);
    const cv::Point2d expected(149.5 - fx * ray.y() / ray.x(), 99.5 - fy * ray.z() / ray.x());
    // How far the light is from where it should be, by the differences of brightness around it.
    const auto light = [&](double u, double v) {
      const Eigen::Vector3d seen(1.0, (149.5 - u) / fx, (99.5 - v) / fy);
      const double angle = std::acos(std::min(1.0, seen.normalized().dot(ray))) / 0.05;
      return std::exp(-0.5 * angle * angle);
    };
    Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
    Eigen::Vector2d sums = Eigen::Vector2d::Zero();
    const int x = static_cast<int>(std::lround(expected.x)), y = static_cast<int>(std::lround(expected.y));
    for (int v = y - 12; v <= y + 12; ++v) {
      for (int u = x - 12; u <= x + 12; ++u) {
        const Eigen::Vector2d slope(0.5 * (light(u + 1, v) - light(u - 1, v)),
                                    0.5 * (light(u, v + 1) - light(u, v - 1)));
        squares += slope * slope.transpose();
        sums += slope * (light(u, v) - image.intensity(v, u));
        EXPECT_NEAR(light(u, v), image.intensity(v, u), 0.02);
      }
    }
    EXPECT_LT((squares.inverse() * sums).norm(), 0.1) << "pixels, view " << i;
  }
}

TEST(Panorama, AveragesWhatAPixelSees) {
  PanoramaBuilder builder(sphere(36, 18));
  const std::vector<pcl::PointXYZI> points = {pointAt({4.0, 0.1, 0.1}, 1.0f), pointAt({6.0, 0.1, 0.1}, 4.0f),
                                              pointAt({4.0, 0.1, 0.1}, 1.0f), pointAt({0.5, 0.0, 0.0}, 9.0f),
                                              pointAt({NAN, 0.1, 0.1}, 9.0f), pointAt({4.0, 0.1, 0.1}, NAN)};
  for (const auto& point : points) builder.add(&point, 1);
  EXPECT_EQ(3u, builder.points());
  const Panorama panorama = builder.panorama();
  EXPECT_EQ(1, cv::countNonZero(panorama.mask));
  EXPECT_NEAR(2.0f, panorama.intensity(8, 17), 1e-5);
  EXPECT_NEAR(14.0f / 3.0f, panorama.range(8, 17), 0.01);
}

TEST(Panorama, FillsTheHolesOfSparseLidars) {
  PanoramaBuilder builder(sphere(36, 18));
  for (int x = 0; x < 36; x += 2) {
    for (const int y : {3, 6, 14}) {
      const double azimuth = M_PI - (x + 0.5) / 36.0 * 2.0 * M_PI,
                   elevation = M_PI / 2.0 - (y + 0.5) / 18.0 * M_PI;
      const auto point = pointAt((y + 1.0) * toDirection(azimuth, elevation), static_cast<float>(y));
      builder.add(&point, 1);
    }
  }
  const Panorama panorama = builder.panorama(3);
  EXPECT_EQ(255, panorama.mask(3, 0));
  EXPECT_EQ(128, panorama.mask(4, 0));
  EXPECT_NEAR(4.0f, panorama.intensity(4, 0), 1e-5);
  EXPECT_NEAR(6.0f, panorama.range(5, 35), 1e-4);  // over the edge
  EXPECT_EQ(0, panorama.mask(10, 0)) << "a hole of seven rows is filled";
  EXPECT_EQ(0, panorama.mask(2, 0));
  EXPECT_EQ(3 * 18, cv::countNonZero(builder.panorama().mask));
}

TEST(Panorama, TenMillionPointsTakeTwoSeconds) {
  std::vector<pcl::PointXYZI> chunk(100000);
  for (std::size_t i = 0; i < chunk.size(); ++i)
    chunk[i] = pointAt(10.0 * toDirection(i * 0.0001, std::sin(i * 0.001)), 1.0f);
  PanoramaBuilder builder(sphere(4096, 2048));
  const std::clock_t start = std::clock();
  for (int i = 0; i < 100; ++i) builder.add(chunk.data(), chunk.size());
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  EXPECT_EQ(10000000u, builder.points());
  RecordProperty("milliseconds", static_cast<int>(1e3 * seconds));
  EXPECT_LT(seconds, 2.0 * mapping_common::kSlowness) << "of processor time";
}

TEST(Panorama, RefusesOptionsThatWontDo) {
  PanoramaOptions options;
  options.max_elevation = options.min_elevation;
  EXPECT_THROW(PanoramaBuilder{options}, std::invalid_argument);
  RectilinearView view;
  view.horizontal_fov = 4.0;
  EXPECT_THROW(rectilinear(toPanorama({}, {}), view), std::invalid_argument);
}

TEST(Panorama, OfImagesGivesThePointsOfItsPixels) {
  PanoramaOptions options;
  cv::Mat1f intensity(32, 256), range(32, 256);
  for (int y = 0; y < range.rows; ++y) {
    for (int x = 0; x < range.cols; ++x) {
      range(y, x) = 5.0f + 0.1f * static_cast<float>(x) + static_cast<float>(y);
      intensity(y, x) = static_cast<float>(x + y);
    }
  }
  range(3, 4) = 0.0f;
  range(5, 6) = NAN;
  range(7, 8) = INFINITY;
  range(9, 10) = -1.0f;
  const Cloud cloud = toCloud(intensity, range, options);
  EXPECT_EQ(range.total() - 4, cloud.size());
  options.width = range.cols;
  options.height = range.rows;
  const Panorama again = toPanorama(cloud, options);
  for (int y = 0; y < range.rows; ++y) {
    for (int x = 0; x < range.cols; ++x) {
      if (!(range(y, x) > 0.0f && std::isfinite(range(y, x)))) {
        EXPECT_EQ(0, again.mask(y, x));
        continue;
      }
      EXPECT_NEAR(range(y, x), again.range(y, x), 1e-3) << x << ' ' << y;
      EXPECT_EQ(intensity(y, x), again.intensity(y, x)) << x << ' ' << y;
    }
  }
  EXPECT_THROW(toCloud(intensity, cv::Mat1f(32, 255, 1.0f), options), std::invalid_argument);
}

TEST(FastAtan2, IsThatOfTheLibrary) {
  for (int i = -1000; i <= 1000; ++i) {
    const float angle = static_cast<float>(M_PI) * static_cast<float>(i) / 1000.0f;
    for (const float range : {1e-3f, 1.0f, 300.0f}) {
      const float x = range * std::cos(angle), y = range * std::sin(angle);
      ASSERT_NEAR(std::atan2(y, x), fastAtan2(y, x), 2e-6f) << x << ' ' << y;
    }
  }
  EXPECT_EQ(0.0f, fastAtan2(0.0f, 0.0f));
  EXPECT_FLOAT_EQ(static_cast<float>(-M_PI), fastAtan2(-0.0f, -1.0f));
}

}  // namespace
}  // namespace intensity_place_recognition
