// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/zf/scan_file.h"

#include <algorithm>
#include <cctype>
#include <stdexcept>
#include <utility>

#include "point_text.h"

namespace hokuyo_sick_drivers {
namespace {

std::string extensionOf(const std::string& name) {
  const std::size_t dot = name.find_last_of("./");
  std::string extension = dot == name.npos || name[dot] == '/' ? "" : name.substr(dot + 1);
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

// How many numbers each of the first lines is; kNotNumbers for other text.
std::vector<std::size_t> fieldsOfFirstLines(ByteSource& source) {
  std::vector<std::size_t> fields;
  try {
    LineReader lines(source);
    std::string_view line;
    while (fields.size() < 100 && lines.next(line)) {
      double values[12];
      fields.push_back(asCount(line) ? 1 : parseNumbers(line, values, 12));
    }
  } catch (const std::runtime_error&) {  // a line too long for a text of points
  }
  return fields;
}

// What a file is that holds no scan that is read here; "" where that isn't known.
std::string nameOfOther(std::string start) {
  static const std::pair<std::string, const char*> kOthers[] = {
      {"lasf", "a LAS or LAZ file"}, {"ply\n", "a PLY file"},     {"ply\r", "a PLY file"},
      {"# .pcd", "a PCD file"},      {"version", "a PCD file"},   {"#rosbag", "a bag of ROS"},
      {"dsaa", "a grid of Surfer"},  {"ncols", "a grid of ESRI"}, {"nrows", "a grid of ESRI"}};
  for (char& c : start) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const auto& [beginning, name] : kOthers) {
    if (start.compare(0, beginning.size(), beginning) == 0) return name;
  }
  return "";
}

}  // namespace

std::string toString(ScanFormat format) {
  constexpr const char* kNames[] = {"E57", "PTX", "PTS", "ASC"};
  return kNames[static_cast<int>(format)];
}

ScanFormat recogniseScanFile(ByteSource& source, const std::string& name) {
  char magic[8];
  const std::string_view start(magic, source.read(0, magic, sizeof magic));
  const std::string extension = extensionOf(name);
  if (start == "ASTM-E57") return ScanFormat::kE57;
  if (extension == "zfs" || extension == "zfc" ||
      (start.substr(0, 3) == "ZFS" && start.substr(0, 4) != "ZFSF")) {
    throw std::runtime_error(
        "is in the scanner's own format, which only its maker's software reads: export it from LaserControl "
        "to E57 "
        "(best), PTX, PTS or ASC");
  }
  if (start.empty()) throw std::runtime_error("is empty");
  if (const std::string other = nameOfOther(std::string(start)); !other.empty())
    throw std::runtime_error("is " + other + ", not one of E57, PTX, PTS or lines of points");
  if (extension == "e57") throw std::runtime_error("isn't an E57 file: it doesn't start with ASTM-E57");

  const std::vector<std::size_t> fields = fieldsOfFirstLines(source);
  if (fields.size() >= 3 && fields[0] == 1 && fields[1] == 1 && fields[2] == 3) return ScanFormat::kPtx;
  if (fields.size() >= 2 && fields[0] == 1 && fields[1] != kNotNumbers && fields[1] >= 3)
    return ScanFormat::kPts;
  if (extension == "ptx") return ScanFormat::kPtx;
  if (extension == "pts") return ScanFormat::kPts;
  if (std::any_of(fields.begin(), fields.end(), [](std::size_t n) { return n != kNotNumbers && n >= 3; })) {
    return ScanFormat::kAsc;
  }
  throw std::runtime_error("is neither E57 nor PTX, PTS or lines of points");
}

std::unique_ptr<ScanFileReader> openScanFile(std::shared_ptr<ByteSource> source, const std::string& name,
                                             const ReadOptions& options) {
  switch (recogniseScanFile(*source, name)) {
    case ScanFormat::kE57:
      return openE57(std::move(source), options);
    case ScanFormat::kPtx:
      return openPtx(std::move(source), options);
    case ScanFormat::kPts:
      return openPts(std::move(source), options);
    default:
      return openAsc(std::move(source), options);
  }
}

std::unique_ptr<ScanFileReader> openScanFile(const std::string& path, const ReadOptions& options) {
  std::shared_ptr<ByteSource> source = openFile(path);
  try {
    return openScanFile(std::move(source), path, options);
  } catch (const ReadStopped&) {
    throw;
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(path + " " + e.what());
  }
}

}  // namespace hokuyo_sick_drivers
