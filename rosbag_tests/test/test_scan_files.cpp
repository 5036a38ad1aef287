// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <lzma.h>
#include <mapping_common/testing/temp_dir.h>
#include <octomap/ScanGraph.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#include <rosbag_tests/converters/scan_files.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <set>
#include <vector>

namespace rosbag_tests {

using mapping_simulation::PosedScan;

namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
const char kIdentity[] = " 1 0 0 0 0 1 0 0 0 0 1 0\n";

std::string bin(const std::vector<float>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
}

std::string xz(const std::string& bytes) {
  std::string packed(lzma_stream_buffer_bound(bytes.size()), '\0');
  std::size_t size = 0;
  EXPECT_EQ(LZMA_OK, lzma_easy_buffer_encode(6, LZMA_CHECK_CRC32, nullptr,
                                             reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size(),
                                             reinterpret_cast<uint8_t*>(&packed[0]), &size, packed.size()));
  packed.resize(size);
  return packed;
}

std::string pcd(const std::string& viewpoint, const std::string& points, int count) {
  const std::string n = std::to_string(count);
  return "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " + n +
         "\nHEIGHT 1\nVIEWPOINT " + viewpoint + "\nPOINTS " + n + "\nDATA ascii\n" + points;
}

std::vector<PosedScan> readAll(ScanSource& source) {
  std::vector<PosedScan> scans;
  for (PosedScan scan; source.next(scan);) scans.push_back(scan);
  return scans;
}

PosedScan readFirst(ScanSource& source) {
  PosedScan scan;
  EXPECT_TRUE(source.next(scan));
  return scan;
}

std::string readError(ScanSource& source) {
  PosedScan scan;
  return errorOf([&] { source.next(scan); });
}

void expectPoint(const pcl::PointXYZI& point, float x, float y, float z, float intensity) {
  EXPECT_NEAR(point.x, x, 1e-5);
  EXPECT_NEAR(point.y, y, 1e-5);
  EXPECT_NEAR(point.z, z, 1e-5);
  EXPECT_FLOAT_EQ(point.intensity, intensity);
}

TEST(BinScans, OfALivoxScannerAndWithoutPoses) {
  TempDir dir;
  std::string bytes;
  for (int i = 0; i < 32; ++i) {  // 32 points of 19 bytes are 38 of 16, too
    bytes += bin({10.0f + 0.25f * static_cast<float>(i), -2.0f, 1.5f});
    bytes += {static_cast<char>(255), 0, static_cast<char>(i % 6), 1, 2, 3, 4};
  }
  ASSERT_EQ(0u, bytes.size() % 16);
  dir.write("3.bin", bytes);
  const auto source = openScans(dir.path(), "", PcdFrame::kMap, false);
  const PosedScan scan = readFirst(*source);
  ASSERT_EQ(32u, scan.cloud.size());
  expectPoint(scan.cloud[31], 17.75f, -2.0f, 1.5f, 1.0f);
  EXPECT_TRUE(scan.pose.matrix().isIdentity());
}

TEST(BinScans, PlainAndPackedByNumberWhateverThePadding) {
  TempDir dir;
  dir.write("0010.bin", bin({1, 2, 3, 0.5f, kNan, kNan, kNan, 0}));
  dir.write("2.bin.xz", xz(bin({4, 5, 6, 0.25f})));
  dir.write("notes.txt", "not a scan");
  const std::string poses = dir.write("p.txt",
                                      "# number, pose\n\n00010 0 -1 0 7 1 0 0 8 0 0 1 9 # turned left\r\n"
                                      "2" +
                                          std::string(kIdentity) + "99" + kIdentity);
  const auto source = openBinScans(dir.path(), poses);
  ASSERT_EQ(source->size(), 2u);
  const auto scans = readAll(*source);
  ASSERT_EQ(scans.size(), 2u);
  EXPECT_EQ(scans[0].name, "2.bin.xz");
  EXPECT_DOUBLE_EQ(scans[0].stamp, 0.2);
  ASSERT_EQ(scans[0].cloud.size(), 1u);
  expectPoint(scans[0].cloud[0], 4, 5, 6, 0.25f);
  EXPECT_DOUBLE_EQ(scans[1].stamp, 1.0);
  ASSERT_EQ(scans[1].cloud.size(), 2u);
  expectPoint(scans[1].cloud[0], 1, 2, 3, 0.5f);
  EXPECT_TRUE(std::isnan(scans[1].cloud[1].x));
  EXPECT_TRUE((scans[1].pose * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(7, 9, 9), 1e-9));
  source->rewind();
  EXPECT_EQ(readFirst(*source).name, "2.bin.xz");
}

TEST(BinScans, FaultyScanIsNamedAndTheNextOneIsRead) {
  TempDir dir;
  const std::string packed = xz(bin(std::vector<float>(4000, 1.5f)));
  dir.write("1.bin", bin({1, 2, 3}));
  dir.write("2.bin", "");
  dir.write("3.bin.xz", packed.substr(0, packed.size() / 2));
  dir.write("4.bin.xz", "this is not xz");
  std::string corrupt = packed;
  corrupt[corrupt.size() / 2] ^= 0x55;
  dir.write("5.bin.xz", corrupt);
  dir.write("6.bin", bin({1, 2, 3, 4}));
  std::string poses;
  for (int i = 1; i <= 6; ++i) poses += std::to_string(i) + kIdentity;
  const auto source = openBinScans(dir.path(), dir.write("p.txt", poses));
  EXPECT_TRUE(mentions(readError(*source), {"1.bin: holds 12 bytes", "multiple of 16"}));
  EXPECT_TRUE(mentions(readError(*source), {"2.bin: holds 0 bytes"}));
  EXPECT_TRUE(mentions(readError(*source), {"3.bin.xz: truncated xz", "at byte"}));
  EXPECT_TRUE(mentions(readError(*source), {"4.bin.xz: not an xz file"}));
  EXPECT_TRUE(mentions(readError(*source), {"5.bin.xz: corrupt xz data"}));
  EXPECT_EQ(readFirst(*source).cloud.size(), 1u);
}

TEST(BinScans, FaultyPosesAreRefusedWithTheirLine) {
  TempDir dir;
  dir.write("07.bin", bin({1, 2, 3, 4}));
  const auto error = [&](const std::string& poses) {
    return errorOf([&] { openBinScans(dir.path(), dir.write("p.txt", poses)); });
  };
  const std::string good = std::string("7") + kIdentity;
  EXPECT_EQ(error(good), "");
  EXPECT_TRUE(mentions(error(std::string("8") + kIdentity), {"07.bin: has no pose in"}));
  EXPECT_TRUE(mentions(error("# 1\n7 1 0 0 0 0 1 0 0 0 0 1\n"), {"p.txt:2:", "12 numbers"}));
  EXPECT_TRUE(mentions(error("7 1 0 0 0 0 1 0 0 0 0 one 0\n"), {"p.txt:1:"}));
  EXPECT_TRUE(mentions(error("7 2 0 0 0 0 1 0 0 0 0 1 0\n"), {"p.txt:1:", "orthonormal"}));
  EXPECT_TRUE(mentions(error("7 1 0 0 0 0 1 0 0 0 0 -1 0\n"), {"right-handed"}));
  EXPECT_TRUE(mentions(error("7 nan 0 0 0 0 1 0 0 0 0 1 0\n"), {"orthonormal"}));
  EXPECT_TRUE(mentions(error("7.5 1 0 0 0 0 1 0 0 0 0 1 0\n"), {"whole number"}));
  EXPECT_TRUE(mentions(error(good + "007" + kIdentity), {"p.txt:2:", "second pose"}));
  EXPECT_TRUE(mentions(error(std::string("7\0 1", 4)), {"p.txt:1:"}));
  EXPECT_TRUE(mentions(error("# none\n"), {"no poses"}));
  EXPECT_TRUE(mentions(errorOf([&] { openBinScans(dir.path(), dir.path("missing.txt")); }),
                       {"missing.txt: can't be read"}));
  EXPECT_TRUE(mentions(errorOf([&] { openBinScans(dir.path(), dir.path()); }), {"can't be read"}));
  dir.write("7.bin.xz", "");
  EXPECT_TRUE(mentions(error(good), {"same number as"}));
}

TEST(PcdScans, NaturalOrderAndPoseFromTheViewpoint) {
  TempDir dir;
  const std::string viewpoint = "1 2 3 0.70710678 0 0 0.70710678";
  dir.write("scan_10.pcd", pcd(viewpoint, "1 3 3\n", 1));
  dir.write("scan_9.pcd", pcd("0 0 0 1 0 0 0", "1 0 0\nnan nan nan\n", 2));
  dir.write("scan_1.pcd", pcd("0 0 0 1 0 0 0", "1 0 0\n", 1));
  const auto source = openPcdScans(dir.path());
  const auto scans = readAll(*source);
  ASSERT_EQ(scans.size(), 3u);
  EXPECT_EQ(scans[0].name, "scan_1.pcd");
  EXPECT_EQ(scans[1].name, "scan_9.pcd");
  EXPECT_EQ(scans[2].name, "scan_10.pcd");
  EXPECT_DOUBLE_EQ(scans[2].stamp, 0.2);
  ASSERT_EQ(scans[1].cloud.size(), 2u);
  EXPECT_TRUE(std::isnan(scans[1].cloud[1].y));
  expectPoint(scans[2].cloud[0], 1, 0, 0, 0);
  EXPECT_TRUE((scans[2].pose * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(1, 3, 3), 1e-6));

  const auto in_sensor_frame = readAll(*openPcdScans(dir.path(), PcdFrame::kSensor));
  expectPoint(in_sensor_frame[2].cloud[0], 1, 3, 3, 0);
  EXPECT_TRUE(in_sensor_frame[2].pose.isApprox(scans[2].pose, 1e-12));
}

TEST(PcdScans, FaultyFilesAreRefused) {
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  TempDir dir;
  dir.write("1.pcd", "hello\n");
  dir.write("2.pcd", pcd("0 0 0 0 0 0 0", "1 0 0\n", 1));
  pcl::PointCloud<pcl::PointXYZI> cloud(1000, 1);
  pcl::io::savePCDFileBinary(dir.path("3.pcd"), cloud);
  std::filesystem::resize_file(dir.path("3.pcd"), std::filesystem::file_size(dir.path("3.pcd")) / 2);
  dir.write("4.pcd",
            "VERSION 0.7\nFIELDS a b\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA "
            "ascii\n1 2\n");
  const auto source = openPcdScans(dir.path());
  EXPECT_TRUE(mentions(readError(*source), {"1.pcd: "}));
  EXPECT_TRUE(mentions(readError(*source), {"2.pcd: ", "VIEWPOINT"}));
  EXPECT_TRUE(mentions(readError(*source), {"3.pcd: "}));
  EXPECT_TRUE(mentions(readError(*source), {"4.pcd: ", "fields x, y and z"}));
}

TEST(UosScans, AxesUnitsAndEulerAngles) {
  TempDir dir;
  // 5 m ahead of a sensor that is turned right (the left-handed y axis points up).
  dir.write("scan000.3d", "0 0 500\n");
  dir.write("scan000.pose", "100 200 300\n0 90 0\n");
  // Rx is applied last: the point above stays above by Ry and goes ahead by Rx.
  dir.write("scan001.3d.xz", xz("# header comment\n0 500 0 0.75\nnan 0 0\n1 2 3 255 0 0\n"));
  dir.write("scan001.pose", "0 0 0\n90 90 0\n");
  dir.write("scan010.3d", "361 x 225 points\n100 0 0\n");
  dir.write("scan010.pose", "0 0 0 0 0 90");
  const auto scans = readAll(*openUosScans(dir.path()));
  ASSERT_EQ(scans.size(), 3u);
  expectPoint(scans[0].cloud[0], 5, 0, 0, 0);
  EXPECT_TRUE(scans[0].pose.translation().isApprox(Eigen::Vector3d(3, -1, 2), 1e-9));
  EXPECT_TRUE((scans[0].pose * Eigen::Vector3d(5, 0, 0)).isApprox(Eigen::Vector3d(3, -6, 2), 1e-9));
  ASSERT_EQ(scans[1].cloud.size(), 3u);
  expectPoint(scans[1].cloud[0], 0, 0, 5, 0.75f);
  EXPECT_TRUE((scans[1].pose * Eigen::Vector3d(0, 0, 5)).isApprox(Eigen::Vector3d(5, 0, 0), 1e-9));
  EXPECT_FALSE(scans[1].cloud[1].getVector3fMap().allFinite());
  expectPoint(scans[1].cloud[2], 0.03f, -0.01f, 0.02f, 0);  // x y z and a colour
  EXPECT_DOUBLE_EQ(scans[2].stamp, 1.0);
  expectPoint(scans[2].cloud[0], 0, -1, 0, 0);
  EXPECT_TRUE((scans[2].pose * Eigen::Vector3d(0, -1, 0)).isApprox(Eigen::Vector3d(0, 0, 1), 1e-9));
}

TEST(UosScans, FaultyFilesAreRefused) {
  TempDir dir;
  dir.write("scan000.3d", "1 2 3\n4 5\n");
  EXPECT_TRUE(
      mentions(errorOf([&] { openUosScans(dir.path()); }), {"scan000.3d: has no pose", "scan000.pose"}));
  dir.write("scan000.pose", "1 2 3\n4 5\n");
  EXPECT_TRUE(mentions(errorOf([&] { openUosScans(dir.path()); }), {"scan000.pose: expected 6", "found 5"}));
  dir.write("scan000.pose", "1 2 3\n4 5 six\n");
  EXPECT_TRUE(mentions(errorOf([&] { openUosScans(dir.path()); }), {"scan000.pose:2:"}));
  dir.write("scan000.pose", "1 2 3\n4 5 6\n");
  dir.write("scan001.3d", "");
  dir.write("scan001.pose", "1 2 3\n4 5 6\n");
  const auto source = openUosScans(dir.path());
  EXPECT_TRUE(mentions(readError(*source), {"scan000.3d:2: expected a point"}));
  EXPECT_TRUE(mentions(readError(*source), {"scan001.3d: holds no points"}));
}

TEST(ScanGraph, PosesAndPoints) {
  TempDir dir;
  octomap::ScanGraph graph;
  for (int i = 0; i < 2; ++i) {
    auto* cloud = new octomap::Pointcloud;
    for (int k = 0; k <= i; ++k) cloud->push_back(1.0f + k, 2.0f, 3.0f);
    graph.addNode(cloud, octomap::pose6d(1, 2, 3, 0, 0, i * M_PI / 2));
  }
  graph.connectPrevious();
  ASSERT_TRUE(graph.writeBinary(dir.path("a.graph")));
  const auto source = openScanGraph(dir.path("a.graph"));
  ASSERT_EQ(source->size(), 2u);
  const auto scans = readAll(*source);
  ASSERT_EQ(scans[1].cloud.size(), 2u);
  expectPoint(scans[1].cloud[1], 2, 2, 3, 0);
  EXPECT_TRUE((scans[1].pose * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(1, 3, 3), 1e-6));
  EXPECT_DOUBLE_EQ(scans[1].stamp, 0.1);

  const auto size = std::filesystem::file_size(dir.path("a.graph"));
  std::filesystem::resize_file(dir.path("a.graph"), size / 2);
  EXPECT_TRUE(
      mentions(errorOf([&] { openScanGraph(dir.path("a.graph")); }), {"a.graph: at byte", "expected"}));
}

TEST(ScanGraph, ForeignFilesAreRefused) {
  TempDir dir;
  EXPECT_TRUE(
      mentions(errorOf([&] { openScanGraph(dir.path("none.graph")); }), {"none.graph: can't be read"}));
  EXPECT_TRUE(mentions(errorOf([&] { openScanGraph(dir.write("a.graph", "")); }), {"at byte 0"}));
  EXPECT_TRUE(
      mentions(errorOf([&] { openScanGraph(dir.write("a.graph", std::string(200, '\0'))); }), {"at byte 0"}));
  EXPECT_TRUE(mentions(
      errorOf([&] { openScanGraph(dir.write("a.graph", "# Octomap OcTree binary file\nid OcTree\n")); }),
      {"ScanGraph"}));
}

TEST(OpenScans, RecognisesTheFormatOrSaysWhatIsWrong) {
  TempDir dir;
  EXPECT_TRUE(mentions(errorOf([&] { openScans(dir.path("none")); }), {"no such file"}));
  EXPECT_TRUE(mentions(errorOf([&] { openScans(dir.path()); }), {"not recognised", ".pcd"}));
  EXPECT_TRUE(mentions(errorOf([&] { openScans(dir.write("a.txt", "")); }), {"not recognised"}));
  dir.write("1.bin", bin({1, 2, 3, 4}));
  EXPECT_TRUE(mentions(errorOf([&] { openScans(dir.path()); }), {"holds 0 pose files"}));
  dir.write("poses_icp.txt", std::string("1") + kIdentity);
  EXPECT_EQ(openScans(dir.path())->size(), 1u);
  dir.write("poses.txt", std::string("1") + kIdentity);
  EXPECT_TRUE(mentions(errorOf([&] { openScans(dir.path()); }), {"holds 2 pose files"}));
  EXPECT_EQ(openScans(dir.path(), dir.path("poses.txt"))->size(), 1u);
  dir.write("1.pcd", "");
  EXPECT_TRUE(mentions(errorOf([&] { openScans(dir.path()); }), {"several formats"}));
  std::filesystem::remove(dir.path("1.bin"));
  EXPECT_EQ(openScans(dir.path())->size(), 1u);
  EXPECT_TRUE(
      mentions(errorOf([&] { openScans(dir.path(), "p.txt"); }), {"p.txt: poses can be given for .bin"}));
}

/// Recordings that aren't part of the repository.
class Recordings : public testing::Test {
 protected:
  void SetUp() override {
    const char* variable = std::getenv("TEST_DATA_DIR");
    folder_ = variable ? variable : DEFAULT_TEST_DATA_DIR;
    if (!std::filesystem::is_directory(folder_))
      GTEST_SKIP() << "no recordings: neither TEST_DATA_DIR is set nor does " << folder_ << " exist";
  }
  std::string path(const std::string& name) const { return folder_ + "/" + name; }

  std::string folder_;
};

using Cells = std::set<std::array<int, 3>>;

/// Cells of 0.2 m that hold points of a scan beyond 1 m from the sensor.
Cells cellsInMap(const PosedScan& scan, const Eigen::Isometry3d& pose) {
  Cells cells;
  for (const auto& point : scan.cloud) {
    const Eigen::Vector3d p = point.getVector3fMap().cast<double>();
    if (!(p.norm() > 1.0)) continue;
    const Eigen::Vector3d q = (pose * p / 0.2).array().floor();
    cells.insert({static_cast<int>(q.x()), static_cast<int>(q.y()), static_cast<int>(q.z())});
  }
  return cells;
}

double overlap(const Cells& a, const Cells& b) {
  std::size_t common = 0;
  for (const auto& cell : a) common += b.count(cell);
  return static_cast<double>(common) / a.size();
}

TEST_F(Recordings, StreetInBinFiles) {
  const auto source = openScans(path("scans3d_street154"));
  EXPECT_EQ(source->size(), 77u);
  PosedScan scan;
  std::size_t points = 0;
  while (source->next(scan)) points += scan.cloud.size();
  EXPECT_EQ(points, 9384407u);
  EXPECT_EQ(scan.name, "0152.bin.xz");
  EXPECT_DOUBLE_EQ(scan.stamp, 15.2);
}

TEST_F(Recordings, KittiPairsInBinFiles) {
  const auto scans = readAll(*openScans(path("scans3d_kitti00_pairs")));
  ASSERT_EQ(scans.size(), 4u);
  EXPECT_DOUBLE_EQ(scans[0].stamp, 9.4);
  const auto first = cellsInMap(scans[0], scans[0].pose);
  EXPECT_GT(overlap(cellsInMap(scans[1], scans[1].pose), first),
            2.0 * overlap(cellsInMap(scans[2], scans[2].pose), first));
}

TEST_F(Recordings, SimulatedRoomInPcdFilesHasItsPointsInTheMapFrame) {
  const auto as_map = readAll(*openScans(path("scans3d_la3dm_sim")));
  const auto as_sensor = readAll(*openPcdScans(path("scans3d_la3dm_sim"), PcdFrame::kSensor));
  ASSERT_EQ(as_map.size(), 12u);
  EXPECT_EQ(as_map[9].name, "sim_structured_10.pcd");
  for (const auto& scan : as_map) {
    ASSERT_EQ(scan.cloud.size(), 3500u);
    for (const auto& point : scan.cloud)
      EXPECT_LT(point.getVector3fMap().norm(), 10.5) << scan.name;  // sensor's range
  }
  const auto agreement = [](const std::vector<PosedScan>& scans) {
    return overlap(cellsInMap(scans[6], scans[6].pose), cellsInMap(scans[4], scans[4].pose));
  };
  EXPECT_GT(agreement(as_map), 2.0 * agreement(as_sensor));
}

TEST_F(Recordings, UosScansAgreeBetterThanWithOtherConventions) {
  const auto scans = readAll(*openScans(path("scans3d_3dtk_dat")));
  ASSERT_EQ(scans.size(), 3u);
  const auto first = cellsInMap(scans[0], scans[0].pose);
  for (std::size_t i = 1; i < scans.size(); ++i) {
    EXPECT_NEAR(scans[i].cloud.size(), 81360.0, 5.0);
    Eigen::Isometry3d inverse_rotation(scans[i].pose.linear().transpose()), inverse_shift = scans[i].pose;
    inverse_rotation.translation() = scans[i].pose.translation();
    inverse_shift.translation() *= -1.0;
    const double agreement = overlap(cellsInMap(scans[i], scans[i].pose), first);
    std::cout << scans[i].name << ": " << agreement << ", inverse rotation "
              << overlap(cellsInMap(scans[i], inverse_rotation), first) << ", inverse shift "
              << overlap(cellsInMap(scans[i], inverse_shift), first) << '\n';
    EXPECT_GT(agreement, 1.1 * overlap(cellsInMap(scans[i], inverse_rotation), first));
    EXPECT_GT(agreement, 1.3 * overlap(cellsInMap(scans[i], inverse_shift), first));
  }
}

TEST_F(Recordings, OctoMapsScanGraph) {
  const auto source = openScans(path("octomap_samples/spherical_scan.graph"));
  EXPECT_EQ(source->size(), 1u);
  EXPECT_EQ(readFirst(*source).cloud.size(), 10201u);
  EXPECT_TRUE(mentions(errorOf([&] { openScanGraph(path("octomap_samples/geb079.bt")); }), {"ScanGraph"}));
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
