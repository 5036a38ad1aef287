// SPDX-License-Identifier: BSD-3-Clause
//
// Numbers, and the text formats: PTX, PTS, ASC.
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>

#include "zf/numbers.h"
#include "zf_test_reading.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

std::string errorOfFile(const std::string& bytes, const std::string& name, const ReadOptions& options = {}) {
  return errorOf([&] { MemoryFile(bytes, name, options).points(); });
}

// ----------------------------------------------------------------------------------------------------
// numbers

TEST(Numbers, AreThoseOfStrtod) {
  std::mt19937_64 random(1);
  std::vector<std::string> texts = {"0",
                                    "-0",
                                    "1",
                                    ".5",
                                    "5.",
                                    "-3.25e-7",
                                    "1e22",
                                    "1e23",
                                    "1e-400",
                                    "1e400",
                                    "-1e400",
                                    "9007199254740993",
                                    "1e-22",
                                    "0.1e1",
                                    "123456789012345678901234567890",
                                    "0.30000000000000004000000000001",
                                    "9.9999999999999995e-007",
                                    "-9.9643846577999532e+008"};
  for (int i = 0; i < 20000; ++i) {
    char text[64];
    std::uint64_t bits = random();
    double value;
    std::memcpy(&value, &bits, sizeof value);
    if (i % 2 == 0) value = std::ldexp(static_cast<double>(bits), -55);
    if (!std::isfinite(value)) continue;
    std::snprintf(text, sizeof text, i % 3 == 0 ? "%.17g" : i % 3 == 1 ? "%.6f" : "%g", value);
    if (std::strlen(text) < 60) texts.emplace_back(text);
  }
  for (const std::string& text : texts) {
    double value = 7.0;
    const char* end = parseNumber(text.data(), text.data() + text.size(), value);
    ASSERT_EQ(text.data() + text.size(), end) << text;
    ASSERT_EQ(std::strtod(text.c_str(), nullptr), value) << text;
  }
}

TEST(Numbers, EndWhereTheyEnd) {
  double value = 0.0;
  for (const char* text : {"", "-", "+", ".", "x", "e5", "+-1", "--1", ",1"}) {
    EXPECT_EQ(nullptr, parseNumber(text, text + std::strlen(text), value)) << text;
  }
  const std::string more = "+1.5x";
  EXPECT_EQ(more.data() + 4, parseNumber(more.data(), more.data() + more.size(), value));
  EXPECT_EQ(1.5, value);
  const std::string cut = "12345";  // what is beyond the end isn't read
  parseNumber(cut.data(), cut.data() + 2, value);
  EXPECT_EQ(12.0, value);
}

TEST(Numbers, OfALine) {
  double v[4];
  EXPECT_EQ(3u, parseNumbers("1 2.5\t-3", v, 4));
  EXPECT_EQ(2.5, v[1]);
  EXPECT_EQ(4u, parseNumbers(" 1, 2 ;3,4 , 5", v, 4));
  EXPECT_EQ(0u, parseNumbers("  ", v, 4));
  EXPECT_EQ(kNotNumbers, parseNumbers("1 2 x", v, 4));
  EXPECT_EQ(kNotNumbers, parseNumbers("1 2e 3", v, 4));
}

// ----------------------------------------------------------------------------------------------------
// PTX

const char* const kPtxHeader = "1 2 3\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n";

TEST(Ptx, GridPoseAndMissingPoints) {
  MemoryFile file(std::string("2\n3\n") + kPtxHeader +
                      "0 0 0 0.5\n1 2 3 0.25\n1.5 2.5 3.5 1\n0 0 0 0\n-1 -2e0 3 0.75\n7 8 9 0\n\n \n",
                  "a.ptx");
  ASSERT_EQ(1u, file.reader->scans().size());
  EXPECT_EQ(ScanFormat::kPtx, file.reader->format());
  const ScanInfo& info = file.reader->scans()[0];
  EXPECT_EQ(2u, info.columns);
  EXPECT_EQ(3u, info.rows);
  EXPECT_EQ(6u, info.points);
  EXPECT_TRUE(info.has_intensity);
  EXPECT_FALSE(info.has_colour);
  EXPECT_TRUE(file.reader->warnings().empty());
  // Row vectors: x' = x r11 + y r21 + z r31 + tr1.
  EXPECT_TRUE((info.pose * Eigen::Vector3d(1, 2, 3)).isApprox(Eigen::Vector3d(10 - 2, 20 + 1, 30 + 3)));

  const auto points = file.points();
  ASSERT_EQ(6u, points.size());
  EXPECT_FALSE(points[0].valid);
  EXPECT_FALSE(points[3].valid);
  EXPECT_TRUE(points[4].valid);
  EXPECT_EQ(0u, points[2].column);
  EXPECT_EQ(2u, points[2].row);
  EXPECT_EQ(1u, points[4].column);
  EXPECT_EQ(1u, points[4].row);
  EXPECT_EQ(-2.0, points[4].y);
  EXPECT_EQ(0.75F, points[4].intensity);
}

TEST(Ptx, SeveralScansWithOtherFieldsAndLineEnds) {
  const std::string second = std::string("1\r\n1\r\n") +
                             "0 0 0\r\n1 0 0\r\n0 1 0\r\n0 0 1\r\n1 0 0 0\r\n0 1 0 0\r\n" +
                             "0 0 1 0\r\n0 0 0 1\r\n 1  2\t3 0.5 255 128 0 0 0 1 \r\n";
  const std::string third = std::string("2\n1\n") + kPtxHeader + "0 0 0\n1 2 3 0.5 1 2 3";
  MemoryFile file(std::string("1\n1\n") + kPtxHeader + "1 2 3 0.5\n" + second + third, "a.txt");
  ASSERT_EQ(3u, file.reader->scans().size());
  EXPECT_FALSE(file.reader->scans()[0].has_colour);
  EXPECT_TRUE(file.reader->scans()[1].has_colour);
  EXPECT_TRUE(file.reader->scans()[2].has_colour);
  const auto points = file.points(1);
  ASSERT_EQ(1u, points.size());
  EXPECT_EQ(255, points[0].r);
  EXPECT_EQ(128, points[0].g);
  EXPECT_EQ(0, points[0].b);
  const auto last = file.points(2);
  ASSERT_EQ(2u, last.size());
  EXPECT_FALSE(last[0].valid);
  EXPECT_EQ(3, last[1].b);
}

TEST(Ptx, ScaleOfTheMatrixIsAppliedToThePoints) {
  MemoryFile file("1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 2 0\n5 6 7 1\n1 2 3 0.5\n",
                  "a.ptx");
  EXPECT_EQ(1u, file.reader->warnings().size());
  const auto points = file.points();
  const Eigen::Vector3d world =
      file.reader->scans()[0].pose * Eigen::Vector3d(points[0].x, points[0].y, points[0].z);
  EXPECT_TRUE(world.isApprox(Eigen::Vector3d(5 - 2, 6 + 1, 7 + 6)));
}

TEST(Ptx, MatrixThatCannotBeInvertedIsLeftOut) {
  MemoryFile file("1\n1\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 0\n1 2 3 0.5\n",
                  "a.ptx");
  EXPECT_FALSE(file.reader->scans()[0].has_pose);
  EXPECT_TRUE(mentions(file.reader->warnings().at(0), {"line 10", "matrix"}));
}

TEST(Ptx, MatrixOfTheOtherConvention) {
  const std::string begin = "1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
  MemoryFile file(begin + "0 -1 0 10\n1 0 0 20\n0 0 1 30\n0 0 0 1\n1 2 3 0.5\n", "a.ptx");
  EXPECT_TRUE(mentions(file.reader->warnings().at(0), {"line 10", "translation", "last column"}));
  EXPECT_TRUE((file.reader->scans()[0].pose * Eigen::Vector3d(1, 2, 3)).isApprox(Eigen::Vector3d(8, 21, 33)));

  const std::string both = errorOfFile(begin + "1 0 0 10\n0 1 0 20\n0 0 1 30\n1 0 0 1\n1 2 3 0.5\n", "a.ptx");
  EXPECT_TRUE(mentions(both, {"line 10", "no pose"}));
}

TEST(Ptx, SaysAtWhichLineItIsWrong) {
  const std::string start = std::string("2\n2\n") + kPtxHeader;
  EXPECT_TRUE(mentions(errorOfFile(start + "1 2 3 4\n1 2 3 4\n", "a.ptx"), {"line 13", "2 of 4 points"}));
  EXPECT_TRUE(mentions(errorOfFile(start + "1 2 3 4\n1 2 3 4\n1 2\n1 2 3 4\n", "a.ptx"), {"line 13"}));
  EXPECT_TRUE(mentions(errorOfFile(start + "1 2 3 4\n1 2 x 4\n1 2 3 4\n1 2 3 4\n", "a.ptx"), {"line 12"}));
  EXPECT_TRUE(
      mentions(errorOfFile(start + "1 2 3 4 5\n1 2 3 4 5\n1 2 3 4 5\n1 2 3 4 5\n", "a.ptx"), {"line 11"}));
  EXPECT_TRUE(mentions(errorOfFile("1\n1\n1 2 3\n1 0 0\n", "a.ptx"), {"line 5", "ends"}));
  EXPECT_TRUE(mentions(errorOfFile("2\n", "a.ptx"), {"line 2", "rows"}));
  EXPECT_TRUE(mentions(errorOfFile("2\nx\n", "a.ptx"), {"line 2", "rows"}));
  EXPECT_TRUE(
      mentions(errorOfFile(std::string("100000\n100000\n") + kPtxHeader, "a.ptx"), {"100000 x 100000"}));
  EXPECT_TRUE(
      mentions(errorOfFile(std::string("2\n2\n") + std::string(100000, ' ') + "1", "a.ptx"), {"line 3"}));
}

TEST(Ptx, TruncatedAnywhereIsAnErrorOrFewerWholeScans) {
  const std::string scan = std::string("1\n2\n") + kPtxHeader + "1 2 3 0.5\n4 5 6 0.25\n";
  const std::string whole = scan + scan;
  for (std::size_t size = 1; size < whole.size(); ++size) {
    bool complete = false;
    const std::string error = errorOf([&] {
      MemoryFile file(whole.substr(0, size), "a.ptx");
      for (std::size_t i = 0; i < file.reader->scans().size(); ++i) complete = file.points(i).size() == 2;
    });
    EXPECT_TRUE(complete || mentions(error, {"line "})) << size;
  }
}

TEST(Ptx, WithoutCells) {
  MemoryFile file(std::string("4000000000\n0\n") + kPtxHeader, "a.ptx");
  EXPECT_TRUE(file.points().empty());
}

// ----------------------------------------------------------------------------------------------------
// PTS

TEST(Pts, BlocksAreScans) {
  MemoryFile file("2\n1 2 3 -2048 1 2 3\n4 5 6 2047 4 5 6\n1\n7 8 9\n0\n", "a.pts",
                  withIntensity(IntensityScale::kNormalised));
  ASSERT_EQ(3u, file.reader->scans().size());
  EXPECT_EQ(ScanFormat::kPts, file.reader->format());
  const auto first = file.points(0), second = file.points(1);
  ASSERT_EQ(2u, first.size());
  EXPECT_EQ(0.0F, first[0].intensity);
  EXPECT_EQ(1.0F, first[1].intensity);
  EXPECT_EQ(6, first[1].b);
  ASSERT_EQ(1u, second.size());
  EXPECT_EQ(9.0, second[0].z);
  EXPECT_FALSE(file.reader->scans()[1].has_intensity);
  EXPECT_TRUE(file.points(2).empty());
}

TEST(Pts, WrongCountsAreWarnings) {
  MemoryFile more("1\n1 2 3\n4 5 6\n", "a.pts"), fewer("3\r\n1 2 3\r\n4 5 6\r\n", "a.pts");
  EXPECT_EQ(1u, more.points().size());
  EXPECT_EQ(2u, fewer.points().size());
  EXPECT_TRUE(mentions(more.reader->warnings().at(0), {"1 line after the 1 point"}));
  EXPECT_TRUE(mentions(fewer.reader->warnings().at(0), {"3 points", "after 2", "line 4"}));
}

TEST(Pts, ScaleOfIntensities) {
  const auto second = [](const std::string& values, IntensityScale scale, Limits limits = {0, 1}) {
    return MemoryFile("2\n" + values, "a.pts", withIntensity(scale, limits)).points()[1].intensity;
  };
  constexpr auto kNormalised = IntensityScale::kNormalised;
  EXPECT_FLOAT_EQ(0.5F, second("0 0 0 0.25\n0 0 0 0.5\n", kNormalised));
  EXPECT_FLOAT_EQ(51.0F / 255.0F, second("0 0 0 255\n0 0 0 51\n", kNormalised));
  EXPECT_FLOAT_EQ(2048.0F / 4095.0F, second("0 0 0 -1\n0 0 0 0\n", kNormalised));
  EXPECT_FLOAT_EQ(4000000.0F, second("0 0 0 1500\n0 0 0 4000000\n", kNormalised));
  EXPECT_FLOAT_EQ(0.75F, second("0 0 0 200\n0 0 0 150\n", IntensityScale::kLimits, {0, 200}));
  EXPECT_FLOAT_EQ(-255.0F, second("0 0 0 200\n0 0 0 -255\n", IntensityScale::kRaw));
}

TEST(Pts, WithoutTheNumberOfPoints) {
  MemoryFile file("# from somewhere\n1 2 3 0.5 10 20 30\n4 5 6 0.25 40 50 60\n2\n7 8 9\n10 11 12\n", "a.pts");
  ASSERT_EQ(2u, file.reader->scans().size());
  EXPECT_TRUE(mentions(file.reader->warnings().at(0), {"number of points isn't told"}));
  EXPECT_EQ(1u, file.reader->warnings().size());
  const auto points = file.points(0);
  ASSERT_EQ(2u, points.size());
  EXPECT_EQ(1.0, points[0].x);
  EXPECT_EQ(0.25F, points[1].intensity);
  EXPECT_EQ(60, points[1].b);
  EXPECT_EQ(12.0, file.points(1).at(1).z);
}

TEST(Pts, HeaderOfCloudCompare) {
  MemoryFile file(
      "//"
      "X;Y;Z;Rf;Gf;Bf;Intensity;Nx;Ny;Nz\n2\n0.5;-1.25;2.0;1;0.5;0.25;0.5;0;0;1\n1.5;1;2;0;0.2;1;0.25;0;1;"
      "0\n",
      "a.pts");
  EXPECT_TRUE(file.reader->warnings().empty());
  const auto points = file.points();
  ASSERT_EQ(2u, points.size());
  EXPECT_EQ(-1.25, points[0].y);
  EXPECT_EQ(255, points[0].r);
  EXPECT_EQ(128, points[0].g);
  EXPECT_EQ(64, points[0].b);
  EXPECT_EQ(51, points[1].g);
  EXPECT_EQ(0.25F, points[1].intensity);
}

TEST(Pts, ColumnsByParameter) {
  ReadOptions options;
  options.columns = "_ x y z i";
  MemoryFile file("2\n7 1 2 3 0.5 9\n8 4 5 6 0.25 9\n", "a.pts", options);
  EXPECT_EQ(ScanFormat::kPts, file.reader->format());
  const auto points = file.points();
  ASSERT_EQ(2u, points.size());
  EXPECT_EQ(4.0, points[1].x);
  EXPECT_EQ(0.25F, points[1].intensity);
  EXPECT_TRUE(mentions(errorOfFile("1\n1 2 3 4\n", "a.pts", options), {"line 2", "5 columns"}));
  EXPECT_TRUE(mentions(errorOfFile("1\n1 2 3 4 5\n", "a.pts"), {"line 2", "5 numbers", "columns"}));
}

TEST(Pts, ExactlyNothingIsMissing) {
  const auto points = MemoryFile("3\n0 0 0 0.5\n0 0.001 0 0.5\nnan 0 0 0.5\n", "a.pts").points();
  EXPECT_FALSE(points.at(0).valid);
  EXPECT_TRUE(points.at(1).valid);
  EXPECT_FALSE(points.at(2).valid);
}

TEST(Pts, SaysAtWhichLineItIsWrong) {
  EXPECT_TRUE(mentions(errorOfFile("2\n1 2 3 4\n1 2 3\n", "a.pts"), {"line 3", "4 numbers"}));
  EXPECT_TRUE(mentions(errorOfFile("2\n1 2\n1 2 3\n", "a.pts"), {"line 2"}));
  EXPECT_TRUE(mentions(errorOfFile("two\n1 2 3\n1 2 3\n", "a.pts"), {"line 1", "\"two\""}));
  EXPECT_TRUE(mentions(errorOfFile("# nothing\n", "a.pts"), {"without points"}));
}

// ----------------------------------------------------------------------------------------------------
// ASC

TEST(Asc, ColumnsByTheirNumber) {
  MemoryFile xyz("1 2 3\n4,5,6\n7;8;9\n", "a.asc");
  EXPECT_EQ(8.0, xyz.points()[2].y);
  EXPECT_FALSE(xyz.reader->scans()[0].has_intensity);
  EXPECT_EQ(0.5F, MemoryFile("1 2 3 0.5\n", "a.asc").points()[0].intensity);
  EXPECT_EQ(6, MemoryFile("1 2 3 4 5 6\n", "a.asc").points()[0].b);
  EXPECT_EQ(7, MemoryFile("1 2 3 4 5 6 7\n", "a.asc").points()[0].b);
  const auto zuf = MemoryFile("12 13 1 2 3 7 8 9\n", "a.asc").points();
  EXPECT_EQ(1.0, zuf[0].x);
  EXPECT_EQ(3.0, zuf[0].z);
  EXPECT_TRUE(mentions(errorOfFile("1 2 3 4 5\n", "a.asc"), {"5 columns"}));
}

TEST(Asc, ColumnsByParameter) {
  ReadOptions options;
  options.columns = "_ -x z y i";
  const auto points = MemoryFile("9 1 2 3 4\n", "a.asc", options).points();
  EXPECT_EQ(-1.0, points[0].x);
  EXPECT_EQ(3.0, points[0].y);
  EXPECT_EQ(2.0, points[0].z);
  EXPECT_EQ(4.0F, points[0].intensity);
  for (const char* wrong : {"x y", "x y z q", "x y z x", "x y z r", "x y z -i", "x y zz", "-"}) {
    options.columns = wrong;
    EXPECT_TRUE(mentions(errorOfFile("9 1 2 3 4\n", "a.asc", options), {wrong, "columns"})) << wrong;
  }
}

TEST(Asc, ColumnsByHeader) {
  const auto points =
      MemoryFile("//X Y Z R G B Scalar_Intensity Nx\n2\n1 2 3 4 5 6 0.5 1\n1 2 3 4 5 7 0.75 1\n", "a.asc")
          .points();
  ASSERT_EQ(2u, points.size());
  EXPECT_EQ(0.75F, points[1].intensity);
  EXPECT_EQ(7, points[1].b);
  EXPECT_EQ(3.0, MemoryFile("z, y, x\n1, 2, 3\n", "a.csv").points().at(0).x);
  // One of another number of columns is about something else.
  EXPECT_EQ(1.0, MemoryFile("# z y x and more\n1 2 3\n", "a.asc").points().at(0).x);
}

TEST(Asc, SkipsHeadersAndCountsThem) {
  MemoryFile file(
      "\xEF\xBB\xBF# x y z\n// exported\nX Y Z Intensity\n\n1.5 2 3 200\nbroken\n4 5 6 100\n7 8\n", "a.xyz",
      withIntensity(IntensityScale::kNormalised));
  const auto points = file.points();
  ASSERT_EQ(2u, points.size());
  EXPECT_FLOAT_EQ(200.0F / 255.0F, points[0].intensity);
  EXPECT_TRUE(mentions(file.reader->warnings().at(0), {"5 lines"}));
}

TEST(Asc, DecimalComma) {
  const auto points = MemoryFile("x y z i\n1,5 -2,25 3 7\n1,0\t2,5\t3,5\t8\n", "a.asc").points();
  ASSERT_EQ(2u, points.size());
  EXPECT_EQ(1.5, points[0].x);
  EXPECT_EQ(-2.25, points[0].y);
  EXPECT_EQ(7.0F, points[0].intensity);
  EXPECT_EQ(3.5, MemoryFile("1,5;2,5;3,5\n", "a.asc").points()[0].z);
  EXPECT_EQ(2.0, MemoryFile("1,2,3\n", "a.asc").points()[0].y);
  EXPECT_EQ(2.0, MemoryFile("1.5, 2, 3\n", "a.asc").points()[0].y);
}

TEST(Asc, PointsThatAreNoNumbersOrExactlyNothingAreMissing) {
  const auto points = MemoryFile("nan nan nan 0\n1 2 inf 1\n1 2 3 1\n0 0 0 1\n", "a.asc").points();
  ASSERT_EQ(4u, points.size());
  EXPECT_FALSE(points[3].valid);
  EXPECT_FALSE(points[0].valid);
  EXPECT_FALSE(points[1].valid);
  EXPECT_TRUE(points[2].valid);
}

TEST(Asc, LinesAreWholeAcrossBlocks) {
  std::string text;
  for (int i = 0; i < 200000; ++i) text += std::to_string(i) + " 1.25 -2.5 0.5\n";
  const auto points = MemoryFile(text, "a.asc").points();
  ASSERT_EQ(200000u, points.size());
  for (int i = 0; i < 200000; ++i) ASSERT_EQ(i, points[i].x);
}

TEST(Reading, StopsWhenToldTo) {
  std::string text;
  for (int i = 0; i < 200000; ++i) text += "1 2 3\n";
  MemoryFile file(text, "a.asc");
  int chunks = 0;
  EXPECT_FALSE(file.reader->read(0, [&](const auto&, double) { return ++chunks < 3; }));
  EXPECT_EQ(3, chunks);
  ReadOptions options;
  options.opening = [](double) { return false; };
  EXPECT_THROW(MemoryFile(text, "a.asc", options), ReadStopped);
}

// ----------------------------------------------------------------------------------------------------
// recognition

TEST(Recognition, ByContent) {
  const auto format = [](const std::string& bytes, const std::string& name) {
    return recogniseScanFile(*openMemory(bytes.data(), bytes.size()), name);
  };
  EXPECT_EQ(ScanFormat::kE57, format("ASTM-E57...", "a.txt"));
  EXPECT_EQ(ScanFormat::kPtx, format(std::string("2\n2\n") + kPtxHeader, "a.pts"));
  EXPECT_EQ(ScanFormat::kPts, format("2\n1 2 3\n", "a.ptx"));
  EXPECT_EQ(ScanFormat::kAsc, format("1 2 3\n", "a.ptx.asc"));
  EXPECT_EQ(ScanFormat::kAsc, format("1 2 3\n", "a"));
  EXPECT_EQ(ScanFormat::kPtx, format("2\n", "/x/A.PTX"));
}

TEST(Recognition, SaysWhatToDoWithNativeFiles) {
  for (const char* name : {"a.zfs", "a.zfc", "A.ZFS"}) {
    EXPECT_TRUE(mentions(errorOfFile("\1\2\3", name), {"LaserControl", "E57", "PTX", "PTS", "ASC"}));
  }
  EXPECT_TRUE(mentions(errorOfFile("ZFS\1\2", "a"), {"LaserControl"}));
  EXPECT_TRUE(mentions(errorOfFile("ZFSF\1\2", "a"), {"is neither"}));
  EXPECT_TRUE(mentions(errorOfFile("", "a.ptx"), {"empty"}));
  EXPECT_TRUE(
      mentions(errorOfFile("ncols 3\nnrows 2\nxllcorner 1\n605.1 605.2 605.3\n", "a.asc"), {"grid of ESRI"}));
  EXPECT_TRUE(mentions(errorOfFile("NROWS 3\n", "a.asc"), {"grid of ESRI"}));
  EXPECT_TRUE(mentions(errorOfFile("# .PCD v0.7\n1 2 3\n", "a.asc"), {"PCD"}));
  EXPECT_TRUE(mentions(errorOfFile("ply\nformat ascii 1.0\n", "a.xyz"), {"PLY"}));
  EXPECT_TRUE(mentions(errorOfFile("LASF\1\2", "a.xyz"), {"LAS"}));
  EXPECT_TRUE(mentions(errorOfFile("1 2 3\n", "a.e57"), {"ASTM-E57"}));
  EXPECT_TRUE(mentions(errorOfFile(std::string(1000, '\0'), "a.bin"), {"is neither"}));
  EXPECT_TRUE(mentions(errorOf([] { openScanFile("/does/not/exist.e57"); }),
                       {"/does/not/exist.e57", "No such file"}));
  EXPECT_TRUE(mentions(errorOf([] { openScanFile("/tmp"); }), {"/tmp"}));
}

}  // namespace
}  // namespace hokuyo_sick_drivers
