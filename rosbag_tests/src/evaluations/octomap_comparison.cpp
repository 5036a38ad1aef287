// SPDX-License-Identifier: BSD-3-Clause
#include <rosbag_tests/evaluations/octomap_comparison.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <iomanip>
#include <ostream>
#include <sstream>
#include <stdexcept>

namespace rosbag_tests {

using mapping_simulation::PosedScan;

namespace {

using rtree_occupancy_map::Cell;
using rtree_occupancy_map::OccupancyMap;
using rtree_occupancy_map::Options;
using rtree_occupancy_map::Scan;
using rtree_occupancy_map::SensorModel;

constexpr int kAccessPasses = 7;
constexpr int kOctomapOrigin = 32768;  // OctoMap's key of voxel 0
constexpr int kProbesOfBeam = 4;

enum { kUnknown, kFree, kOccupied };  // as in ComparisonResult::voxels
constexpr const char* kClass[3] = {"unknown", "free", "occupied"};

octomap::OcTreeKey keyOf(const rtree_occupancy_map::Voxel& v) {
  const auto key = [](int c) { return static_cast<octomap::key_type>(c + kOctomapOrigin); };
  return {key(v[0]), key(v[1]), key(v[2])};
}

// Processor time of this thread, which other processes don't stretch, or elapsed time.
class Stopwatch {
 public:
  explicit Stopwatch(bool elapsed = false)
      : clock_(elapsed ? CLOCK_MONOTONIC : CLOCK_THREAD_CPUTIME_ID), start_(now()) {}
  double seconds() const { return now() - start_; }

 private:
  double now() const {
    timespec t;
    clock_gettime(clock_, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  }
  const clockid_t clock_;
  const double start_;
};

// OctoMap frees about a million small nodes in an insertion. The C library puts them together and sorts them,
// some 10,000 at a time, when somebody next asks for more than a little. That is nobody's measured time,
// least of all the other map's.
void settleAllocator() {
  static char* volatile block;  // or the compiler leaves it out
  for (int i = 0; i < 200; ++i) {
    block = new char[1 << 14];
    delete[] block;
  }
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

// What a user of the occupied cells does at the least: look at each one's place and size. The sum keeps the
// compiler from leaving it out.
volatile double sink;

}  // namespace

OctomapComparison::OctomapComparison(const std::vector<Options>& options, std::size_t write_back_every)
    : write_back_every_(write_back_every), octree_(options.empty() ? 1.0 : options[0].resolution) {
  if (write_back_every == 0) throw std::invalid_argument("write_back_every is 0, allowed is 1 or more");
  if (options.empty()) throw std::invalid_argument("there is no map to compare");
  const Options& first = options[0];
  for (const Options& o : options) {
    if (o.resolution != first.resolution || o.sensor_model != first.sensor_model ||
        o.prob_hit != first.prob_hit || o.prob_miss != first.prob_miss ||
        o.clamping_min != first.clamping_min || o.clamping_max != first.clamping_max ||
        o.max_range != first.max_range || o.occupancy_threshold != first.occupancy_threshold ||
        o.prior != 0.5 || o.min_range != 0.0) {
      throw std::invalid_argument(
          "maps to be compared need the same resolution, sensor model and range, and OctoMap's prior");
    }
    maps_.emplace_back(o);
  }
  map_seconds_.resize(maps_.size(), 0.0);
  octree_.setProbHit(first.prob_hit);
  octree_.setProbMiss(first.prob_miss);
  octree_.setClampingThresMin(first.clamping_min);
  octree_.setClampingThresMax(first.clamping_max);
  octree_.setOccupancyThres(first.occupancy_threshold);
}

void OctomapComparison::insertIntoOctomap(const octomap::Pointcloud& cloud, const octomap::point3d& origin) {
  const Options& o = maps_[0].options();
  const double max_range = std::isfinite(o.max_range) ? o.max_range : -1.0;
  if (o.sensor_model == SensorModel::kBeam) {
    octree_.insertPointCloud(cloud, origin, max_range, /*lazy_eval=*/false, /*discretize=*/true);
    return;
  }
  octomap::KeySet end_points;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    octomap::OcTreeKey key;
    if (!octree_.coordToKeyChecked(cloud[static_cast<unsigned>(i)], key)) continue;
    if (max_range >= 0.0 && (octree_.keyToCoord(key) - origin).norm() > max_range) continue;
    end_points.insert(key);
  }
  for (const octomap::OcTreeKey& key : end_points) octree_.updateNode(key, true, /*lazy_eval=*/false);
}

void OctomapComparison::insert(const PosedScan& posed) {
  Scan scan;
  octomap::Pointcloud cloud;
  scan.origin = posed.pose.translation().cast<float>();
  cloud.reserve(posed.cloud.size());
  for (const pcl::PointXYZI& p : posed.cloud) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
    const Eigen::Vector3f q = (posed.pose * p.getVector3fMap().cast<double>()).cast<float>();
    scan.hits.push_back(q);
    cloud.push_back(q.x(), q.y(), q.z());
  }
  const octomap::point3d origin(scan.origin.x(), scan.origin.y(), scan.origin.z());
  const std::size_t contestants = maps_.size() + 1;
  const bool elapsed = maps_[0].options().threads != 1;
  for (std::size_t k = 0; k < contestants; ++k) {
    const std::size_t i = (k + scans_) % contestants;
    settleAllocator();
    const Stopwatch watch(elapsed);
    if (i == maps_.size()) {
      insertIntoOctomap(cloud, origin);
      octomap_seconds_ += watch.seconds();
    } else {
      maps_[i].insertScan(scan);
      if ((scans_ + 1) % write_back_every_ == 0) maps_[i].tree();
      map_seconds_[i] += watch.seconds();
    }
  }
  keepProbes(scan);
  ++scans_;
  points_ += scan.hits.size();
}

void OctomapComparison::keepProbes(const Scan& scan) {
  if (probe_every_ == 0) return;
  const double resolution = maps_[0].options().resolution;
  for (std::size_t i = 0; i < scan.hits.size(); i += probe_every_) {
    for (int k = 1; k <= kProbesOfBeam; ++k) {
      const Eigen::Vector3d along = (scan.hits[i] - scan.origin).cast<double>() * k / kProbesOfBeam;
      const Eigen::Array3d at = ((scan.origin.cast<double>() + along) / resolution).array().floor();
      if ((at < rtree_occupancy_map::kMinVoxel).any() || (at >= rtree_occupancy_map::kMaxVoxel).any())
        continue;
      probes_.insert({static_cast<int>(at.x()), static_cast<int>(at.y()), static_cast<int>(at.z())});
    }
  }
}

void OctomapComparison::writeProbes(std::ostream& out) const {
  const OccupancyMap& map = maps_[0];
  out << "x,y,z,octomap_state,octomap_log_odds,rtree_state,rtree_log_odds\n" << std::setprecision(9);
  const auto write = [&out](bool known, bool occupied, float log_odds) {
    out << ',' << kClass[!known ? kUnknown : occupied ? kOccupied : kFree] << ',';
    if (known) out << log_odds;
  };
  for (const rtree_occupancy_map::Voxel& voxel : probes_) {
    const Eigen::Vector3d center = map.center(rtree_occupancy_map::VoxelBox::unit(voxel));
    out << center.x() << ',' << center.y() << ',' << center.z();
    const octomap::OcTreeNode* node = octree_.search(keyOf(voxel));
    write(node != nullptr, node != nullptr && octree_.isNodeOccupied(*node),
          node != nullptr ? node->getLogOdds() : 0.0F);
    const auto cell = map.cellAt(voxel);
    write(cell.has_value(), cell && map.isOccupied(*cell), cell ? cell->log_odds : 0.0F);
    out << '\n';
  }
}

void OctomapComparison::measureAccess(ComparisonResult& result) const {
  std::vector<double> octomap;
  std::vector<std::vector<double>> rtree(maps_.size());
  for (int pass = 0; pass < kAccessPasses; ++pass) {
    {
      const Stopwatch watch;
      double sum = 0.0;
      std::size_t cells = 0;
      for (auto leaf = octree_.begin_leafs(); leaf != octree_.end_leafs(); ++leaf) {
        if (!octree_.isNodeOccupied(*leaf)) continue;
        ++cells;
        sum += leaf.getX() + leaf.getY() + leaf.getZ() + leaf.getSize();
      }
      octomap.push_back(watch.seconds());
      sink = sum;
      result.octomap.occupied_cells = cells;
    }
    for (std::size_t i = 0; i < maps_.size(); ++i) {
      const Stopwatch watch;
      double sum = 0.0;
      std::size_t cells = 0;
      maps_[i].visitOccupied([&](const Cell& cell) {
        ++cells;
        sum += (maps_[i].center(cell.box) + maps_[i].maxCorner(cell.box)).sum();
        return true;
      });
      rtree[i].push_back(watch.seconds());
      sink = sum;
      result.rtree[i].occupied_cells = cells;
    }
  }
  result.octomap.occupied_access_s = median(octomap);
  for (std::size_t i = 0; i < maps_.size(); ++i) result.rtree[i].occupied_access_s = median(rtree[i]);
}

// OctoMap is searched for each voxel of the R-tree map. What it knows beyond those, the R-tree map doesn't
// know.
void OctomapComparison::compareVoxels(ComparisonResult& result) const {
  const OccupancyMap& map = maps_[0];
  std::size_t in_octomap[3] = {};
  for (auto leaf = octree_.begin_leafs(); leaf != octree_.end_leafs(); ++leaf) {
    const std::size_t width = std::size_t{1} << (octree_.getTreeDepth() - leaf.getDepth());
    in_octomap[octree_.isNodeOccupied(*leaf) ? kOccupied : kFree] += width * width * width;
  }
  map.tree().visitAll([&](const Cell& cell) {
    const int ours = map.isOccupied(cell) ? kOccupied : kFree;
    for (int x = cell.box.min[0]; x < cell.box.max[0]; ++x) {
      for (int y = cell.box.min[1]; y < cell.box.max[1]; ++y) {
        for (int z = cell.box.min[2]; z < cell.box.max[2]; ++z) {
          const octomap::OcTreeNode* node = octree_.search(keyOf({x, y, z}));
          const int theirs = node == nullptr ? kUnknown : octree_.isNodeOccupied(*node) ? kOccupied : kFree;
          ++result.voxels[theirs][ours];
          --in_octomap[theirs];
          result.log_odds_differing += node != nullptr && node->getLogOdds() != cell.log_odds;
        }
      }
    }
    return true;
  });
  result.voxels[kFree][kUnknown] = in_octomap[kFree];
  result.voxels[kOccupied][kUnknown] = in_octomap[kOccupied];
  for (int theirs = 0; theirs < 3; ++theirs) {
    for (int ours = 0; ours < 3; ++ours) {
      result.voxels_compared += result.voxels[theirs][ours];
      if (theirs != ours) result.voxels_differing += result.voxels[theirs][ours];
    }
  }
}

ComparisonResult OctomapComparison::finish() {
  ComparisonResult result;
  result.scans = scans_;
  result.points = points_;
  result.rtree.resize(maps_.size());
  const auto perPoint = [this](double seconds) {
    return points_ > 0 ? 1e9 * seconds / static_cast<double>(points_) : 0.0;
  };
  for (std::size_t i = 0; i < maps_.size(); ++i) {
    const Stopwatch watch(maps_[0].options().threads != 1);
    maps_[i].tree();
    map_seconds_[i] += watch.seconds();
  }
  octree_.prune();
  result.octomap.insertion_ns_per_point = perPoint(octomap_seconds_);
  result.octomap.cells = octree_.getNumLeafNodes();
  result.octomap.inner_nodes = octree_.calcNumNodes() - result.octomap.cells;
  result.octomap.memory_bytes = octree_.memoryUsage();
  for (std::size_t i = 0; i < maps_.size(); ++i) {
    const rtree_occupancy_map::Statistics s = maps_[i].statistics();
    result.rtree[i].cells = s.cells;
    result.rtree[i].inner_nodes = s.nodes;
    result.rtree[i].insertion_ns_per_point = perPoint(map_seconds_[i]);
    result.rtree[i].memory_bytes = s.memory_bytes;
  }
  measureAccess(result);
  compareVoxels(result);

  const rtree_occupancy_map::VoxelBox bounds = maps_[0].tree().bounds();
  result.full_grid_voxels = scans_ > 0 && !bounds.isEmpty() ? static_cast<std::size_t>(bounds.volume()) : 0;
  octree_.expand();
  result.octomap_unpruned.cells = octree_.getNumLeafNodes();
  result.octomap_unpruned.inner_nodes = octree_.calcNumNodes() - result.octomap_unpruned.cells;
  return result;
}

// -----------------------------------------------------------------------------------------------------------
// output

namespace {

std::string grouped(double value) {
  std::string digits = std::to_string(static_cast<long long>(std::llround(value)));
  for (int i = static_cast<int>(digits.size()) - 3; i > 0; i -= 3)
    digits.insert(static_cast<std::size_t>(i), ",");
  return digits;
}

std::string fixed(double value, int digits) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(digits) << value;
  return text.str();
}

std::string name(const Options& o) {
  std::string text = o.fusion_rule == rtree_occupancy_map::FusionRule::kThesis ? "thesis" : "equal";
  if (o.fusion_strategy == rtree_occupancy_map::FusionStrategy::kExpansion) text += ", expansion";
  if (o.fusion_strategy == rtree_occupancy_map::FusionStrategy::kNone) text = "no fusion";
  return text + ", M " + std::to_string(o.tree.max_entries);
}

void printFigures(std::ostream& out, const MapFigures& f) {
  out << "{\"cells\": " << f.cells << ", \"inner_nodes\": " << f.inner_nodes
      << ", \"occupied_cells\": " << f.occupied_cells
      << ", \"insertion_ns_per_point\": " << f.insertion_ns_per_point
      << ", \"occupied_access_s\": " << f.occupied_access_s << ", \"memory_bytes\": " << f.memory_bytes
      << "}";
}

}  // namespace

void printTable(std::ostream& out, const ComparisonResult& r, const std::vector<Options>& options) {
  const Options& o = options.at(0);
  out << r.scans << " scans, " << grouped(static_cast<double>(r.points)) << " points, " << o.resolution
      << " m, " << (o.sensor_model == SensorModel::kBeam ? "beam" : "end-point") << " model\n";
  for (std::size_t i = 0; i < options.size(); ++i) {
    const MapFigures &a = r.octomap, &b = r.rtree[i];
    const auto share = [](double ours, double theirs) {
      return theirs > 0 ? fixed(100.0 * ours / theirs, 2) + " %" : "-";
    };
    const auto faster = [](double ours, double theirs) {
      return ours > 0 ? fixed(theirs / ours, 1) + " x" : "-";
    };
    const auto row = [&out](const std::string& what, const std::string& theirs, const std::string& ours,
                            const std::string& ratio) {
      out << "  " << std::left << std::setw(28) << what << std::right << std::setw(14) << theirs
          << std::setw(22) << ours << std::setw(12) << ratio << "\n";
    };
    const auto count = [&](const char* what, std::size_t theirs, std::size_t ours) {
      const auto x = static_cast<double>(theirs), y = static_cast<double>(ours);
      row(what, grouped(x), grouped(y), share(y, x));
    };
    row("", "OctoMap", "R-tree (" + name(options[i]) + ")", "ratio");
    row("insertion, ns per point", fixed(a.insertion_ns_per_point, 0), fixed(b.insertion_ns_per_point, 0),
        faster(b.insertion_ns_per_point, a.insertion_ns_per_point));
    count("cells", a.cells, b.cells);
    count("inner nodes", a.inner_nodes, b.inner_nodes);
    count("occupied cells", a.occupied_cells, b.occupied_cells);
    row("access of the occupied, ms", fixed(1e3 * a.occupied_access_s, 2),
        fixed(1e3 * b.occupied_access_s, 2), faster(b.occupied_access_s, a.occupied_access_s));
    row("memory, MB", fixed(1e-6 * static_cast<double>(a.memory_bytes), 1),
        fixed(1e-6 * static_cast<double>(b.memory_bytes), 1),
        share(static_cast<double>(b.memory_bytes), static_cast<double>(a.memory_bytes)));
  }
  out << "  voxels compared " << grouped(static_cast<double>(r.voxels_compared)) << ", of another class "
      << grouped(static_cast<double>(r.voxels_differing)) << ", of other log odds "
      << grouped(static_cast<double>(r.log_odds_differing)) << "\n";
  if (r.voxels_differing == 0) return;
  // The same updates give the same log odds, so a voxel can differ only where the two step a beam past an
  // edge or a corner on different sides: seldom, and it shows here as pairs of known and unknown or as single
  // classes.
  for (int theirs = 0; theirs < 3; ++theirs) {
    for (int ours = 0; ours < 3; ++ours) {
      if (theirs == ours || r.voxels[theirs][ours] == 0) continue;
      out << "    " << kClass[theirs] << " in OctoMap, " << kClass[ours]
          << " in the R-tree map: " << r.voxels[theirs][ours] << "\n";
    }
  }
}

void printJson(std::ostream& out, const ComparisonResult& r, const std::vector<Options>& options) {
  const Options& o = options.at(0);
  out << std::setprecision(9) << "{\n  \"scans\": " << r.scans << ",\n  \"points\": " << r.points
      << ",\n  \"resolution\": " << o.resolution << ",\n  \"model\": \""
      << (o.sensor_model == SensorModel::kBeam ? "beam" : "endpoint") << "\",\n  \"octomap\": ";
  printFigures(out, r.octomap);
  out << ",\n  \"octomap_unpruned\": {\"cells\": " << r.octomap_unpruned.cells
      << ", \"inner_nodes\": " << r.octomap_unpruned.inner_nodes
      << "},\n  \"full_grid_voxels\": " << r.full_grid_voxels << ",\n  \"rtree_occupancy_map\": ";
  printFigures(out, r.rtree.at(0));
  out << ",\n  \"rtree_occupancy_maps\": [";
  for (std::size_t i = 0; i < options.size(); ++i) {
    out << (i > 0 ? "," : "") << "\n    {\"fusion\": \""
        << (options[i].fusion_rule == rtree_occupancy_map::FusionRule::kThesis ? "thesis" : "equal")
        << "\", \"max_entries\": " << options[i].tree.max_entries << ", \"figures\": ";
    printFigures(out, r.rtree[i]);
    out << "}";
  }
  out << "],\n  \"voxels_compared\": " << r.voxels_compared
      << ",\n  \"voxels_differing\": " << r.voxels_differing
      << ",\n  \"log_odds_differing\": " << r.log_odds_differing << "\n}\n";
}

}  // namespace rosbag_tests
