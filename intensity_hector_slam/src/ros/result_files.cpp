// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_hector_slam/ros/result_files.h"

#include <intensity_hector_slam/map_image.h>
#include <mapping_common/files.h>

#include <algorithm>
#include <cstdio>
#include <iomanip>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace intensity_hector_slam {
namespace {

void writePose(std::ostream& out, double stamp, const Pose& pose) {
  char line[200];
  std::snprintf(line, sizeof(line), "%.9f %.9f %.9f 0 0 0 %.12f %.12f\n", stamp, pose.x(), pose.y(),
                std::sin(0.5 * pose.z()), std::cos(0.5 * pose.z()));
  out << line;
}

// Of the cells shown, the topmost row first.
template <class T, class Value>
cv::Mat_<T> draw(const GridMap& map, const Value& value) {
  const Eigen::AlignedBox2i box = shownCells(map);
  cv::Mat_<T> image(box.sizes().y() + 1, box.sizes().x() + 1);
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.cols; ++column) {
      image(row, column) = value(box.min().x() + column, box.max().y() - row);
    }
  }
  return image;
}

}  // namespace

void writeTum(const std::string& path, const BagResult& result) {
  mapping_common::writeFile(path, [&](std::ostream& out) {
    for (const auto& entry : result.entries) {
      if (entry.result.status == Status::kRejected || entry.result.status == Status::kEmpty) continue;
      writePose(out, entry.stamp, entry.result.pose);
    }
  });
}

void writeG2o(const std::string& path, const std::vector<Edge>& edges) {
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << std::setprecision(12);
    std::map<std::uint32_t, Pose> vertices;
    for (const Edge& edge : edges) {
      vertices[edge.from.id] = edge.from.pose;
      vertices[edge.to.id] = edge.to.pose;
    }
    for (const auto& [id, pose] : vertices) {
      out << "VERTEX_SE2 " << id << ' ' << pose.x() << ' ' << pose.y() << ' ' << pose.z() << '\n';
    }
    for (const Edge& edge : edges) {
      out << "EDGE_SE2 " << edge.from.id << ' ' << edge.to.id << ' ' << edge.transform.x() << ' '
          << edge.transform.y() << ' ' << edge.transform.z();
      const Eigen::Matrix3d information = informationAtEnd(edge);
      for (int row = 0; row < 3; ++row) {
        for (int column = row; column < 3; ++column) out << ' ' << information(row, column);
      }
      out << '\n';
    }
  });
}

void writeOccupancy(const std::string& directory, const GridMap& map) {
  mapping_common::writeMapImage(directory + "/map.pgm", imageOf(map));
}

void writeReflectivity(const std::string& path, const GridMap& map) {
  const auto hit = [&map](int x, int y) { return map.count(x, y) > 0; };
  const cv::Mat_<std::uint8_t> values = draw<std::uint8_t>(map, [&](int x, int y) {
    return cv::saturate_cast<std::uint8_t>(255.0f * map.cell(x, y).reflectivity);
  });
  const cv::Mat_<std::uint8_t> nothing =
      draw<std::uint8_t>(map, [&](int x, int y) -> std::uint8_t { return hit(x, y) ? 0 : 255; });
  cv::Mat image;
  cv::applyColorMap(values, image, cv::COLORMAP_JET);
  image.setTo(cv::Scalar(0, 0, 0), nothing);
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", image, bytes)) throw std::runtime_error(path + " can't be encoded");
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  });
}

void writeTiming(const std::string& path, const BagResult& result) {
  std::vector<double> times;
  std::map<std::string, std::size_t> statuses, costs;
  std::size_t updates = 0, iterations = 0;
  double sum = 0.0;
  for (const auto& entry : result.entries) {
    times.push_back(entry.seconds);
    sum += entry.seconds;
    ++statuses[toString(entry.result.status)];
    if (entry.result.match.iterations > 0) ++costs[entry.result.match.cost];
    updates += entry.result.map_updated;
    iterations += entry.result.match.iterations;
  }
  std::sort(times.begin(), times.end());
  const auto milliseconds = [&times](double share) {
    return times.empty()
               ? 0.0
               : 1e3 * times[std::min(times.size() - 1, static_cast<std::size_t>(share * times.size()))];
  };
  const auto writeCounts = [](std::ostream& out, const std::map<std::string, std::size_t>& counts) {
    const char* separator = "";
    out << '{';
    for (const auto& [name, count] : counts) {
      out << separator << '"' << name << "\": " << count;
      separator = ", ";
    }
    out << '}';
  };
  mapping_common::writeFile(path, [&](std::ostream& out) {
    const double n = std::max<std::size_t>(1, times.size());
    out << "{\n  \"scans\": " << times.size() << ",\n  \"statuses\": ";
    writeCounts(out, statuses);
    out << ",\n  \"costs\": ";
    writeCounts(out, costs);
    out << ",\n  \"dropped\": ";
    std::map<std::string, std::size_t> dropped;
    for (const auto& [reason, fault] : result.dropped) dropped[reason] = fault.count;
    writeCounts(out, dropped);
    out << ",\n  \"map_updates\": " << updates << ",\n  \"iterations_mean\": " << iterations / n
        << ",\n  \"time_mean_ms\": " << 1e3 * sum / n << ",\n  \"time_median_ms\": " << milliseconds(0.5)
        << ",\n  \"time_95_percent_ms\": " << milliseconds(0.95)
        << ",\n  \"time_max_ms\": " << milliseconds(1.0) << "\n}\n";
  });
}

}  // namespace intensity_hector_slam
