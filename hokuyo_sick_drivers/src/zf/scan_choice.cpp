// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/zf/scan_choice.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <stdexcept>

#include "numbers.h"

namespace hokuyo_sick_drivers {

std::vector<std::string> scanFiles(const std::string& path) {
  namespace fs = std::filesystem;
  if (!fs::is_directory(path)) return {path};
  constexpr std::array<const char*, 4> kEndings = {".e57", ".ptx", ".pts", ".asc"};
  std::vector<std::string> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(path)) {
    std::string ending = entry.path().extension();
    for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (entry.is_regular_file() && std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end())
      files.push_back(entry.path());
  }
  if (files.empty())
    throw std::runtime_error(path + " is a folder without any .e57, .ptx, .pts or .asc file");
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::size_t> chooseScans(const ScanFileReader& reader, const std::string& choice) {
  const std::vector<ScanInfo>& scans = reader.scans();
  std::vector<std::size_t> chosen;
  std::string names;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (choice == "all" || choice == scans[i].name) chosen.push_back(i);
    if (i < 20) names += (i > 0 ? ", " : "") + scans[i].name;
  }
  std::int64_t number = 0;
  if (chosen.empty() && parseWhole(choice, number) && number >= 1 &&
      static_cast<std::size_t>(number) <= scans.size()) {
    chosen.push_back(static_cast<std::size_t>(number - 1));
  }
  if (scans.empty()) throw std::runtime_error("holds no scan");
  if (chosen.empty()) {
    throw std::runtime_error("has no scan \"" + choice + "\": there are " + std::to_string(scans.size()) +
                             " (" + names + (scans.size() > 20 ? ", ..." : "") + "), counted from 1");
  }
  return chosen;
}

bool parseOffset(const std::string& offset, CloudOptions& options) {
  double values[4];
  if (offset == "auto") {
    options.offset_mode = CloudOptions::Offset::kAutomatic;
  } else if (offset == "none") {
    options.offset_mode = CloudOptions::Offset::kNone;
  } else if (parseNumbers(offset, values, 4) == 3) {
    options.offset_mode = CloudOptions::Offset::kGiven;
    options.offset = Eigen::Vector3d(values[0], values[1], values[2]);
    return options.offset.allFinite();
  } else {
    return false;
  }
  return true;
}

}  // namespace hokuyo_sick_drivers
