// SPDX-License-Identifier: BSD-3-Clause
//
// What the tool and the nodelet take as words.
#pragma once

#include <string>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"

namespace hokuyo_sick_drivers {

/// @param path of a file, or of a folder: all files in it that are called .e57, .ptx, .pts or .asc, in order
/// @throws std::runtime_error for a folder without any
std::vector<std::string> scanFiles(const std::string& path);

/// @param choice "all", a name, or a number from 1
/// @throws std::runtime_error that tells what scans there are
std::vector<std::size_t> chooseScans(const ScanFileReader& reader, const std::string& choice);

/// @param offset "auto", "none", or three numbers with commas or blanks. @return false for anything else
bool parseOffset(const std::string& offset, CloudOptions& options);

}  // namespace hokuyo_sick_drivers
