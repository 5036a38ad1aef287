// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz_scan_file.h"

// The first byte chooses the columns.
extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  if (size == 0) return 0;
  constexpr const char* kColumns[] = {"", "_ x -y z i", "z i r g b y x", "x"};
  hokuyo_sick_drivers::ReadOptions options;
  options.columns = kColumns[data[0] % 4];
  hokuyo_sick_drivers::readScanFile(reinterpret_cast<const char*>(data) + 1, size - 1, "scan.asc", options);
  return 0;
}
