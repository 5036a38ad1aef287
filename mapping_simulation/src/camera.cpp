// SPDX-License-Identifier: BSD-3-Clause
//
// Rays go through the corners of pixels. Where the four corners of a pixel are on one surface, the samples of
// the pixel lie between them; at edges each sample is a ray of its own.
#include <mapping_simulation/camera.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <thread>

namespace mapping_simulation {
namespace {

class Renderer {
 public:
  Renderer(const CameraModel& camera, const Scene& scene, const Eigen::Isometry3d& pose)
      : camera_(camera), scene_(scene), pose_(pose) {}

  // Light of the pixels of some rows.
  void render(int first_row, int last_row, Color* out) const {
    std::vector<Corner> upper = cornersOf(first_row), lower;
    for (int row = first_row; row < last_row; ++row) {
      lower = cornersOf(row + 1);
      for (int column = 0; column < camera_.width; ++column) {
        const Corner* const corners[] = {&upper[column], &upper[column + 1], &lower[column],
                                         &lower[column + 1]};
        *out++ = onOneSurface(corners) ? interpolated(corners) : sampled(column, row);
      }
      upper.swap(lower);
    }
  }

 private:
  struct Corner {
    SurfacePoint point;
    Color light = Color::Zero();
    double footprint = 0.0;  // of a sample, m
  };

  Corner look(double u, double v) const {
    Corner corner;
    const Ray ray{pose_.translation(), pose_.linear() * camera_.direction(u, v)};
    corner.point = scene_.look(ray);
    if (corner.point) {
      // A sample is longer than wide on a slanted surface: the geometric mean of both.
      const double slant = std::max(1e-3, -corner.point.normal.dot(ray.direction));
      corner.footprint = corner.point.range / (camera_.fx * camera_.samples * std::sqrt(slant));
      corner.light = scene_.lightAt(corner.point.position, corner.point.normal);
    } else {
      corner.light = scene_.sky(ray.direction);
    }
    return corner;
  }
  std::vector<Corner> cornersOf(int row) const {
    std::vector<Corner> corners(camera_.width + 1);
    for (int column = 0; column <= camera_.width; ++column) corners[column] = look(column - 0.5, row - 0.5);
    return corners;
  }

  static bool onOneSurface(const Corner* const corners[4]) {
    const SurfacePoint& first = corners[0]->point;
    return std::all_of(corners + 1, corners + 4, [&first](const Corner* corner) {
      const SurfacePoint& point = corner->point;
      return point.shape == first.shape &&
             (point.shape < 0 || (point.face == first.face && point.normal.dot(first.normal) > 0.9));
    });
  }

  Color interpolated(const Corner* const corners[4]) const {
    const int n = camera_.samples;
    Color sum = Color::Zero();
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        const double x = (j + 0.5) / n, y = (i + 0.5) / n;
        const double weights[] = {(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y};
        Eigen::Vector2d uv = Eigen::Vector2d::Zero();
        Color light = Color::Zero();
        double footprint = 0.0;
        for (int k = 0; k < 4; ++k) {
          uv += weights[k] * corners[k]->point.uv;
          light += static_cast<float>(weights[k]) * corners[k]->light;
          footprint += weights[k] * corners[k]->footprint;
        }
        sum += shade(corners[0]->point.shape, uv, footprint, light);
      }
    }
    return sum / static_cast<float>(n * n);
  }
  Color sampled(int column, int row) const {
    const int n = camera_.samples;
    Color sum = Color::Zero();
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        const Corner at = look(column - 0.5 + (j + 0.5) / n, row - 0.5 + (i + 0.5) / n);
        sum += shade(at.point.shape, at.point.uv, at.footprint, at.light);
      }
    }
    return sum / static_cast<float>(n * n);
  }
  Color shade(int shape, const Eigen::Vector2d& uv, double footprint, const Color& light) const {
    if (shape < 0) return light;
    const Appearance seen = scene_.shape(shape).texture.seenAt(uv, footprint);
    return seen.albedo * light + seen.glow;
  }

  const CameraModel& camera_;
  const Scene& scene_;
  const Eigen::Isometry3d& pose_;
};

}  // namespace

Image renderImage(const CameraModel& camera, const Scene& scene, const Eigen::Isometry3d& pose,
                  std::uint64_t seed, int threads) {
  const Renderer renderer(camera, scene, pose);
  std::vector<Color> light(static_cast<std::size_t>(camera.width) * camera.height);
  const int parts =
      std::clamp<int>(threads > 0 ? threads : std::thread::hardware_concurrency(), 1, camera.height);
  const auto renderPart = [&](int part) {
    const int first = camera.height * part / parts, last = camera.height * (part + 1) / parts;
    renderer.render(first, last, light.data() + static_cast<std::size_t>(first) * camera.width);
  };
  std::vector<std::thread> others;
  for (int part = 1; part < parts; ++part) others.emplace_back(renderPart, part);
  renderPart(0);
  for (std::thread& other : others) other.join();

  const auto brightness = [](const Color& c) { return 0.299f * c[0] + 0.587f * c[1] + 0.114f * c[2]; };
  double gain = 255.0 * camera.exposure;
  if (!(camera.exposure > 0.0)) {
    double sum = 0.0;
    for (const Color& c : light) sum += brightness(c);
    gain = 110.0 * light.size() / std::max(sum, 1e-6);
  }
  std::mt19937_64 random(seed);
  std::normal_distribution<float> grain(0.5f,
                                        static_cast<float>(camera.noise));  // rounds to the nearest, too
  Image image{camera.width, camera.height, camera.color ? 3 : 1, {}};
  image.data.reserve(light.size() * image.channels);
  const auto put = [&](float value) {
    const float noisy = static_cast<float>(gain) * value + (camera.noise > 0.0 ? grain(random) : 0.5f);
    image.data.push_back(static_cast<std::uint8_t>(std::clamp(noisy, 0.0f, 255.0f)));
  };
  for (const Color& c : light) {
    if (!camera.color) put(brightness(c));
    for (int i = 0; camera.color && i < 3; ++i) put(c[i]);
  }
  return image;
}

}  // namespace mapping_simulation
