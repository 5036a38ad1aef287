// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "mapping_common/files.h"
#include "mapping_common/map_image.h"
#include "mapping_common/testing/temp_dir.h"

namespace mapping_common {
namespace {

MapImage imageOf3x2() {
  MapImage image;
  image.width = 3;
  image.height = 2;
  image.resolution = 0.05;
  image.origin_x = -1.25;
  image.origin_y = 7.0;
  image.pixels = {MapImage::kOccupied, MapImage::kFree, MapImage::kUnknown, 1, 2, 3};
  return image;
}

TEST(MapImage, IsWhatMapServerReads) {
  const std::string pgm("P5\n3 2\n255\n\0\xfe\xcd\1\2\3", 17);
  const char* const yaml =
      "image: a.pgm\nresolution: 0.05\norigin: [-1.25, 7, 0]\nnegate: 0\noccupied_thresh: 0.65\n"
      "free_thresh: 0.196\n";
  for (const char* name : {"a.pgm", "a.yaml"}) {
    const TempDir dir;
    writeMapImage(dir.path(name), imageOf3x2());
    EXPECT_EQ(pgm, readFile(dir.path("a.pgm")));
    EXPECT_EQ(yaml, readFile(dir.path("a.yaml")));
  }
}

TEST(MapImage, NamesThatYamlTakesForMoreAreQuoted) {
  const TempDir dir;
  writeMapImage(dir.path("it's #1: x.pgm"), imageOf3x2());
  EXPECT_TRUE(mentions(readFile(dir.path("it's #1: x.yaml")), {"image: 'it''s #1: x.pgm'\n"}));
}

TEST(MapImage, ErrorsNameTheFile) {
  EXPECT_TRUE(mentions(errorOf([] { writeMapImage("/nowhere/a.pgm", imageOf3x2()); }), {"/nowhere/a.pgm"}));
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
