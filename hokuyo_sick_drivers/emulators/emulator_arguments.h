// SPDX-License-Identifier: BSD-3-Clause
//
// What the programs have in common on the command line.
#pragma once

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/variables_map.hpp>
#include <memory>
#include <string>
#include <vector>

#include "device.h"
#include "scan_source.h"

namespace device_emulators {

Nanoseconds toNanoseconds(double seconds);

class CommonArguments {
 public:
  void addTo(boost::program_options::options_description& options);
  /// Fills in what the arguments say. @throws boost::program_options::error for wrong values
  void apply(const boost::program_options::variables_map& values, DeviceOptions& options) const;
  /// A bag, a topic, or the room. Starts ROS for a topic. @throws std::runtime_error
  std::shared_ptr<ScanSource> makeSource(int argc, char** argv, const std::string& name) const;
  bool needsRos() const { return bag_.empty() && !topic_.empty(); }
  const std::string& truth() const { return truth_; }

 private:
  std::string bag_, topic_, truth_;
  bool multi_echo_ = false, streaming_ = false;
  std::uint64_t seed_ = 1;
  double boot_delay_ = 0.0;
  double jitter_ms_ = 0.0, packet_gap_ms_ = 0.0;
  int packet_size_ = 0;
  bool random_packets_ = false;
  std::string faults_;
  double fault_rate_ = 0.01;
  std::vector<double> rates_ = std::vector<double>(kNumFaults, 0.0);
  std::vector<std::string> moments_;
  double silence_ = 1.0, stall_ = 0.3, outage_ = 0.5;
};

}  // namespace device_emulators
