// SPDX-License-Identifier: BSD-3-Clause
//
// How fast scans are read: bench_zf FILE... prints MB/s and points/s of each, from the second of two
// readings, so that the disk isn't measured. bench_zf --generate ROWS COLUMNS FILE.ptx|FILE.e57 writes a scan
// of a room to measure with.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "../test/e57_test_file.h"
#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"
#include "mapping_common/files.h"

namespace hokuyo_sick_drivers {
namespace {

// A scanner in the middle of a room of 10 x 8 x 3 m, with a hole in the ceiling.
// @param use called for each cell, column by column, with x, y, z (NaN where nothing is) and intensity
template <class Use>
void scanRoom(int rows, int columns, Use use) {
  if (rows < 2 || columns < 1) throw std::runtime_error("a grid has at least 2 rows and 1 column");
  for (int column = 0; column < columns; ++column) {
    const double azimuth = 2.0 * M_PI * column / columns;
    for (int row = 0; row < rows; ++row) {
      const double elevation = -1.2 + 2.77 * row / (rows - 1);
      const double x = std::cos(elevation) * std::cos(azimuth), y = std::cos(elevation) * std::sin(azimuth);
      const double z = std::sin(elevation);
      const double range =
          elevation > 1.5 ? NAN : 1.0 / std::max({std::abs(x) / 5.0, std::abs(y) / 4.0, std::abs(z) / 1.5});
      use(range * x, range * y, range * z, std::abs(z));
    }
  }
}

void generatePtx(int rows, int columns, const std::string& path) {
  std::FILE* out = std::fopen(path.c_str(), "w");
  if (!out) throw std::runtime_error(path + " can't be written");
  std::fprintf(out, "%d\n%d\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n", columns,
               rows);
  scanRoom(rows, columns, [out](double x, double y, double z, double intensity) {
    if (std::isnan(x)) {
      std::fputs("0 0 0 0.5\n", out);
    } else {
      std::fprintf(out, "%.6f %.6f %.6f %.6f\n", x, y, z, intensity);
    }
  });
  if (std::fclose(out) != 0) throw std::runtime_error(path + " can't be written");
}

// As scanners write it: coordinates in tenths of millimetres, intensities of 12 bits, row and column.
void generateE57(int rows, int columns, const std::string& path) {
  std::vector<std::int64_t> x, y, z, intensities, row_index, column_index;
  int cell = 0;
  scanRoom(rows, columns, [&](double px, double py, double pz, double intensity) {
    const int at = cell++;
    if (std::isnan(px)) return;
    x.push_back(std::llround(1e4 * px));
    y.push_back(std::llround(1e4 * py));
    z.push_back(std::llround(1e4 * pz));
    intensities.push_back(std::llround(4095.0 * intensity));
    row_index.push_back(at % rows);
    column_index.push_back(at / rows);
  });
  E57TestScan scan;
  scan.records = x.size();
  scan.xml = "<indexBounds type=\"Structure\"><rowMinimum type=\"Integer\"/><rowMaximum type=\"Integer\">" +
             std::to_string(rows - 1) +
             "</rowMaximum><columnMinimum type=\"Integer\"/><columnMaximum type=\"Integer\">" +
             std::to_string(columns - 1) + "</columnMaximum></indexBounds>";
  constexpr std::int64_t kLimit = 1000000;
  scan.fields = {scaledField("cartesianX", -kLimit, kLimit, "scale=\"1e-4\"", x),
                 scaledField("cartesianY", -kLimit, kLimit, "scale=\"1e-4\"", y),
                 scaledField("cartesianZ", -kLimit, kLimit, "scale=\"1e-4\"", z),
                 integerField("intensity", 0, 4095, intensities),
                 integerField("rowIndex", 0, rows - 1, row_index),
                 integerField("columnIndex", 0, columns - 1, column_index)};
  E57TestFile file;
  file.longest_part = 8000;
  mapping_common::writeFile(path, [&](std::ostream& out) { out << file.make({scan}); });
}

void measure(const std::string& path) {
  const double megabytes = 1e-6 * static_cast<double>(openFile(path)->size());
  double seconds = 0.0, cpu_seconds = 0.0;
  std::uint64_t points = 0;
  ScanFormat format = ScanFormat::kAsc;
  for (int i = 0; i < 2; ++i) {
    points = 0;
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t cpu_start = std::clock();
    const auto reader = openScanFile(path);
    format = reader->format();
    for (std::size_t scan = 0; scan < reader->scans().size(); ++scan) {
      CloudBuilder builder(reader->scans()[scan], {});
      reader->read(scan, [&](const std::vector<ScanPoint>& chunk, double) {
        builder.add(chunk);
        points += chunk.size();
        return true;
      });
      builder.finish();
    }
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    cpu_seconds = static_cast<double>(std::clock() - cpu_start) / CLOCKS_PER_SEC;
  }
  std::printf(
      "%s  %s: %.1f MB, %.2f million points in %.3f s (CPU %.3f s): %.0f MB/s, %.2f million points/s\n",
      toString(format).c_str(), path.c_str(), megabytes, 1e-6 * static_cast<double>(points), seconds,
      cpu_seconds, megabytes / seconds, 1e-6 * static_cast<double>(points) / seconds);
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  try {
    if (argc == 5 && std::string(argv[1]) == "--generate") {
      const std::string path = argv[4];
      const bool e57 = path.size() > 4 && path.substr(path.size() - 4) == ".e57";
      (e57 ? hokuyo_sick_drivers::generateE57 : hokuyo_sick_drivers::generatePtx)(std::atoi(argv[2]),
                                                                                  std::atoi(argv[3]), path);
      return 0;
    }
    if (argc < 2 || argv[1][0] == '-') {
      const bool help = argc == 2 && std::string(argv[1]) == "--help";
      std::fputs("Usage: bench_zf FILE...\n       bench_zf --generate ROWS COLUMNS FILE.ptx|FILE.e57\n",
                 help ? stdout : stderr);
      return help ? 0 : 2;
    }
    for (int i = 1; i < argc; ++i) hokuyo_sick_drivers::measure(argv[i]);
    return 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "bench_zf: %s\n", e.what());
    return 1;
  }
}
