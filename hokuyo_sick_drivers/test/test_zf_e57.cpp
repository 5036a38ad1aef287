// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "e57_test_file.h"
#include "zf_test_reading.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;

constexpr int kRecords = 3000;

template <class T, class Function>
std::vector<T> values(Function function, int count = kRecords) {
  std::vector<T> all;
  for (int i = 0; i < count; ++i) all.push_back(static_cast<T>(function(i)));
  return all;
}

std::string limits(const std::string& type, const std::string& min, const std::string& max) {
  return "<intensityLimits type=\"Structure\"><intensityMinimum type=\"" + type + ">" + min +
         "</intensityMinimum><intensityMaximum type=\"" + type + ">" + max +
         "</intensityMaximum></intensityLimits>";
}

std::string indexBounds(int row_min, int row_max, int column_min, int column_max) {
  const auto element = [](const std::string& name, int value) {
    return value == 0 ? '<' + name + " type=\"Integer\"/>"
                      : '<' + name + " type=\"Integer\">" + std::to_string(value) + "</" + name + '>';
  };
  return "<indexBounds type=\"Structure\">" + element("rowMinimum", row_min) +
         element("rowMaximum", row_max) + element("columnMinimum", column_min) +
         element("columnMaximum", column_max) + "</indexBounds>";
}

// x, y and z of all types, and what else is given.
E57TestScan scanWith(std::vector<E57TestField> more, int records = kRecords, const std::string& xml = "") {
  E57TestScan scan;
  scan.xml = xml;
  scan.records = static_cast<std::uint64_t>(records);
  scan.fields = {floatField("cartesianX", values<float>([](int i) { return 0.5F * i; }, records)),
                 scaledField("cartesianY", -100000, 100000, "scale=\"1e-003\" offset=\"5\"",
                             values<std::int64_t>([](int i) { return 7 * i - 9999; }, records)),
                 floatField("cartesianZ", values<double>([](int i) { return -1e-9 * i; }, records))};
  for (E57TestField& field : more) scan.fields.push_back(std::move(field));
  return scan;
}

std::string makeFile(const std::vector<E57TestScan>& scans, unsigned seed = 1) {
  return E57TestFile(seed).make(scans);
}

void expectPositions(const std::vector<ScanPoint>& points, int records = kRecords) {
  ASSERT_EQ(static_cast<std::size_t>(records), points.size());
  for (int i = 0; i < records; ++i) {
    ASSERT_EQ(0.5 * i, points[i].x);
    ASSERT_DOUBLE_EQ(1e-3 * (7 * i - 9999) + 5.0, points[i].y);
    ASSERT_EQ(-1e-9 * i, points[i].z);
  }
}

TEST(E57, StreamsMayBeCutAnywhere) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    E57TestFile writer(seed);
    writer.longest_part = seed < 5 ? 5 : 50 * seed * seed;
    // 1, 18 and 63 bits; strings and unknown fields between them
    const std::string bytes = writer.make({scanWith(
        {integerField("intensity", 0, 262143, values<std::int64_t>([](int i) { return 87 * i; })),
         stringField("nor:label", values<std::string>([](int i) { return std::string(i % 3, 'a'); })),
         integerField("cartesianInvalidState", 0, 1, values<std::int64_t>([](int i) { return i % 5 == 0; })),
         integerField("timeStamp", 0, std::numeric_limits<std::int64_t>::max(),
                      values<std::int64_t>([](int i) { return i; })),
         integerField("rowIndex", 3, 3, values<std::int64_t>([](int) { return 3; })),
         integerField("columnIndex", 0, kRecords,
                      values<std::int64_t>([](int i) { return kRecords - i; }))})});
    MemoryFile file(bytes, "a.e57");
    const auto points = file.points();
    expectPositions(points);
    EXPECT_EQ(1u, file.reader->scans()[0].rows);
    EXPECT_EQ(static_cast<std::uint32_t>(kRecords), file.reader->scans()[0].columns);
    for (int i = 0; i < kRecords; ++i) {
      ASSERT_EQ(87.0F * i, points[i].intensity);
      ASSERT_EQ(i % 5 != 0, points[i].valid);
      ASSERT_EQ(static_cast<std::uint32_t>(kRecords - 1 - i), points[i].column);
    }
  }
}

TEST(E57, IntegersOfAllWidths) {
  for (unsigned bits = 0; bits <= 64; ++bits) {
    const std::uint64_t range = bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
    const std::int64_t min = bits == 64 ? std::numeric_limits<std::int64_t>::min() : bits == 63 ? -5 : -7;
    const auto max = static_cast<std::int64_t>(static_cast<std::uint64_t>(min) + range);
    const auto raw = values<std::int64_t>([&](int i) {
      const std::uint64_t spread = static_cast<std::uint64_t>(i) * 0x9E3779B97F4A7C15U;
      return static_cast<std::int64_t>(static_cast<std::uint64_t>(min) + (spread & range));
    });
    MemoryFile file(makeFile({scanWith({integerField("intensity", min, max, raw, "Integer\"", bits < 64)})}),
                    "a.e57");
    const auto points = file.points();
    for (int i = 0; i < kRecords; ++i)
      ASSERT_EQ(static_cast<float>(raw[i]), points[i].intensity) << bits << ' ' << i;
  }
}

TEST(E57, Spherical) {
  E57TestScan scan;
  scan.records = 100;
  const auto range = values<double>([](int i) { return 1.0 + i; }, 100);
  const auto azimuth = values<double>([](int i) { return 0.06 * i - 3.0; }, 100);
  const auto elevation = values<double>([](int i) { return 0.03 * i - 1.5; }, 100);
  scan.fields = {floatField("sphericalAzimuth", azimuth), floatField("sphericalElevation", elevation),
                 floatField("sphericalRange", range),
                 floatField("sphericalInvalidState", values<float>([](int i) { return i % 3; }, 100))};
  const auto points = MemoryFile(makeFile({scan}), "a.e57").points();
  ASSERT_EQ(100u, points.size());
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(i % 3 == 0, points[i].valid);
    EXPECT_DOUBLE_EQ(range[i] * std::cos(elevation[i]) * std::cos(azimuth[i]), points[i].x);
    EXPECT_DOUBLE_EQ(range[i] * std::cos(elevation[i]) * std::sin(azimuth[i]), points[i].y);
    EXPECT_DOUBLE_EQ(range[i] * std::sin(elevation[i]), points[i].z);
  }
}

TEST(E57, LimitsOfIntensitiesOfAllTypes) {
  const auto raw = values<std::int64_t>([](int i) { return i % 101; });
  const auto read = [&](const E57TestField& field, const std::string& xml) {
    MemoryFile file(makeFile({scanWith({field}, kRecords, xml)}), "a.e57",
                    withIntensity(IntensityScale::kNormalised));
    return file.points()[25].intensity;
  };
  const E57TestField integers = integerField("intensity", 0, 100, raw);
  const E57TestField scaled = scaledField("intensity", 0, 100, "scale=\"0.5\"", raw);
  const E57TestField unbounded =
      integerField("intensity", std::numeric_limits<std::int64_t>::min(),
                   std::numeric_limits<std::int64_t>::max(), raw, "Integer\"", false);
  EXPECT_FLOAT_EQ(0.25F, read(integers, ""));
  EXPECT_FLOAT_EQ(0.5F, read(integers, limits("Integer\"", "", "50")));
  EXPECT_FLOAT_EQ(0.5F, read(integers, limits("Float\"", " 0\n", "5e+001")));
  EXPECT_FLOAT_EQ(0.5F, read(scaled, limits("ScaledInteger\" scale=\"0.5\"", "0", "50")));
  EXPECT_FLOAT_EQ(0.25F, read(scaled, limits("Float\"", "0", "0")));
  EXPECT_FLOAT_EQ(25.0F, read(unbounded, limits("Float\"", "", "")));
  MemoryFile unknown(makeFile({scanWith({unbounded})}), "a.e57", withIntensity(IntensityScale::kNormalised));
  EXPECT_TRUE(mentions(unknown.reader->warnings().at(0), {"limits"}));
  EXPECT_FLOAT_EQ(12.5F, MemoryFile(makeFile({scanWith({scaled})}), "a.e57").points()[25].intensity);
}

TEST(E57, ColoursAndWhatIsMarkedInvalid) {
  const auto sixteen = [](const std::string& name, int factor) {
    return integerField(name, 0, 65535, values<std::int64_t>([=](int i) { return factor * (i % 256); }));
  };
  const auto every = [](const std::string& name, int n) {
    return integerField(name, 0, 1, values<std::int64_t>([=](int i) { return i % n == 0; }));
  };
  const std::string colour_limits =
      "<colorLimits type=\"Structure\"><colorGreenMinimum type=\"Integer\"/><colorGreenMaximum "
      "type=\"Float\">255</colorGreenMaximum></colorLimits>";
  const auto points = MemoryFile(makeFile({scanWith({sixteen("colorRed", 257), sixteen("colorGreen", 1),
                                                     sixteen("colorBlue", 0), every("isColorInvalid", 7),
                                                     sixteen("intensity", 3), every("isIntensityInvalid", 5)},
                                                    kRecords, colour_limits)}),
                                 "a.e57")
                          .points();
  for (int i = 0; i < kRecords; ++i) {
    const int expected = i % 7 == 0 ? 0 : i % 256;
    ASSERT_EQ(expected, points[i].r);
    ASSERT_EQ(expected, points[i].g);
    ASSERT_EQ(0, points[i].b);
    ASSERT_EQ(i % 5 == 0, std::isnan(points[i].intensity));
  }
}

TEST(E57, RowsAndColumnsCountFromTheirBounds) {
  for (const int first : {0, 1}) {
    const auto row = values<std::int64_t>([=](int i) { return first + i % 3; }, 12);
    const auto column = values<std::int64_t>([=](int i) { return first + i / 3; }, 12);
    for (const bool told : {true, false}) {
      MemoryFile file(makeFile({scanWith({integerField("rowIndex", 0, 1023, row),
                                          integerField("columnIndex", 0, 1023, column)},
                                         12, told ? indexBounds(first, first + 2, first, first + 3) : "")}),
                      "a.e57");
      EXPECT_EQ(3u, file.reader->scans()[0].rows);
      EXPECT_EQ(4u, file.reader->scans()[0].columns);
      const auto points = file.points();
      EXPECT_EQ(1u, points[4].row);
      EXPECT_EQ(1u, points[4].column);
      EXPECT_EQ(2u, points[11].row);
      EXPECT_EQ(3u, points[11].column);
    }
  }
}

TEST(E57, PartsOfThePose) {
  const auto pose = [](const std::string& xml) {
    return MemoryFile(makeFile({scanWith({}, 3, "<pose type=\"Structure\">" + xml + "</pose>")}), "a.e57")
        .reader->scans()[0]
        .pose;
  };
  const std::string translation =
      "<translation type=\"Structure\"><x type=\"Float\">1</x><y type=\"Float\"/><z "
      "type=\"Float\">-3.5e+000</z></translation>";
  const std::string rotation =
      "<rotation type=\"Structure\"><w type=\"Float\"/><x type=\"Float\"/><y type=\"Float\"/><z "
      "type=\"Float\">2</z></rotation>";
  EXPECT_TRUE(pose("").isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_TRUE(pose(translation).translation().isApprox(Eigen::Vector3d(1, 0, -3.5)));
  EXPECT_TRUE(pose(translation).linear().isIdentity());
  EXPECT_TRUE((pose(rotation) * Eigen::Vector3d(1, 2, 3)).isApprox(Eigen::Vector3d(-1, -2, 3)));
  EXPECT_TRUE(
      (pose(rotation + translation) * Eigen::Vector3d(1, 2, 3)).isApprox(Eigen::Vector3d(0, -2, -0.5)));
  EXPECT_TRUE(pose("<rotation type=\"Structure\"/>").isApprox(Eigen::Isometry3d::Identity()));
}

TEST(E57, SeveralScansAndEmptyOnes) {
  E57TestFile writer;
  writer.namespaces =
      "xmlns=\"http://www.astm.org/COMMIT/E57/2010-e57-v1.0\" xmlns:nor=\"http://example.org\"";
  E57TestScan empty = scanWith({}, 0);
  const std::string name = "<name type=\"String\"><![CDATA[hall <1>]]></name>";
  MemoryFile file(writer.make({scanWith({}, 10), empty, scanWith({}, 20, name)}), "a.e57");
  ASSERT_EQ(3u, file.reader->scans().size());
  expectPositions(file.points(0), 10);
  EXPECT_TRUE(file.points(1).empty());
  expectPositions(file.points(2), 20);
  EXPECT_EQ("scan 1", file.reader->scans()[0].name);
  EXPECT_EQ("hall <1>", file.reader->scans()[2].name);
  EXPECT_TRUE(MemoryFile(E57TestFile().finish("<e57Root/>"), "a.e57").reader->scans().empty());
}

TEST(E57, DamagedPagesAreReportedOrRead) {
  std::string bytes = makeFile({scanWith({})});
  bytes[3 * 1024 + 17] = static_cast<char>(bytes[3 * 1024 + 17] ^ 4);
  EXPECT_TRUE(
      mentions(errorOf([&] { MemoryFile(bytes, "a.e57").points(); }), {"checksum", "page 3", "byte 3072"}));
  ReadOptions options;
  options.verify_checksums = false;
  MemoryFile file(bytes, "a.e57", options);
  EXPECT_EQ(static_cast<std::size_t>(kRecords), file.points().size());
  EXPECT_TRUE(mentions(file.reader->warnings().at(0), {"page 3"}));
}

TEST(E57, TruncatedAnywhereIsAnError) {
  const std::string bytes = makeFile({scanWith({}, 100)});
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_NE("", errorOf([&] { MemoryFile(bytes.substr(0, size), "a.e57"); })) << size;
  }
}

// Whatever byte is wrong: an error or points, never more. Checksums would find all of them, so they are
// ignored.
TEST(E57, WrongBytesDoNoHarm) {
  const std::string bytes = makeFile(
      {scanWith({integerField("rowIndex", 0, 99, values<std::int64_t>([](int i) { return i; }, 50)),
                 integerField("columnIndex", 0, 99, values<std::int64_t>([](int i) { return i; }, 50))},
                50)});
  ReadOptions options;
  options.verify_checksums = false;
  int errors = 0;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    for (const int change : {1, 128, 255}) {
      std::string wrong = bytes;
      wrong[at] = static_cast<char>(wrong[at] ^ change);
      errors += errorOf([&] {
                  MemoryFile file(wrong, "a.e57", options);
                  for (std::size_t i = 0; i < file.reader->scans().size(); ++i) file.points(i);
                }) != "";
    }
  }
  EXPECT_GT(errors, 1000);
}

TEST(E57, WhatAFileCannotHoldIsRefused) {
  const auto error = [](const E57TestScan& scan) {
    return errorOf([&] { MemoryFile(makeFile({scan}), "a.e57").points(); });
  };
  E57TestScan scan = scanWith({}, 100);
  scan.records = 1ULL << 60U;
  EXPECT_TRUE(mentions(error(scan), {"1152921504606846976 points", "can't hold"}));
  scan.records = 101;  // there is room for it in the headers of the packets
  EXPECT_TRUE(mentions(error(scan), {"ends in the field cartesianX after"}));
  scan.records = 1ULL << 40U;
  for (E57TestField& field : scan.fields) field = integerField(field.element.substr(1, 10), 1, 1, {});
  EXPECT_TRUE(mentions(error(scan), {"can't hold"}));
  scan = scanWith({}, 100);
  scan.fields.pop_back();
  EXPECT_TRUE(mentions(error(scan), {"neither"}));
  const auto xml_error = [](const std::string& xml) {
    return errorOf([&] { MemoryFile(E57TestFile().finish(xml), "a.e57"); });
  };
  EXPECT_TRUE(mentions(xml_error("<e57Root><data3D>"), {"XML", "XML_ERROR"}));
  EXPECT_TRUE(mentions(xml_error("<root/>"), {"e57Root"}));
  const std::string field = "<e57Root><data3D><a><points recordCount=\"1\"><prototype><x type=\"Integer\" ";
  const std::string end = "/></prototype></points></a></data3D></e57Root>";
  EXPECT_TRUE(mentions(xml_error(field + "minimum=\"2\" maximum=\"1\"" + end), {"minimum"}));
  EXPECT_TRUE(mentions(xml_error(field + "minimum=\"zwei\"" + end), {"zwei"}));
}

// As some programs write points where nothing was measured.
TEST(E57, ExactlyNothingIsMissingWhereThereIsNoState) {
  const std::vector<float> x = {1.0F, 0.0F, 2.0F, 0.0F};
  const auto cartesian = [&](std::vector<E57TestField> more) {
    E57TestScan scan;
    scan.records = 4;
    scan.fields = {floatField("cartesianX", x), floatField("cartesianY", std::vector<float>(4, 0.0F)),
                   floatField("cartesianZ", std::vector<float>{0.0F, 0.0F, 1.0F, 0.0F})};
    for (E57TestField& field : more) scan.fields.push_back(std::move(field));
    return scan;
  };
  E57TestScan spherical;
  spherical.records = 4;
  spherical.fields = {floatField("sphericalRange", x),
                      floatField("sphericalAzimuth", std::vector<float>(4, 0.5F)),
                      floatField("sphericalElevation", std::vector<float>(4, 0.25F))};
  const auto grid = {integerField("rowIndex", 0, 1, {0, 1, 0, 1}),
                     integerField("columnIndex", 0, 1, {0, 0, 1, 1})};
  MemoryFile file(makeFile({cartesian({}), cartesian(grid), spherical,
                            cartesian({integerField("cartesianInvalidState", 0, 2, {0, 0, 2, 1})})}),
                  "a.e57");
  const auto valid = [&](std::size_t scan) {
    std::vector<bool> all;
    for (const ScanPoint& point : file.points(scan)) all.push_back(point.valid);
    return all;
  };
  const std::vector<bool> measured = {true, false, true, false};
  for (const std::size_t scan : {0, 1, 2}) EXPECT_EQ(valid(scan), measured) << scan;
  EXPECT_EQ(valid(3), (std::vector<bool>{true, true, false, false})) << "a state knows better";
}

TEST(E57, NamespaceThatIsDeclaredTwice) {
  const std::string nor = " xmlns:nor=\"http://www.libe57.org/E57_NOR_surface_normals.txt\"";
  E57TestFile test_file;
  test_file.namespaces += nor + "\n" + nor;
  MemoryFile file(test_file.make({scanWith({})}), "a.e57");
  expectPositions(file.points());
  EXPECT_TRUE(mentions(file.reader->warnings().at(0), {"xmlns:nor", "twice"}));

  E57TestFile other;
  other.namespaces += nor + " xmlns:nor='other'";
  EXPECT_TRUE(mentions(errorOf([&] { MemoryFile(other.make({scanWith({})}), "a.e57"); }),
                       {"xmlns:nor", "twice", "normals.txt", "other"}));
  for (const char* root :
       {"<e57Root", "<e57Root ", "<e57Root a", "<e57Root a=", "<e57Root a=\"", "<e57Root xmlns=\"b\" xmlns"})
    EXPECT_TRUE(mentions(errorOf([&] { MemoryFile(E57TestFile().finish(root), "a.e57"); }), {"XML"})) << root;
}

}  // namespace
}  // namespace hokuyo_sick_drivers
