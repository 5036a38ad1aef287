// SPDX-License-Identifier: BSD-3-Clause
#include "scene.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ibuild_loop_closure {
namespace {

constexpr int kSamples = 2;  // of a pixel, in each direction

cv::Vec4f bilinear(const cv::Mat& image, float x, float y) {
  x = std::clamp(x, 0.0f, static_cast<float>(image.cols - 1));
  y = std::clamp(y, 0.0f, static_cast<float>(image.rows - 1));
  const int left = static_cast<int>(x), top = static_cast<int>(y);
  const int right = std::min(left + 1, image.cols - 1), bottom = std::min(top + 1, image.rows - 1);
  const float fx = x - left, fy = y - top;
  const auto *upper = image.ptr<cv::Vec4b>(top), *lower = image.ptr<cv::Vec4b>(bottom);
  cv::Vec4f color;
  for (int c = 0; c < 4; ++c) {
    color[c] = (1 - fy) * ((1 - fx) * upper[left][c] + fx * upper[right][c]) +
               fy * ((1 - fx) * lower[left][c] + fx * lower[right][c]);
  }
  return color;
}

// A surface in the camera's frame. For a ray q = (x, y, 1) of the camera, 1 / depth = inverse_depth . q, and
// the point on the texture is depth * across . q + left, depth * along . q + top.
struct Projected {
  Projected(const Surface& surface, const Eigen::Isometry3d& pose) : texture(surface.texture.get()) {
    const Eigen::Matrix3d to_camera = pose.linear().transpose();
    const Eigen::Vector3d offset = to_camera * (surface.corner - pose.translation());
    const Eigen::Vector3d right = to_camera * surface.right, down = to_camera * surface.down;
    const Eigen::Vector3d plane_normal = right.cross(down);
    normal = plane_normal.cast<float>();
    inverse_depth = (plane_normal / plane_normal.dot(offset)).cast<float>();
    across = right.cast<float>();
    along = down.cast<float>();
    left = static_cast<float>(-right.dot(offset));
    top = static_cast<float>(-down.dot(offset));
  }
  const Texture* texture;
  Eigen::Vector3f normal, inverse_depth, across, along;
  float left, top;
};

struct Hit {
  float depth, x, y;
  const Projected* surface;
};

cv::Vec3f skyIn(const Eigen::Vector3f& direction) {
  const float height = std::clamp(2.0f * direction.z(), 0.0f, 1.0f);
  return cv::Vec3f(232, 226, 218) * (1 - height) + cv::Vec3f(228, 190, 150) * height;
}

class Renderer {
 public:
  Renderer(const std::vector<Surface>& surfaces, double focal_length, const Eigen::Isometry3d& pose)
      : focal_length_(static_cast<float>(focal_length)), rotation_(pose.linear().cast<float>()) {
    for (const Surface& s : surfaces) surfaces_.emplace_back(s, pose);
    hits_.reserve(surfaces_.size());
  }
  cv::Vec3b color(const Eigen::Vector3f& ray) {
    findHits(ray);
    cv::Vec3f sum;
    float left = 1.0f;  // share of the light that nearer surfaces let through
    for (const Hit& hit : hits_) {
      // What a sample covers is longer than wide on a slanted surface: the geometric mean of both.
      const float slant = std::abs(hit.surface->normal.dot(ray)) / ray.norm();
      const cv::Vec4f color =
          hit.surface->texture->at(hit.x, hit.y, hit.depth / focal_length_ / std::sqrt(slant));
      for (int c = 0; c < 3; ++c) sum[c] += left * color[c];
      left *= 1.0f - color[3] / 255.0f;
      if (left < 0.004f) return sum;
    }
    return sum + left * skyIn((rotation_ * ray).normalized());
  }

 private:
  void findHits(const Eigen::Vector3f& ray) {
    hits_.clear();
    for (const Projected& s : surfaces_) {
      const float inverse = s.inverse_depth.dot(ray);
      if (!(inverse > 1e-4f)) continue;
      const float depth = 1.0f / inverse;
      const float x = depth * s.across.dot(ray) + s.left, y = depth * s.along.dot(ray) + s.top;
      if (x < 0 || y < 0 || x > s.texture->width() || y > s.texture->height()) continue;
      hits_.push_back({depth, x, y, &s});
    }
    std::sort(hits_.begin(), hits_.end(), [](const Hit& a, const Hit& b) { return a.depth < b.depth; });
  }

  const float focal_length_;
  const Eigen::Matrix3f rotation_;
  std::vector<Projected> surfaces_;
  std::vector<Hit> hits_;
};

}  // namespace

Texture::Texture(const cv::Mat& bgra, double resolution) : resolution_(static_cast<float>(resolution)) {
  if (bgra.empty() || bgra.type() != CV_8UC4)
    throw std::invalid_argument("a texture has four channels of 8 bits");
  levels_.push_back(bgra);
  while (std::min(levels_.back().cols, levels_.back().rows) > 1) {
    cv::Mat half;
    cv::pyrDown(levels_.back(), half);
    levels_.push_back(half);
  }
}

cv::Vec4f Texture::at(float x, float y, float extent) const {
  const float level =
      std::clamp(std::log2(extent * resolution_), 0.0f, static_cast<float>(levels_.size() - 1));
  const int fine = static_cast<int>(level), coarse = std::min<int>(fine + 1, levels_.size() - 1);
  const auto in = [&](int l) {
    const float scale = std::ldexp(1.0f, -l);
    return bilinear(levels_[l], (x * resolution_ - 0.5f) * scale, (y * resolution_ - 0.5f) * scale);
  };
  const float share = level - fine;
  return in(fine) * (1 - share) + in(coarse)*share;
}

cv::Mat render(const std::vector<Surface>& surfaces, const Pinhole& camera, const Eigen::Isometry3d& pose) {
  Renderer renderer(surfaces, kSamples * camera.focal_length, pose);
  cv::Mat fine(camera.size * kSamples, CV_8UC3);
  for (int v = 0; v < fine.rows; ++v) {
    for (int u = 0; u < fine.cols; ++u) {
      const double x = ((u + 0.5) / kSamples - 0.5 - camera.cx) / camera.focal_length,
                   y = ((v + 0.5) / kSamples - 0.5 - camera.cy) / camera.focal_length;
      fine.at<cv::Vec3b>(v, u) = renderer.color(Eigen::Vector3d(x, y, 1.0).cast<float>());
    }
  }
  cv::Mat image;
  cv::resize(fine, image, camera.size, 0, 0, cv::INTER_AREA);
  return image;
}

}  // namespace ibuild_loop_closure
