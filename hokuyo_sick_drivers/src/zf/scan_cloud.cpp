// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/zf/scan_cloud.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "voxel_grid.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kFar = 1e4, kOffsetStep = 1e3;  // m
constexpr std::uint64_t kCellsPerPoint = 64;
constexpr std::uint64_t kMaxBytes = std::numeric_limits<std::uint32_t>::max();  // of a message's array

std::uint32_t packColour(const ScanPoint& point) {
  return std::uint32_t{point.r} << 16U | std::uint32_t{point.g} << 8U | point.b;
}

}  // namespace

std::vector<std::pair<std::string, std::uint32_t>> ScanCloud::fields() const {
  std::vector<std::pair<std::string, std::uint32_t>> fields = {{"x", 0}, {"y", 4}, {"z", 8}};
  if (has_intensity) fields.emplace_back("intensity", 12);
  if (has_colour) fields.emplace_back("rgb", has_intensity ? 16 : 12);
  return fields;
}

CloudBuilder::CloudBuilder(const ScanInfo& info, const CloudOptions& options)
    : info_(info), options_(options) {
  cloud_.has_intensity = info.has_intensity;
  cloud_.has_colour = info.has_colour;
  cloud_.pose = info.pose;
  if (options.voxel > 0.0) {
    voxels_ = std::make_unique<VoxelGrid>(options.voxel);
    return;
  }
  grid_ = options.grid && info.hasGrid();
  const std::uint64_t cells = grid_ ? std::uint64_t{info.rows} * info.columns : info.points;
  if (grid_ && cells > kCellsPerPoint * info.points + options.sparse_cells) {
    throw std::runtime_error("has a grid of " + std::to_string(info.rows) + " x " +
                             std::to_string(info.columns) + " cells for " + std::to_string(info.points) +
                             " points: read it without its grid");
  }
  if (cells > kMaxBytes / cloud_.pointStep()) {
    throw std::runtime_error("has " + std::to_string(cells) +
                             " points, which are more than 4 GiB, the limit of a cloud: use voxels");
  }
  if (!grid_) {
    cloud_.data.reserve(cells * cloud_.pointStep());
    return;
  }
  cloud_.width = info.columns;
  cloud_.height = info.rows;
  cloud_.data.resize(cells * cloud_.pointStep());
  for (std::size_t i = 0; i < cells; ++i) {
    write(cloud_.data.data() + i * cloud_.pointStep(), Eigen::Vector3f::Constant(kNan), kNan, 0);
  }
}

CloudBuilder::~CloudBuilder() = default;

void CloudBuilder::chooseOffset(const Eigen::Vector3d& first) {
  has_offset_ = true;
  if (options_.offset_mode == CloudOptions::Offset::kGiven) cloud_.offset = options_.offset;
  if (options_.offset_mode == CloudOptions::Offset::kAutomatic && first.cwiseAbs().maxCoeff() > kFar) {
    cloud_.offset = (first / kOffsetStep).array().round() * kOffsetStep;
  }
}

void CloudBuilder::add(const std::vector<ScanPoint>& points) {
  const std::uint32_t step = cloud_.pointStep();
  for (const ScanPoint& point : points) {
    if (!point.valid) {
      ++cloud_.missing;
      continue;
    }
    Eigen::Vector3d position(point.x, point.y, point.z);
    if (options_.apply_pose) position = info_.pose * position;
    if (!has_offset_) chooseOffset(position);
    position -= cloud_.offset;

    if (voxels_) {
      if (voxels_->add(position, point)) {
        ++cloud_.points;
      } else {
        ++cloud_.outside;
      }
      continue;
    }
    std::size_t at = cloud_.data.size();
    if (grid_) {
      if (point.row >= cloud_.height || point.column >= cloud_.width) {
        ++cloud_.outside;
        continue;
      }
      at = (std::size_t{point.row} * cloud_.width + point.column) * step;
      float taken;
      std::memcpy(&taken, cloud_.data.data() + at, sizeof taken);
      if (!std::isnan(taken)) {
        ++cloud_.duplicates;
        continue;
      }
    } else {
      cloud_.data.resize(at + step);
    }
    write(cloud_.data.data() + at, position.cast<float>(), point.intensity, packColour(point));
    ++cloud_.points;
  }
}

void CloudBuilder::write(std::uint8_t* to, const Eigen::Vector3f& position, float intensity,
                         std::uint32_t rgb) const {
  std::memcpy(to, position.data(), 12);
  if (cloud_.has_intensity) std::memcpy(to + 12, &intensity, 4);
  if (cloud_.has_colour) std::memcpy(to + cloud_.pointStep() - 4, &rgb, 4);
}

ScanCloud CloudBuilder::finish() {
  if (voxels_) {
    const std::size_t step = cloud_.pointStep();
    if (voxels_->size() > kMaxBytes / step) {
      throw std::runtime_error("fills " + std::to_string(voxels_->size()) +
                               " voxels, which are more than 4 GiB, the limit of a cloud: use larger ones");
    }
    cloud_.data.resize(voxels_->size() * step);
    for (std::size_t i = 0; i < voxels_->size(); ++i) {
      const VoxelGrid::Mean mean = voxels_->mean(i);
      write(cloud_.data.data() + i * step, mean.position.cast<float>(), mean.intensity, mean.rgb);
    }
  }
  if (!grid_) cloud_.width = static_cast<std::uint32_t>(cloud_.data.size() / cloud_.pointStep());
  if (options_.apply_pose) cloud_.pose.setIdentity();
  cloud_.pose.translate(cloud_.offset);
  return std::move(cloud_);
}

void writePcd(std::ostream& out, const ScanCloud& cloud) {
  std::string names, sizes, types, counts;
  for (const auto& field : cloud.fields()) {
    names += ' ' + field.first;
    sizes += " 4";
    types += " F";  // rgb, too, as PCL has it
    counts += " 1";
  }
  const Eigen::Vector3d t = cloud.pose.translation();
  const Eigen::Quaterniond q(cloud.pose.linear());
  const auto precision = out.precision(17);
  out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS" << names << "\nSIZE" << sizes
      << "\nTYPE" << types << "\nCOUNT" << counts << "\nWIDTH " << cloud.width << "\nHEIGHT " << cloud.height
      << "\nVIEWPOINT " << t.x() << ' ' << t.y() << ' ' << t.z() << ' ' << q.w() << ' ' << q.x() << ' '
      << q.y() << ' ' << q.z() << "\nPOINTS " << std::uint64_t{cloud.width} * cloud.height
      << "\nDATA binary\n";
  out.precision(precision);
  out.write(reinterpret_cast<const char*>(cloud.data.data()),
            static_cast<std::streamsize>(cloud.data.size()));
}

}  // namespace hokuyo_sick_drivers
