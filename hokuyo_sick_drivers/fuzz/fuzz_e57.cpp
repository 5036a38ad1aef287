// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz_scan_file.h"

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  hokuyo_sick_drivers::readScanFile(reinterpret_cast<const char*>(data), size, "scan.e57", {});
  return 0;
}
