// SPDX-License-Identifier: BSD-3-Clause
#include <pcl/PCLPointCloud2.h>
#include <pcl/io/pcd_io.h>
#include <rosbag_tests/converters/scan_files.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <stdexcept>
#include <utility>
#include <vector>

#include "file_utils.h"
#include "point_fields.h"

namespace rosbag_tests {

using mapping_simulation::PosedScan;

namespace {

namespace fs = std::filesystem;
using Cloud = pcl::PointCloud<pcl::PointXYZI>;

constexpr double kPeriod = 0.1;              // s between the made up stamps
constexpr double kRotationTolerance = 1e-3;  // of R R^T - I, |q| - 1: poses are often printed with few digits
const char kBinName[] = R"((\d{1,18})\.bin(\.xz)?)";
const char kPcdName[] = R"((.+)\.pcd)";
const char kUosName[] = R"(scan(\d{1,18})\.3d(\.xz)?)";
const char kPosesName[] = R"((poses.*)\.txt)";

/// Scans that are known beforehand and read when asked for.
class ListedScans : public ScanSource {
 public:
  struct Entry {
    std::string name;
    double stamp;                          // s
    std::function<void(PosedScan&)> read;  // sets pose and cloud
  };

  explicit ListedScans(std::vector<Entry> entries) : entries_(std::move(entries)) {}

  std::size_t size() const override { return entries_.size(); }

  bool next(PosedScan& scan) override {
    if (next_ == entries_.size()) return false;
    const Entry& entry = entries_[next_++];
    scan.name = entry.name;
    scan.stamp = entry.stamp;
    entry.read(scan);
    return true;
  }

  void rewind() override { next_ = 0; }

 private:
  std::vector<Entry> entries_;
  std::size_t next_ = 0;
};

/// Scans of a folder by number.
std::map<std::uint64_t, fs::path> numberedFiles(const std::string& folder, const char* pattern,
                                                const char* expected) {
  std::map<std::uint64_t, fs::path> files;
  for (const auto& [digits, path] : matchingFiles(folder, pattern)) {
    const auto [known, inserted] = files.emplace(std::stoull(digits), path);
    if (!inserted) fail(path.string(), "has the same number as " + known->second.filename().string());
  }
  if (files.empty()) fail(folder, std::string("holds no ") + expected);
  return files;
}

Eigen::Isometry3d makePose(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  Eigen::Isometry3d pose(rotation.normalized());
  pose.translation() = translation;
  return pose;
}

std::map<std::uint64_t, Eigen::Isometry3d> readPoses(const std::string& path) {
  std::map<std::uint64_t, Eigen::Isometry3d> poses;
  std::vector<double> v;
  forEachLine(readFileBytes(path), path, [&](const std::string& line, const std::string& where) {
    const bool numeric = parseNumbers(line, v);
    if (numeric && v.empty()) return;
    if (!numeric || v.size() != 13)
      fail(where, "expected the number of a scan and the 12 numbers of a 3x4 pose");
    if (!(v[0] >= 0.0 && v[0] < 1e15 && v[0] == std::floor(v[0])))
      fail(where, "expected a scan number that is a whole number, not " + std::to_string(v[0]));
    const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(&v[1]);
    const Eigen::Matrix3d rotation = matrix.leftCols<3>();
    const double error =
        (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    if (!matrix.allFinite() || !(error < kRotationTolerance) || rotation.determinant() < 0.0)
      fail(where,
           "expected a rotation in the left 3x3 of the pose, but it isn't orthonormal and right-handed");
    if (!poses.emplace(v[0], makePose(Eigen::Quaterniond(rotation), matrix.col(3))).second)
      fail(where, "second pose of scan " + std::to_string(static_cast<std::uint64_t>(v[0])));
  });
  if (poses.empty()) fail(path, "holds no poses");
  return poses;
}

constexpr std::size_t kKittiPoint = 4 * sizeof(float), kLivoxPoint = 19;

/// Whether there are points of that many bytes: their coordinates are finite, and of a size that scanners
/// measure.
bool holdsPoints(const std::string& bytes, std::size_t point_size) {
  constexpr float kFarthest = 1e4f;  // m
  if (bytes.empty() || bytes.size() % point_size != 0) return false;
  std::size_t good = 0;
  for (std::size_t at = 0; at < bytes.size(); at += point_size) {
    float v[3];
    std::memcpy(v, &bytes[at], sizeof(v));
    good += std::all_of(
        v, v + 3, [](float x) { return x == 0.0f || (std::abs(x) < kFarthest && std::abs(x) > 1e-6f); });
  }
  return good > 0.9 * static_cast<double>(bytes.size() / point_size);
}

void readBin(const std::string& path, Cloud& cloud) {
  const std::string bytes = readFileBytes(path);
  const bool livox = holdsPoints(bytes, kLivoxPoint) && !holdsPoints(bytes, kKittiPoint);
  const std::size_t point_size = livox ? kLivoxPoint : kKittiPoint;
  if (bytes.empty() || bytes.size() % point_size != 0)
    fail(path, "holds " + std::to_string(bytes.size()) +
                   " bytes, expected a multiple of 16 (float32 x y z intensity per point)");
  cloud.resize(bytes.size() / point_size);
  const char* data = bytes.data();
  for (auto& point : cloud) {
    float v[4];
    std::memcpy(v, data, livox ? 3 * sizeof(float) : sizeof(v));
    if (livox) v[3] = static_cast<float>(static_cast<unsigned char>(data[3 * sizeof(float)])) / 255.0f;
    data += point_size;
    point.getVector3fMap() = Eigen::Vector3f(v[0], v[1], v[2]);
    point.intensity = v[3];
  }
  cloud.is_dense = false;
}

void readPcd(const std::string& path, PcdFrame frame, PosedScan& scan) {
  pcl::PCLPointCloud2 blob;
  Eigen::Vector4f origin;
  Eigen::Quaternionf orientation;
  pcl::PCDReader reader;
  int version = 0, type = 0;
  unsigned int offset = 0;
  try {
    // PCL's reader of the points crashes if the header promises none.
    if (reader.readHeader(path, blob, origin, orientation, version, type, offset) < 0 ||
        blob.fields.empty() || blob.width == 0 || blob.height == 0 || blob.point_step == 0)
      throw std::runtime_error("expected a PCD header with fields and points");
    if (reader.read(path, blob, origin, orientation, version) < 0)
      throw std::runtime_error("expected " + std::to_string(blob.width) + " x " +
                               std::to_string(blob.height) + " points after the PCD header (byte " +
                               std::to_string(offset) + ")");
    readPoints(blob, scan.cloud);
  } catch (const std::exception& e) {
    fail(path, e.what());
  }
  if (!origin.allFinite() || !(std::abs(orientation.norm() - 1.0f) < kRotationTolerance))
    fail(path, "expected VIEWPOINT to be a position and a unit quaternion");
  scan.pose = makePose(orientation.cast<double>(), origin.head<3>().cast<double>());
  if (frame == PcdFrame::kSensor) return;
  const Eigen::Isometry3d map_to_sensor = scan.pose.inverse();
  for (auto& point : scan.cloud)
    point.getVector3fMap() = (map_to_sensor * point.getVector3fMap().cast<double>()).cast<float>();
}

/// UOS axes (x right, y up, z forward; left-handed) to ROS axes. Its determinant is -1, so that a rotation R
/// turns into A R A^T.
Eigen::Matrix3d axesFromUos() {
  return (Eigen::Matrix3d() << 0, 0, 1, -1, 0, 0, 0, 1, 0).finished();
}

Eigen::Isometry3d readUosPose(const std::string& path) {
  std::vector<double> v, line_numbers;
  forEachLine(readFileBytes(path), path, [&](const std::string& line, const std::string& where) {
    if (!parseNumbers(line, line_numbers)) fail(where, "expected numbers only");
    v.insert(v.end(), line_numbers.begin(), line_numbers.end());
  });
  if (v.size() != 6 || !std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); }))
    fail(path, "expected 6 finite numbers (position in cm, Euler angles in degrees), found " +
                   std::to_string(v.size()));
  const Eigen::Vector3d angles = Eigen::Vector3d(v[3], v[4], v[5]) * (M_PI / 180.0);
  const Eigen::Matrix3d rotation = (Eigen::AngleAxisd(angles.x(), Eigen::Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(angles.y(), Eigen::Vector3d::UnitY()) *
                                    Eigen::AngleAxisd(angles.z(), Eigen::Vector3d::UnitZ()))
                                       .toRotationMatrix();
  const Eigen::Matrix3d axes = axesFromUos();
  return makePose(Eigen::Quaterniond(Eigen::Matrix3d(axes * rotation * axes.transpose())),
                  axes * Eigen::Vector3d(v[0], v[1], v[2]) * 0.01);
}

void readUosPoints(const std::string& path, Cloud& cloud) {
  const Eigen::Matrix3d metres = 0.01 * axesFromUos();
  std::vector<double> v;
  bool first = true;
  cloud.clear();
  forEachLine(readFileBytes(path), path, [&](const std::string& line, const std::string& where) {
    const bool header = std::exchange(first, false);
    const bool numeric = parseNumbers(line, v);
    if (numeric && v.empty()) return;
    if (numeric && v.size() >= 3) {
      pcl::PointXYZI point;
      point.getVector3fMap() = (metres * Eigen::Vector3d(v[0], v[1], v[2])).cast<float>();
      point.intensity = v.size() == 4 ? static_cast<float>(v[3]) : 0.0f;
      cloud.push_back(point);
    } else if (!header) {
      fail(where, "expected a point: at least three numbers x y z");
    }
  });
  if (cloud.empty()) fail(path, "holds no points");
  cloud.is_dense = false;
}

// A binary ScanGraph is a count of scans and, per scan, a count of points, the points, a pose (position,
// quaternion w x y z) and an id. Counts are 4 bytes; vectors are a 4-byte dimension, which marks the file as
// what it is, and doubles.
constexpr std::uint64_t kGraphCount = 4, kGraphPoint = 4 + 3 * 8, kGraphQuaternion = 4 + 4 * 8;

struct GraphScan {
  std::uint64_t offset;  // of the points
  std::uint32_t points;
};

std::vector<GraphScan> listGraph(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file || fs::is_directory(path)) fail(path, "can't be read");
  const auto size = static_cast<std::uint64_t>(file.tellg());
  const auto expect = [&](bool good, std::uint64_t offset, const char* what) {
    if (!good)
      fail(path, "at byte " + std::to_string(offset) + " expected " + what + " of an OctoMap ScanGraph");
  };
  const auto integerAt = [&](std::uint64_t offset) {
    std::uint32_t value = 0;
    file.seekg(offset);
    expect(static_cast<bool>(file.read(reinterpret_cast<char*>(&value), sizeof(value))), offset, "more data");
    return value;
  };
  const std::uint32_t count = integerAt(0);
  expect(count > 0, 0, "the number of scans");
  std::vector<GraphScan> scans;
  std::uint64_t at = kGraphCount;
  while (scans.size() < count) {
    const std::uint32_t points = integerAt(at);
    const std::uint64_t first = at + kGraphCount, pose = first + points * kGraphPoint;
    const std::uint64_t end = pose + kGraphPoint + kGraphQuaternion + kGraphCount;
    expect(end <= size, at, "a scan whose points and pose fit in the file");
    expect(points == 0 || integerAt(first) == 3, first, "a point of dimension 3");
    expect(integerAt(pose) == 3 && integerAt(pose + kGraphPoint) == 4, pose, "the pose");
    scans.push_back({first, points});
    at = end;
  }
  return scans;
}

void readGraphScan(const std::string& path, const GraphScan& listed, PosedScan& scan) {
  std::string bytes(listed.points * kGraphPoint + kGraphPoint + kGraphQuaternion, '\0');
  std::ifstream file(path, std::ios::binary);
  file.seekg(listed.offset);
  if (!file.read(&bytes[0], bytes.size()))
    fail(path, "can't be read at byte " + std::to_string(listed.offset));
  const char* data = bytes.data();
  double v[4];
  scan.cloud.resize(listed.points);
  for (auto& point : scan.cloud) {
    std::memcpy(v, data + 4, 3 * sizeof(double));
    data += kGraphPoint;
    point.getVector3fMap() = Eigen::Vector3d(v[0], v[1], v[2]).cast<float>();
    point.intensity = 0.0f;
  }
  scan.cloud.is_dense = false;
  std::memcpy(v, data + 4, 3 * sizeof(double));
  const Eigen::Vector3d translation(v[0], v[1], v[2]);
  std::memcpy(v, data + kGraphPoint + 4, 4 * sizeof(double));
  const Eigen::Quaterniond rotation(v[0], v[1], v[2], v[3]);
  if (!translation.allFinite() || !(std::abs(rotation.norm() - 1.0) < kRotationTolerance))
    fail(path, "expected a position and a unit quaternion after the points at byte " +
                   std::to_string(listed.offset));
  scan.pose = makePose(rotation, translation);
}

std::unique_ptr<ScanSource> listed(std::vector<ListedScans::Entry> entries) {
  return std::make_unique<ListedScans>(std::move(entries));
}

}  // namespace

std::unique_ptr<ScanSource> openBinScans(const std::string& folder, const std::string& poses_file) {
  const auto files = numberedFiles(folder, kBinName, "NNNN.bin or NNNN.bin.xz");
  const auto poses =
      poses_file.empty() ? std::map<std::uint64_t, Eigen::Isometry3d>() : readPoses(poses_file);
  std::vector<ListedScans::Entry> entries;
  for (const auto& [number, path] : files) {
    const auto pose = poses.find(number);
    if (pose == poses.end() && !poses_file.empty()) fail(path.string(), "has no pose in " + poses_file);
    entries.push_back({path.filename().string(), number * kPeriod,
                       [path = path.string(), pose = pose == poses.end() ? Eigen::Isometry3d::Identity()
                                                                         : pose->second](PosedScan& scan) {
                         scan.pose = pose;
                         readBin(path, scan.cloud);
                       }});
  }
  return listed(std::move(entries));
}

std::unique_ptr<ScanSource> openPcdScans(const std::string& folder, PcdFrame frame) {
  std::vector<ListedScans::Entry> entries;
  for (const auto& file : matchingFiles(folder, kPcdName))
    entries.push_back(
        {file.second.filename().string(), entries.size() * kPeriod,
         [path = file.second.string(), frame](PosedScan& scan) { readPcd(path, frame, scan); }});
  if (entries.empty()) fail(folder, "holds no .pcd files");
  return listed(std::move(entries));
}

std::unique_ptr<ScanSource> openUosScans(const std::string& folder) {
  std::vector<ListedScans::Entry> entries;
  for (const auto& [number, path] : numberedFiles(folder, kUosName, "scanNNN.3d or scanNNN.3d.xz")) {
    const std::string name = path.filename().string();
    const fs::path pose_file = path.parent_path() / (name.substr(0, name.find('.')) + ".pose");
    if (!fs::exists(pose_file)) fail(path.string(), "has no pose: expected " + pose_file.string());
    entries.push_back(
        {name, number * kPeriod, [path = path.string(), pose = readUosPose(pose_file)](PosedScan& scan) {
           scan.pose = pose;
           readUosPoints(path, scan.cloud);
         }});
  }
  return listed(std::move(entries));
}

std::unique_ptr<ScanSource> openScanGraph(const std::string& file) {
  std::vector<ListedScans::Entry> entries;
  for (const GraphScan& scan : listGraph(file))
    entries.push_back({fs::path(file).filename().string() + " scan " + std::to_string(entries.size()),
                       entries.size() * kPeriod,
                       [=](PosedScan& posed) { readGraphScan(file, scan, posed); }});
  return listed(std::move(entries));
}

std::unique_ptr<ScanSource> openScans(const std::string& path, const std::string& poses, PcdFrame pcd_frame,
                                      bool need_poses) {
  if (!fs::exists(path)) fail(path, "no such file or folder");
  const bool folder = fs::is_directory(path);
  const bool graph = !folder && fs::path(path).extension() == ".graph";
  const bool bin = folder && !matchingFiles(path, kBinName).empty();
  const bool pcd = folder && !matchingFiles(path, kPcdName).empty();
  const bool uos = folder && !matchingFiles(path, kUosName).empty();
  if (graph + bin + pcd + uos != 1)
    fail(path, std::string(bin || pcd || uos ? "holds scans of several formats" : "not recognised") +
                   ": expected an OctoMap .graph file, or a folder with either NNNN.bin[.xz] and a pose "
                   "file, *.pcd, or "
                   "scanNNN.3d[.xz] with scanNNN.pose");
  if (!bin && !poses.empty())
    fail(poses, "poses can be given for .bin scans only, and " + path + " holds others");
  if (graph) return openScanGraph(path);
  if (pcd) return openPcdScans(path, pcd_frame);
  if (uos) return openUosScans(path);
  if (!poses.empty()) return openBinScans(path, poses);
  const auto found = matchingFiles(path, kPosesName);
  if (found.empty() && !need_poses) return openBinScans(path, "");
  if (found.size() != 1)
    fail(path, "holds " + std::to_string(found.size()) + " pose files poses*.txt, expected one, or its name");
  return openBinScans(path, found.front().second.string());
}

}  // namespace rosbag_tests
