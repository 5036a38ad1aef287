// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/panorama.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "directions.h"

namespace intensity_place_recognition {
namespace {

// Fills holes along the columns of an image from what is above and below.
void fillColumns(Panorama& p, int largest) {
  for (int x = 0; x < p.mask.cols; ++x) {
    for (int y = 0, last = -1; y < p.mask.rows; ++y) {
      if (p.mask(y, x) == 0) continue;
      const int hole = y - last - 1;
      for (int h = last + 1; last >= 0 && hole <= largest && h < y; ++h) {
        const float t = static_cast<float>(h - last) / static_cast<float>(y - last);
        p.intensity(h, x) = (1.0f - t) * p.intensity(last, x) + t * p.intensity(y, x);
        p.range(h, x) = (1.0f - t) * p.range(last, x) + t * p.range(y, x);
        p.mask(h, x) = 128;
      }
      last = y;
    }
  }
}

// The same along rows, which wrap around.
void fillRows(Panorama& p, int largest) {
  const int width = p.mask.cols;
  const auto wrapped = [width](int x) { return x >= width ? x - width : x; };
  for (int y = 0; y < p.mask.rows; ++y) {
    const std::vector<std::uint8_t> seen(p.mask[y], p.mask[y] + width);
    const int first =
        static_cast<int>(std::find_if(seen.begin(), seen.end(), [](int m) { return m != 0; }) - seen.begin());
    for (int x = first + 1, last = first; x <= first + width && first < width; ++x) {
      if (seen[wrapped(x)] == 0) continue;
      const int hole = x - last - 1;
      for (int h = last + 1; hole <= largest && h < x; ++h) {
        const float t = static_cast<float>(h - last) / static_cast<float>(x - last);
        const int a = wrapped(last), b = wrapped(x), at = wrapped(h);
        p.intensity(y, at) = (1.0f - t) * p.intensity(y, a) + t * p.intensity(y, b);
        p.range(y, at) = (1.0f - t) * p.range(y, a) + t * p.range(y, b);
        p.mask(y, at) = 128;
      }
      last = x;
    }
  }
}

}  // namespace

cv::Point2d Panorama::pixelOf(const Eigen::Vector3d& point) const {
  const double azimuth = std::atan2(point.y(), point.x());
  const double elevation = std::atan2(point.z(), point.head<2>().norm());
  double x = (M_PI - azimuth) / (2.0 * M_PI) * options.width - 0.5;
  if (x >= options.width - 0.5) x -= options.width;
  return {x, (options.max_elevation - elevation) / (options.max_elevation - options.min_elevation) *
                     options.height -
                 0.5};
}

Eigen::Vector3d Panorama::directionOf(const cv::Point2d& pixel) const {
  const double azimuth = M_PI - (pixel.x + 0.5) / options.width * 2.0 * M_PI;
  const double elevation = options.max_elevation -
                           (pixel.y + 0.5) / options.height * (options.max_elevation - options.min_elevation);
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

PanoramaBuilder::PanoramaBuilder(const PanoramaOptions& options)
    : options_(mapping_common::validate(options)),
      pixels_(static_cast<std::size_t>(options.height) * options.width) {}

void PanoramaBuilder::add(const pcl::PointXYZI* points, std::size_t count) {
  const float per_column = static_cast<float>(options_.width / (2.0 * M_PI));
  const float per_row =
      static_cast<float>(options_.height / (options_.max_elevation - options_.min_elevation));
  const float top = static_cast<float>(options_.max_elevation), pi = static_cast<float>(M_PI);
  const float nearest = static_cast<float>(options_.min_range * options_.min_range);
  const float farthest = static_cast<float>(options_.max_range * options_.max_range);
  forEachDirection(points, count, [&](const pcl::PointXYZI& p, const Directions& at, int i) {
    const float squared = at.squared[i], row = (top - at.elevation[i]) * per_row;
    if (!(squared >= nearest && squared <= farthest && squared > 0.0f) ||
        !(row >= 0.0f && row < static_cast<float>(options_.height)))
      return;
    const int y = static_cast<int>(row);
    const int x = std::min(static_cast<int>((pi - at.azimuth[i]) * per_column), options_.width - 1);
    Pixel& pixel = pixels_[static_cast<std::size_t>(y) * options_.width + x];
    const float weight = 1.0f / static_cast<float>(++pixel.count);
    pixel.intensity += (p.intensity - pixel.intensity) * weight;
    pixel.range += (std::sqrt(squared) - pixel.range) * weight;
    ++points_;
  });
}

Panorama PanoramaBuilder::panorama(int largest_hole) const {
  const int height = options_.height, width = options_.width;
  Panorama p{options_, cv::Mat1f(height, width), cv::Mat1f(height, width), cv::Mat1b(height, width)};
  for (int y = 0; y < height; ++y) {
    const Pixel* row = &pixels_[static_cast<std::size_t>(y) * width];
    for (int x = 0; x < width; ++x) {
      p.intensity(y, x) = row[x].intensity;
      p.range(y, x) = row[x].range;
      p.mask(y, x) = row[x].count > 0 ? 255 : 0;
    }
  }
  if (largest_hole > 0) {
    fillColumns(p, largest_hole);
    fillRows(p, largest_hole);
  }
  return p;
}

Panorama toPanorama(const Cloud& cloud, const PanoramaOptions& options, int largest_hole) {
  PanoramaBuilder builder(options);
  builder.add(cloud);
  return builder.panorama(largest_hole);
}

Cloud toCloud(const cv::Mat1f& intensity, const cv::Mat1f& range, const PanoramaOptions& options) {
  if (intensity.size() != range.size())
    throw std::invalid_argument("the image of intensities has " + std::to_string(intensity.cols) + " x " +
                                std::to_string(intensity.rows) + " pixels, that of ranges " +
                                std::to_string(range.cols) + " x " + std::to_string(range.rows));
  Panorama panorama{options, {}, {}, {}};
  panorama.options.width = range.cols;
  panorama.options.height = range.rows;
  Cloud cloud;
  cloud.reserve(range.total());
  for (int y = 0; y < range.rows; ++y) {
    for (int x = 0; x < range.cols; ++x) {
      if (!(range(y, x) > 0.0f && std::isfinite(range(y, x)))) continue;
      pcl::PointXYZI p;
      p.getVector3fMap() = range(y, x) * panorama.directionOf(cv::Point2d(x, y)).cast<float>();
      p.intensity = intensity(y, x);
      cloud.push_back(p);
    }
  }
  return cloud;
}

Panorama rectilinear(const Panorama& panorama, const RectilinearView& view) {
  if (view.width < 1 || view.height < 1 || !(view.horizontal_fov > 0.0 && view.horizontal_fov < M_PI) ||
      !(view.vertical_fov > 0.0 && view.vertical_fov < M_PI))
    throw std::invalid_argument("a rectilinear view has pixels and fields of view of less than 180 degrees");
  Panorama result{panorama.options, cv::Mat1f(view.height, view.width, 0.0f),
                  cv::Mat1f(view.height, view.width, 0.0f),
                  cv::Mat1b(view.height, view.width, std::uint8_t(0))};
  const double half_width = std::tan(0.5 * view.horizontal_fov),
               half_height = std::tan(0.5 * view.vertical_fov);
  const int width = panorama.mask.cols, height = panorama.mask.rows;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const Eigen::Vector3d ray(1.0, half_width * (1.0 - 2.0 * (x + 0.5) / view.width),
                                half_height * (1.0 - 2.0 * (y + 0.5) / view.height));
      const cv::Point2d at = panorama.pixelOf(view.rotation * ray);
      const int left = static_cast<int>(std::floor(at.x)), top = static_cast<int>(std::floor(at.y));
      float weights = 0.0f, intensity = 0.0f, range = 0.0f;
      std::uint8_t mask = 0;
      for (int v = top; v <= top + 1; ++v) {
        for (int u = left; u <= left + 1; ++u) {
          if (v < 0 || v >= height) continue;
          const int column = (u + width) % width;
          if (panorama.mask(v, column) == 0) continue;
          const float weight = static_cast<float>((1.0 - std::abs(at.x - u)) * (1.0 - std::abs(at.y - v)));
          weights += weight;
          intensity += weight * panorama.intensity(v, column);
          range += weight * panorama.range(v, column);
          mask = std::max(mask, panorama.mask(v, column));
        }
      }
      if (weights < 0.25f) continue;
      result.intensity(y, x) = intensity / weights;
      result.range(y, x) = range / weights;
      result.mask(y, x) = mask;
    }
  }
  return result;
}

}  // namespace intensity_place_recognition
