// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <filesystem>
#include <stdexcept>

#include "mapping_common/files.h"
#include "mapping_common/testing/temp_dir.h"

namespace mapping_common {
namespace {

TEST(Files, WrittenIsRead) {
  const TempDir dir;
  const std::string bytes("a\0b\r\n", 5);
  writeFile(dir.path("f"), [&](std::ostream& out) { out << bytes; });
  EXPECT_EQ(bytes, readFile(dir.path("f")));
  writeFile(dir.path("f"), [](std::ostream&) {});
  EXPECT_EQ("", readFile(dir.path("f")));
}

TEST(Files, AFailureLeavesTheOldOne) {
  const TempDir dir;
  dir.write("f", "old");
  EXPECT_THROW(writeFile(dir.path("f"),
                         [](std::ostream& out) {
                           out << "new";
                           throw std::logic_error("no");
                         }),
               std::logic_error);
  EXPECT_NE("", errorOf([&] {
              writeFile(dir.path("f"), [](std::ostream& out) { out.setstate(std::ios::failbit); });
            }));
  EXPECT_EQ("old", readFile(dir.path("f")));
  EXPECT_EQ(1, std::distance(std::filesystem::directory_iterator(dir.path()), {}));
}

TEST(Files, ErrorsNameTheFile) {
  EXPECT_TRUE(mentions(errorOf([] { writeFile("/nowhere/f", [](std::ostream&) {}); }),
                       {"/nowhere/f", "No such file"}));
  EXPECT_TRUE(mentions(errorOf([] { readFile("/nowhere/f"); }), {"/nowhere/f", "No such file"}));
}

TEST(Files, EndingsOfOtherProgramsAreRefused) {
  for (const char* own : {"/a/room.map", "/a/room", "/a.bt/room", "bt", ""})
    EXPECT_NO_THROW(requireOwnEnding(own)) << own;
  for (const char* foreign : {"/a/room.bt", "/a/room.ot", "room.pgm", ".png"})
    EXPECT_THROW(requireOwnEnding(foreign), std::invalid_argument) << foreign;
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
