// SPDX-License-Identifier: BSD-3-Clause
#include "truth_log.h"

#include <iomanip>
#include <stdexcept>
#include <vector>

namespace device_emulators {
namespace {

template <class Number>
void writeList(std::ostream& out, const std::vector<Number>& values) {
  const char* separator = "";
  for (const Number value : values) {
    out << separator << +value;
    separator = " ";
  }
}

}  // namespace

TruthLog::TruthLog(const std::string& path) : path_(path), file_(path) {
  file_ << "start,device_stamp,first_step,cluster,resolution,fault,ranges,intensities,echoes\n" << std::flush;
  if (!file_) throw std::runtime_error("can't write " + path);
}

void TruthLog::write(const SentScan& scan, Nanoseconds epoch_offset) {
  const Nanoseconds start = scan.start + epoch_offset;
  file_ << start / kSecond << '.' << std::setw(9) << std::setfill('0') << start % kSecond << ','
        << scan.device_stamp << ',' << scan.first_step << ',' << scan.cluster << ',' << scan.resolution << ','
        << scan.fault << ',';
  writeList(file_, scan.ranges);
  file_ << ',';
  writeList(file_, scan.intensities);
  file_ << ',';
  writeList(file_, scan.echoes);
  file_ << std::endl;  // whole lines only, for whoever reads along
  if (!file_) throw std::runtime_error("can't write " + path_);
}

}  // namespace device_emulators
