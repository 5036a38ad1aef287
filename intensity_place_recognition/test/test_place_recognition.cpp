// SPDX-License-Identifier: BSD-3-Clause
//
// place_recognition as a user runs it: on simulated streets, and on recordings.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/tool_test.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "test_street.h"

namespace intensity_place_recognition {
namespace {

struct Row {
  int query, match, accepted;
  double score, x, y, z, yaw;
};

class PlaceRecognition : public mapping_common::ToolTest {
 protected:
  PlaceRecognition() : ToolTest(PLACE_RECOGNITION) {}

  std::vector<Row> rows(const std::string& out) const {
    std::istringstream in(mapping_common::readFile(dir_.path(out + "/places.csv")));
    std::string line;
    std::getline(in, line);
    EXPECT_EQ("query,match,score,accepted,x,y,z,qx,qy,qz,qw,evidence,margin,pieces,refused", line);
    std::vector<Row> rows;
    while (std::getline(in, line)) {
      Row r{};
      double qx, qy, qz, qw;
      EXPECT_EQ(11, std::sscanf(line.c_str(), "%d,%d,%lf,%d,%lf,%lf,%lf,%lf,%lf,%lf,%lf", &r.query, &r.match,
                                &r.score, &r.accepted, &r.x, &r.y, &r.z, &qx, &qy, &qz, &qw));
      r.yaw = 2.0 * std::atan2(qz, qw);
      rows.push_back(r);
    }
    return rows;
  }
  void write(const std::string& name, const Cloud& cloud) const {
    std::filesystem::create_directories(std::filesystem::path(dir_.path(name)).parent_path());
    std::string bytes;
    for (const pcl::PointXYZI& p : cloud) {
      const float v[] = {p.x, p.y, p.z, p.intensity};
      bytes.append(reinterpret_cast<const char*>(v), sizeof(v));
    }
    dir_.write(name, bytes);
  }
};

TEST_F(PlaceRecognition, FindsVisitsInFoldersInWhateverOrder) {
  write("first/0.bin", Street(1).scan(Street::at(0.0, 0.0, 0.0)));
  write("first/1.bin", Street(2).scan(Street::at(0.0, 0.0, 0.0)));
  write("second/8.bin", {});
  dir_.write("second/8.bin", std::string(16, '\0'));  // a point, but not of a scan
  write("second/9.bin", Street(2).scan(Street::at(1.0, 0.5, -2.0)));
  const std::string a = dir_.path("first"), b = dir_.path("second");
  const std::string log = outputOf("--scans " + a + ' ' + b + " --out " + dir_.path("out"));
  EXPECT_NE(std::string::npos, log.find("8.bin is left out: none of the cloud's 1 points was measured"))
      << log;
  EXPECT_NE(std::string::npos, log.find("3 of 4 scans described, 1 recognised")) << log;
  const std::vector<Row> found = rows("out");
  ASSERT_EQ(4u, found.size());
  for (int i = 0; i < 4; ++i) EXPECT_EQ(i == 3, found[i].accepted == 1) << i;
  EXPECT_EQ(-1, found[0].match);
  EXPECT_EQ(1, found[3].match);
  EXPECT_NEAR(1.0, found[3].x, 0.1);
  EXPECT_NEAR(0.5, found[3].y, 0.1);
  EXPECT_NEAR(-2.0, found[3].yaw, 0.01);
  for (const char* file : {"scans.csv", "similarity.csv", "similarity.png", "times.csv", "pairs/3_1.png"})
    EXPECT_TRUE(std::filesystem::exists(dir_.path(std::string("out/") + file))) << file;

  outputOf("--scans " + b + " --scans " + a + " --out " + dir_.path("again"));
  EXPECT_EQ(mapping_common::readFile(dir_.path("out/places.csv")),
            mapping_common::readFile(dir_.path("again/places.csv")));
}

// Of a terrestrial scanner's file: two stations, of which nothing says how they are connected.
std::string ptx(const std::vector<Cloud>& stations) {
  std::ostringstream out;
  for (const Cloud& cloud : stations) {
    out << cloud.size() << "\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    for (const pcl::PointXYZI& p : cloud)
      out << p.x << ' ' << p.y << ' ' << p.z << ' ' << std::clamp(p.intensity, 0.0f, 1.0f) << '\n';
  }
  return out.str();
}

TEST_F(PlaceRecognition, FindsStationsInScanFiles) {
  std::filesystem::create_directories(dir_.path("tls"));
  const std::string b = dir_.write("tls/b.ptx", ptx({Street(2).scan(Street::at(1.0, 0.5, -2.0))}));
  const std::string a =
      dir_.write("tls/a.ptx",
                 ptx({Street(1).scan(Street::at(0.0, 0.0, 0.0)), Street(2).scan(Street::at(0.0, 0.0, 0.0))}));
  dir_.write("tls/c.e57", "nothing of the kind");
  const std::string log = outputOf("--files " + dir_.path("tls") + " --out " + dir_.path("out"));
  EXPECT_NE(std::string::npos, log.find("3 of 4 scans described, 1 recognised")) << log;
  EXPECT_NE(std::string::npos, log.find("scan 3 is left out: ")) << log;
  EXPECT_NE(std::string::npos, log.find("c.e57")) << log;
  const std::vector<Row> found = rows("out");
  ASSERT_EQ(4u, found.size());
  for (int i = 0; i < 4; ++i) EXPECT_EQ(i == 2, found[i].accepted == 1) << i;
  EXPECT_EQ(1, found[2].match);
  EXPECT_NEAR(1.0, found[2].x, 0.1);
  EXPECT_NEAR(0.5, found[2].y, 0.1);
  EXPECT_NEAR(-2.0, found[2].yaw, 0.01);

  outputOf("--files " + b + ' ' + a + " --out " + dir_.path("again"));
  EXPECT_EQ(found[2].x, rows("again").at(2).x);
}

// A window of a room, which says too little by itself: the reason is told.
TEST_F(PlaceRecognition, TellsWhyAScanOfARoomIsRefused) {
  const std::string path = mapping_common::findRecording("tls_formats/pumpA.e57");
  if (path.empty()) GTEST_SKIP() << mapping_common::withoutRecording("tls_formats/pumpA.e57");
  std::filesystem::create_directories(dir_.path("again"));
  std::filesystem::copy(path, dir_.path("again"));
  const std::string files = "--files " + path + ' ' + dir_.path("again");
  outputOf(files + " --out " + dir_.path("out"));
  EXPECT_EQ(0, rows("out").at(1).accepted);
  EXPECT_NE(std::string::npos,
            mapping_common::readFile(dir_.path("out/places.csv"))
                .find("cubes of 2 m with surfaces that both see, less than min_pieces 120"));
  const std::string config = dir_.write("few.yaml", "registration: {min_pieces: 10}\n");
  outputOf(files + " --config " + config + " --out " + dir_.path("few"));
  EXPECT_EQ(1, rows("few").at(1).accepted);
}

TEST_F(PlaceRecognition, MeasuresPrecisionAndRecallByPoses) {
  std::string poses;
  for (int i = 0; i < 4; ++i) {
    write("drive/" + std::to_string(i) + ".bin", Street(i / 2).scan(Street::at(0.6 * (i % 2), 0.0, 0.0)));
    poses +=
        std::to_string(i) + " 1 0 0 " + std::to_string(100 * (i / 2) + 0.6 * (i % 2)) + " 0 1 0 0 0 0 1 0\n";
  }
  const std::string log = outputOf("--scans " + dir_.path("drive") + " --poses " +
                                   dir_.write("p.txt", poses) + " --out " + dir_.path("out"));
  EXPECT_NE(std::string::npos, log.find("2 scans show an earlier place")) << log;
  EXPECT_NE(std::string::npos, log.find("precision 100.0 %, recall 100.0 %")) << log;
  EXPECT_TRUE(std::filesystem::exists(dir_.path("out/precision_recall.png")));
}

TEST_F(PlaceRecognition, SaysWhatIsWrong) {
  EXPECT_NE(std::string::npos, outputOf("", 2).find("give either --scans, --files or --bag"));
  EXPECT_NE(std::string::npos, outputOf("--scans /nowhere", 1).find("/nowhere: no such file or folder"));
  std::filesystem::create_directory(dir_.path("empty"));
  EXPECT_NE(std::string::npos, outputOf("--scans " + dir_.path("empty"), 1).find("not recognised"));
}

// KITTI 08: a place that is driven by in reverse, and scans of other places, of KITTI and of a Livox scanner.
TEST_F(PlaceRecognition, OfRecordingsDrivenTheOtherWay) {
  std::string folders;
  for (const char* name : {"place_scans/helipr_avia", "place_scans/kitti_00_full", "place_scans/ssc_kitti08",
                           "scans3d_kitti00_pairs"}) {
    const std::string path = mapping_common::findRecording(name);
    if (path.empty()) GTEST_SKIP() << mapping_common::withoutRecording(name);
    folders += ' ' + path;
  }
  outputOf("--scans" + folders + " --out " + dir_.path("out"));
  const std::vector<Row> found = rows("out");
  ASSERT_EQ(12u, found.size());
  // Scans of one drive that are 0.5 to 3.6 m apart, and the reverse pair; nothing else.
  const std::vector<int> accepted = {1, 4, 7, 9, 11};
  for (const Row& row : found) {
    const bool expected = std::count(accepted.begin(), accepted.end(), row.query) > 0;
    EXPECT_EQ(expected, row.accepted == 1) << row.query << ", score " << row.score;
    if (expected) {
      EXPECT_EQ(row.query - 1, row.match);
    }
  }
  EXPECT_NEAR(-148.5, found[7].yaw * 180.0 / M_PI, 2.0);
  EXPECT_NEAR(-1.81, found[7].x, 0.15);
  EXPECT_NEAR(-1.71, found[7].y, 0.15);
}

}  // namespace
}  // namespace intensity_place_recognition
