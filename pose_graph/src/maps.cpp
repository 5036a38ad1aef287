// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/maps.h"

#include <mapping_common/files.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <utility>

namespace pose_graph {
namespace {

namespace slam = intensity_hector_slam;
namespace rtree = rtree_occupancy_map;

constexpr const char *kSlamPrefix = "slam/", *kOccupancyPrefix = "occupancy/";

// All of a kind whose key poses are in the graph, with their poses. @return whether it came to the end
bool visit(const Session& session, DataKind kind, const Graph& graph, const MapProgress& progress,
           const std::function<void(const KeyData&, const Pose&)>& work) {
  const double all = std::max<double>(1.0, session.amounts()[kind].count);
  double done = 0.0;
  bool goes_on = true;
  session.visitData(kind, [&](KeyData&& data) {
    try {
      if (const auto pose = poseOf(data, graph)) work(data, *pose);
    } catch (const std::invalid_argument& e) {
      throw std::runtime_error(session.path() + ": the " + mapping_common::nameOf(kind) + " at key pose " +
                               std::to_string(data.key_pose) + " can't go into the map: " + e.what());
    }
    done += 1.0;
    return goes_on = !progress || progress(std::min(1.0, done / all));
  });
  return goes_on;
}

Eigen::Isometry3f isometry(const Pose& pose) {
  return (Eigen::Translation3d(pose.translation) * pose.rotation).cast<float>();
}

// A planar scan is a cloud at the height of its frame.
rtree::Scan cloudOf(const slam::Scan& scan) {
  const auto raised = [](const Eigen::Vector2f& point) {
    return Eigen::Vector3f(point.x(), point.y(), 0.0F);
  };
  rtree::Scan cloud;
  cloud.time = scan.stamp;
  cloud.origin = raised(scan.origin);
  std::transform(scan.points.begin(), scan.points.end(), std::back_inserter(cloud.hits), raised);
  std::transform(scan.free.begin(), scan.free.end(), std::back_inserter(cloud.misses), raised);
  cloud.reflectivity = scan.reflectivities;
  return cloud;
}

// Clouds in the map's frame; without any, key scans.
bool visitClouds(const Session& session, const Graph& graph, const MapProgress& progress,
                 const std::function<void(const KeyData&, rtree::Scan&&)>& work) {
  const bool has_clouds = session.amounts()[DataKind::kCloud].count > 0;
  const DataKind kind = has_clouds ? DataKind::kCloud : DataKind::kScan;
  return visit(session, kind, graph, progress, [&](const KeyData& data, const Pose& pose) {
    rtree::Scan cloud = has_clouds ? toCloud(data) : cloudOf(toScan(data));
    const Eigen::Isometry3f to_map = isometry(pose);
    cloud.origin = to_map * cloud.origin;
    for (auto* points : {&cloud.hits, &cloud.misses, &cloud.hit_origins, &cloud.miss_origins})
      for (Eigen::Vector3f& point : *points) point = to_map * point;
    work(data, std::move(cloud));
  });
}

template <class Map>
void count(const KeyData& data, BuiltMap<Map>& built) {
  ++built.inserted;
  built.last_stamp = std::max(built.last_stamp, data.stamp);
}

// What is in one voxel.
struct Mean {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double intensity = 0.0;
  std::size_t points = 0, intensities = 0;
};
struct VoxelHash {
  std::size_t operator()(const std::array<std::int64_t, 3>& v) const {
    return static_cast<std::size_t>((v[0] * 73856093) ^ (v[1] * 19349663) ^ (v[2] * 83492791));
  }
};

}  // namespace

void keepOptions(const MapBuildOptions& options, SessionWriter& writer) {
  const auto keep = [&writer](const std::string& prefix, auto changed) {
    decltype(changed) defaults;
    mapping_common::OptionList list = mapping_common::optionsOf(defaults);
    for (const auto& [option, section] : mapping_common::optionsOf(changed))
      if (list.find(option.name())->get() != option.get())
        writer.setSetting(prefix + option.name(), option.word());
  };
  keep(kSlamPrefix, options.slam);
  keep(kOccupancyPrefix, options.occupancy);
}

MapBuildOptions mapOptions(const Session& session) {
  MapBuildOptions options;
  mapping_common::OptionList slam_list = mapping_common::optionsOf(options.slam),
                             occupancy_list = mapping_common::optionsOf(options.occupancy);
  for (const auto& [name, value] : session.settings()) {
    for (const auto& [prefix, list] :
         {std::pair(kSlamPrefix, &slam_list), std::pair(kOccupancyPrefix, &occupancy_list)}) {
      const std::string begin = prefix;
      if (name.compare(0, begin.size(), begin) != 0) continue;
      try {
        mapping_common::Option* option = list->find(name.substr(begin.size()));
        if (option == nullptr) throw std::invalid_argument("this program doesn't know it");
        option->parse(value);
        option->check();
      } catch (const std::invalid_argument& e) {
        throw std::runtime_error(session.path() + ": its setting " + name + ": " + e.what());
      }
    }
  }
  return options;
}

std::optional<Pose> poseOf(const KeyData& data, const Graph& graph) {
  const auto node = graph.find(data.key_pose);
  if (!node) return {};
  return graph.nodes()[*node].pose * data.sensor;
}

std::optional<BuiltMap<slam::MultiMap>> buildGridMap(const Session& session, const Graph& graph,
                                                     const slam::SlamOptions& options,
                                                     const MapProgress& progress) {
  slam::SlamOptions all = options;
  all.update_distance = all.update_angle = all.update_period = 0.0;
  all.localization = false;
  slam::Slam slam(all);
  BuiltMap<slam::MultiMap> built;
  const bool done =
      visit(session, DataKind::kScan, graph, progress, [&](const KeyData& data, const Pose& pose) {
        const slam::Scan scan = toScan(data);
        slam.insert(scan, {pose.translation.x(), pose.translation.y(), pose.yaw()});
        count(data, built);
      });
  if (!done) return {};
  built.map = slam.map();
  return built;
}

std::optional<BuiltMap<rtree::OccupancyMap>> buildOccupancyMap(const Session& session, const Graph& graph,
                                                               const rtree::Options& options,
                                                               const MapProgress& progress) {
  BuiltMap<rtree::OccupancyMap> built{rtree::OccupancyMap(options)};
  const bool done = visitClouds(session, graph, progress, [&](const KeyData& data, rtree::Scan&& cloud) {
    built.map.insertScan(cloud);
    count(data, built);
  });
  if (!done) return {};
  return built;
}

std::optional<std::vector<CloudPoint>> buildCloud(const Session& session, const Graph& graph, double voxel,
                                                  const MapProgress& progress) {
  std::vector<CloudPoint> points;
  std::unordered_map<std::array<std::int64_t, 3>, Mean, VoxelHash> voxels;
  const bool done = visitClouds(session, graph, progress, [&](const KeyData&, rtree::Scan&& cloud) {
    for (std::size_t i = 0; i < cloud.hits.size(); ++i) {
      const Eigen::Vector3f& hit = cloud.hits[i];
      if (!hit.allFinite()) continue;
      const float intensity =
          cloud.reflectivity.empty() ? std::numeric_limits<float>::quiet_NaN() : cloud.reflectivity[i];
      if (!(voxel > 0.0)) {
        points.push_back({hit, intensity});
        continue;
      }
      std::array<std::int64_t, 3> at;
      for (int k = 0; k < 3; ++k) at[k] = static_cast<std::int64_t>(std::floor(hit[k] / voxel));
      Mean& mean = voxels[at];
      mean.position += hit.cast<double>();
      ++mean.points;
      if (std::isfinite(intensity)) mean.intensity += intensity, ++mean.intensities;
    }
  });
  if (!done) return {};
  for (const auto& [at, mean] : voxels) {
    points.push_back({(mean.position / mean.points).cast<float>(),
                      static_cast<float>(mean.intensity / mean.intensities)});  // NaN of none
  }
  return points;
}

void writePcd(const std::string& path, const std::vector<CloudPoint>& points) {
  static_assert(sizeof(CloudPoint) == 16);
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\n"
           "TYPE F F F F\nCOUNT 1 1 1 1\nWIDTH "
        << points.size() << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << points.size()
        << "\nDATA binary\n";
    out.write(reinterpret_cast<const char*>(points.data()),
              static_cast<std::streamsize>(points.size() * sizeof(CloudPoint)));
  });
}

}  // namespace pose_graph
