// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "mapping_common/archive.h"
#include "mapping_common/files.h"
#include "mapping_common/testing/temp_dir.h"

namespace mapping_common {
namespace {

enum class Colour { kRed, kBlue };
constexpr auto choicesOf(Colour) {
  return choices<Colour>({{"red", Colour::kRed}, {"blue", Colour::kBlue}});
}

struct Paint {
  double thickness = 0.1;
  int layers = 2;
  bool gloss = false;
  std::string name = "wall paint";
  Colour colour = Colour::kRed;
  void describe(OptionList& o) {
    o("thickness", thickness, "mm", "").above(0.0).orUnlimited();
    o("layers", layers, "", "");
    o("gloss", gloss, "", "");
    o("name", name, "", "");
    o("colour", colour, "", "");
  }
};

struct Older {  // has yet to hear of colours
  double thickness = 0.3;
  void describe(OptionList& o) { o("thickness", thickness, "mm", ""); }
};

const ArchiveFormat kFormat = {"PAINTBOX", "a paint box", 2, 4, 2};

class Archive : public ::testing::Test {
 protected:
  template <class Options>
  void write(Options options) {
    writeArchive(path_, kFormat, [&](ArchiveWriter& write) { write(optionsOf(options)); });
  }
  template <class Options>
  Options read() {
    Options options;
    readArchive(path_, kFormat, [&](ArchiveReader& read) { read(optionsOf(options)); });
    return options;
  }
  std::string refusal(const std::string& bytes) {
    dir_.write("a", bytes);
    return errorOf(
        [this] { readArchive(path_, kFormat, [](ArchiveReader& read) { read.next<std::uint64_t>(); }); });
  }
  const TempDir dir_;
  const std::string path_ = dir_.path("a");
};

TEST_F(Archive, HoldsWhatWasWritten) {
  const std::vector<std::int16_t> many(200000, -7);
  writeArchive(path_, kFormat, [&](ArchiveWriter& write) {
    write(0.1);
    write(true);
    write(std::string("text"));
    write(many);
    write(many);
    for (int i = 0; i < 100000; ++i) write(i);
  });
  readArchive(path_, kFormat, [&](ArchiveReader& read) {
    EXPECT_EQ(4u, read.version());
    EXPECT_EQ(0.1, read.next<double>());
    EXPECT_TRUE(read.next<bool>());
    EXPECT_EQ("text", read.next<std::string>());
    EXPECT_EQ(many, read.next<std::vector<std::int16_t>>());
    EXPECT_EQ(many, read.next<std::vector<std::int16_t>>());
    for (int i = 0; i < 100000; ++i) ASSERT_EQ(i, read.next<int>());
  });
}

TEST_F(Archive, IsTheSameInMemory) {
  const auto write = [](ArchiveWriter& to) { to(std::string("text")); };
  writeArchive(path_, kFormat, write);
  const std::string bytes = toArchive(kFormat, write);
  EXPECT_EQ(readFile(path_), bytes);
  const auto read = [&](std::size_t size) {
    std::string text;
    readArchive(bytes.data(), bytes.data() + size, "the message", kFormat,
                [&](ArchiveReader& from) { from(text); });
    return text;
  };
  EXPECT_EQ("text", read(bytes.size()));
  EXPECT_TRUE(mentions(errorOf([&] { read(7); }), {"the message was not loaded", "isn't a paint box"}));
  EXPECT_TRUE(mentions(errorOf([&] { read(20); }), {"the message was not loaded", "truncated"}));
}

TEST_F(Archive, HoldsOptionsByName) {
  Paint paint;
  paint.thickness = 1.0 / 3.0;
  paint.gloss = true;
  paint.name = "1";
  paint.colour = Colour::kBlue;
  write(paint);
  const Paint read_paint = read<Paint>();
  EXPECT_EQ(paint.thickness, read_paint.thickness);
  EXPECT_TRUE(read_paint.gloss);
  EXPECT_EQ("1", read_paint.name);
  EXPECT_EQ(Colour::kBlue, read_paint.colour);
  paint.thickness = std::numeric_limits<double>::infinity();
  write(paint);
  EXPECT_EQ(paint.thickness, read<Paint>().thickness);
}

TEST_F(Archive, OptionsThatAreNewerThanAFileHaveTheirDefaults) {
  write(Older());
  EXPECT_EQ(0.3, read<Paint>().thickness);
  EXPECT_EQ("wall paint", read<Paint>().name);
  write(Paint());
  EXPECT_TRUE(
      mentions(errorOf([this] { read<Older>(); }), {path_.c_str(), "an option layers", "doesn't know"}));
}

TEST_F(Archive, OtherFilesAreRefused) {
  writeArchive(path_, kFormat, [](ArchiveWriter& write) { write(std::uint64_t(5)); });
  const std::string bytes = readFile(path_);
  ASSERT_EQ(28u, bytes.size());
  EXPECT_EQ("", refusal(bytes));
  EXPECT_TRUE(mentions(refusal(""), {"/a was not loaded", "isn't a paint box"}));
  EXPECT_TRUE(mentions(refusal("PAINTBALL"), {"isn't a paint box"}));
  EXPECT_TRUE(mentions(refusal("PAINTBOX"), {"truncated"}));
  for (std::size_t size = 8; size < bytes.size(); ++size)
    EXPECT_TRUE(mentions(refusal(bytes.substr(0, size)), {"truncated"})) << size;
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string broken = bytes;
    broken[bit / 8] = static_cast<char>(broken[bit / 8] ^ 1 << bit % 8);
    EXPECT_NE("", refusal(broken)) << bit;
  }
  std::string other = bytes;
  other[8] = 5;
  EXPECT_TRUE(mentions(refusal(other), {"format version 5, this program reads 2 to 4"}));
  other[8] = 1;
  EXPECT_TRUE(mentions(refusal(other), {"format version 1, this program reads 2 to 4"}));
  EXPECT_TRUE(mentions(errorOf([] { readArchive("/nowhere", kFormat, [](ArchiveReader&) {}); }),
                       {"/nowhere can't be opened", "No such file"}));
}

// CRC-32 of "PAINTBOX", version 2 and eight zeros, by Python's zlib.
TEST_F(Archive, OlderVersionsHaveACrc) {
  const std::string bytes("PAINTBOX\2\0\0\0\0\0\0\0\0\0\0\0\xaa\x7e\x67\xc8", 24);
  EXPECT_EQ("", refusal(bytes));
  EXPECT_TRUE(mentions(refusal(bytes.substr(0, 23) + "x"), {"checksum"}));
}

TEST_F(Archive, HasToBeReadAsAWhole) {
  writeArchive(path_, kFormat, [](ArchiveWriter& write) { write(std::uint64_t(1) << 60), write(1); });
  const auto error = [this](auto read) { return errorOf([&] { readArchive(path_, kFormat, read); }); };
  EXPECT_TRUE(mentions(error([](ArchiveReader& read) { read.next<double>(); }), {"more than it says"}));
  EXPECT_TRUE(mentions(error([](ArchiveReader& read) { read.next<std::vector<int>>(); }), {"inconsistent"}));
  EXPECT_TRUE(
      mentions(error([](ArchiveReader& read) { read.next<std::array<char, 100>>(); }), {"truncated"}));
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
