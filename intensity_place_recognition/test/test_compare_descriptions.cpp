// SPDX-License-Identifier: BSD-3-Clause
//
// compare_descriptions as a user runs it, on simulated streets.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <regex>
#include <string>

#include "intensity_place_recognition/pictures.h"
#include "test_street.h"

namespace intensity_place_recognition {
namespace {

class CompareDescriptions : public mapping_common::ToolTest {
 protected:
  CompareDescriptions() : ToolTest(COMPARE_DESCRIPTIONS) {
    // Three streets, each twice; images of the cameras are those of the streets, too.
    std::string poses;
    for (int i = 0; i < 6; ++i) {
      const Cloud cloud = Street(i % 3).scan(Street::at(0.0, 0.0, i < 3 ? 0.0 : M_PI));
      std::string bytes;
      for (const pcl::PointXYZI& p : cloud) {
        const float v[] = {p.x, p.y, p.z, p.intensity};
        bytes.append(reinterpret_cast<const char*>(v), sizeof(v));
      }
      std::filesystem::create_directories(dir_.path("scans"));
      dir_.write("scans/" + std::to_string(i) + ".bin", bytes);
      poses += std::to_string(i) + " 1 0 0 " + std::to_string(100 * (i % 3) + i / 3) + " 0 1 0 0 0 0 1 0\n";
      for (const double yaw : {0.0, M_PI}) {
        RectilinearView view;
        view.rotation = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
        const std::string folder = dir_.path(yaw == 0.0 ? "front" : "back");
        std::filesystem::create_directories(folder);
        cv::imwrite(folder + '/' + std::to_string(i) + ".png",
                    toPicture(rectilinear(toPanorama(cloud, {}, 4), view)));
      }
    }
    dir_.write("scans/poses.txt", poses);
    common_ = "--scans " + dir_.path("scans") + " --front " + dir_.path("front") + " --out " +
              dir_.path("out") + ' ';
  }
  std::string common_;
};

TEST_F(CompareDescriptions, TellsRecallAndPrecisionOfEachWayAndWhatHolds) {
  std::string ways;
  for (const char* way : {"image=intensity", "image=range", "views=front,image=intensity",
                          "views=front_and_back,image=intensity", "views=front_and_back,image=camera"})
    ways += std::string("--way type=hog,") + way + ' ';
  const std::string log = outputOf(common_ + "--back " + dir_.path("back") + ' ' + ways);
  // All around, streets are told apart by either image; ahead, one sees another part of the street than back.
  for (const char* row :
       {"| type=hog,image=intensity                      |                       100.0 |"
        "                       100.0 |",
        "| type=hog,views=front_and_back,image=camera    |                       100.0 |"
        "                       100.0 |",
        "- hog: intensity above range: no difference (100.0 / 100.0 % against 100.0 / 100.0 %)",
        "- hog: front and back above front: holds (100.0 / 100.0 % against "})
    EXPECT_NE(std::string::npos, log.find(row)) << row << " in\n" << log;
  EXPECT_NE(std::string::npos, log.find(mapping_common::readFile(dir_.path("out/comparison.md"))));
  const std::string curve = mapping_common::readFile(dir_.path("out/curve_00.csv"));
  EXPECT_EQ(0u, curve.find("# type=hog,image=intensity\nsimilarity,precision,recall\n")) << curve;
  EXPECT_NE(std::string::npos, curve.find(",1,1\n")) << curve;
  EXPECT_TRUE(std::filesystem::exists(dir_.path("out/curve_04.png")));
}

TEST_F(CompareDescriptions, CombinesWays) {
  const std::string log =
      outputOf(common_ + "--back " + dir_.path("back") +
               " --way verified --way type=polar:type=hog,image=range "
               "--way type=hog,image=intensity+type=hog,views=front_and_back,image=camera");
  const std::string table = std::regex_replace(log, std::regex(" +"), " ");
  // Parts are there as well, once each, and compared with the whole.
  for (const char* row :
       {"| verified | 100.0 | 100.0 |", "| type=polar |", "| type=hog,image=range | 100.0 |",
        "| type=polar:type=hog,image=range | 100.0 | 100.0 |", "| type=hog,image=intensity |",
        "| type=hog,image=intensity+type=hog,views=front_and_back,image=camera | 100.0 | 100.0 |",
        "- type=polar:type=hog,image=range above type=polar alone: ",
        "- type=hog,image=intensity+type=hog,views=front_and_back,image=camera above "
        "type=hog,image=intensity "
        "alone: no difference (100.0 / 100.0 % against 100.0 / 100.0 %)"})
    EXPECT_NE(std::string::npos, table.find(row)) << row << " in\n" << table;
  // A row a scan, of what it is verified to be alone.
  const std::string similarities = mapping_common::readFile(dir_.path("out/curve_00_similarities.csv"));
  EXPECT_EQ(6, std::count(similarities.begin(), similarities.end(), '\n')) << similarities;
  EXPECT_EQ("nan,nan,", similarities.substr(similarities.rfind('\n', similarities.size() - 2) + 1, 8))
      << similarities;
}

TEST_F(CompareDescriptions, SaysWhatIsWrong) {
  EXPECT_NE(std::string::npos,
            outputOf(common_ + "--way type=words,colour=red", 1).find("a description has no option colour"));
  EXPECT_NE(std::string::npos, outputOf(common_ + "--way type=surf", 1).find("'surf', allowed is polar"));
  EXPECT_NE(
      std::string::npos,
      outputOf("--scans " + dir_.path("scans") + " --back " + dir_.path("back"), 2).find("--back is beside"));
  EXPECT_NE(std::string::npos,
            outputOf(common_ + "--way type=hog:type=words:type=polar", 1).find("two ways are in turn"));
  EXPECT_NE(std::string::npos, outputOf(common_ + "--first 0", 2).find("--first is at least 1"));
  std::filesystem::remove(dir_.path("front/5.png"));
  EXPECT_NE(std::string::npos, outputOf(common_ + "--way type=hog,views=front,image=camera", 1)
                                   .find("front has fewer images than there are scans"));
}

}  // namespace
}  // namespace intensity_place_recognition
