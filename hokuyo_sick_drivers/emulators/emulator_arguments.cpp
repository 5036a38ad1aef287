// SPDX-License-Identifier: BSD-3-Clause
#include "emulator_arguments.h"

#include <ros/init.h>
#include <ros/master.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "bag_source.h"
#include "topic_source.h"

namespace device_emulators {
namespace {

namespace po = boost::program_options;

constexpr double kLongest = 1e6;  // s

double checked(const std::string& name, double value, double min, double max) {
  if (value >= min && value <= max) return value;
  std::ostringstream text;
  text << "--" << name << " is " << value << ", allowed is " << min << " to " << max;
  throw po::error(text.str());
}

FaultOptions::Moment parseMoment(const std::string& text) {
  const std::size_t at = text.find('@');
  std::size_t used = 0;
  double seconds = 0.0;
  try {
    seconds = std::stod(text.substr(at + 1), &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (at == std::string::npos || used == 0 || used != text.size() - at - 1) {
    throw po::error("--inject is '" + text + "', expected KIND@SECONDS");
  }
  return {faultNamed(text.substr(0, at)), toNanoseconds(checked("inject", seconds, 0.0, kLongest))};
}

}  // namespace

Nanoseconds toNanoseconds(double seconds) {
  return std::llround(seconds * kSecond);
}

void CommonArguments::addTo(po::options_description& options) {
  po::options_description source("Scans (by default those of a small room)");
  auto add = source.add_options();
  add("bag", po::value(&bag_), "bag to take scans from, over and over at its own rate; needs no roscore");
  add("topic", po::value(&topic_),
      "sensor_msgs/LaserScan: of the bag (default: the only one), or, without --bag, under ROS");
  add("multi-echo", po::bool_switch(&multi_echo_), "the ROS topic is of sensor_msgs/MultiEchoLaserScan");
  add("truth", po::value(&truth_),
      "CSV file that gets each scan that was sent to its last byte: start as Unix time (s), device's stamp, "
      "first step, cluster, m per unit, injected faults, ranges, intensities, echoes per step");
  options.add(source);

  po::options_description device("Device and line");
  add = device.add_options();
  add("seed", po::value(&seed_)->default_value(seed_), "of everything random");
  add("boot-delay", po::value(&boot_delay_),
      "s from power-up until the device answers. If given, the device is switched on when the program "
      "starts; otherwise it has been running for long then");
  add("streaming", po::bool_switch(&streaming_), "is streaming already, as another program left it");
  add("jitter-ms", po::value(&jitter_ms_)->default_value(0.0, "0"),
      "each message is late by a uniform time up to this");
  add("packet-size", po::value(&packet_size_)->default_value(0), "bytes per write, 0: a whole message");
  add("random-packets", po::bool_switch(&random_packets_), "writes of random sizes up to --packet-size");
  add("packet-gap-ms", po::value(&packet_gap_ms_)->default_value(0.0, "0"), "between writes");
  options.add(device);

  po::options_description faults("Faults. A rate is a probability per message sent, or per connect");
  add = faults.add_options();
  add("faults", po::value(&faults_), "kinds that get --fault-rate, separated by commas, or all");
  add("fault-rate", po::value(&fault_rate_)->default_value(fault_rate_, "0.01"), "of each of these");
  const char* const kDescriptions[kNumFaults] = {"1 to 4 bytes of a message are lost",
                                                 "a bit of a message is flipped",
                                                 "the end of a message is missing",
                                                 "1 to 32 random bytes are inserted",
                                                 "nothing is said for --silence-time seconds",
                                                 "nothing comes for --stall-time seconds, then everything",
                                                 "the connection breaks for --outage-time seconds",
                                                 "power fails, and the connection breaks",
                                                 "a wrong sum in one row (Hokuyo), a wrong CRC (SICK)",
                                                 "status 0M instead of a scan (Hokuyo)",
                                                 "status 50 to 97, the stream ends (Hokuyo)",
                                                 "a good command is answered by NAK (SICK)",
                                                 "F5h whose count is wrong (SICK)",
                                                 "is streaming when a host connects",
                                                 "the end of a message comes first when a host connects"};
  for (const Fault fault : allFaults()) {
    const auto i = static_cast<std::size_t>(fault);
    add(faultName(fault), po::value(&rates_[i]), kDescriptions[i]);
  }
  add("inject", po::value(&moments_),
      "KIND@SECONDS: a single fault at that time after the start; repeatable");
  add("silence-time", po::value(&silence_)->default_value(silence_, "1"), "s");
  add("stall-time", po::value(&stall_)->default_value(stall_, "0.3"), "s");
  add("outage-time", po::value(&outage_)->default_value(outage_, "0.5"), "s");
  options.add(faults);
}

void CommonArguments::apply(const po::variables_map& values, DeviceOptions& options) const {
  options.seed = seed_;
  options.streaming = streaming_;
  if (values.count("boot-delay")) {
    options.boot_delay = toNanoseconds(checked("boot-delay", boot_delay_, 0.0, kLongest));
    options.power_up_at_start = true;
  }
  options.line.jitter = toNanoseconds(checked("jitter-ms", jitter_ms_, 0.0, 1e6) * 1e-3);
  options.line.packet_size = static_cast<std::size_t>(checked("packet-size", packet_size_, 0, 1e6));
  options.line.random_packets = random_packets_;
  options.line.packet_gap = toNanoseconds(checked("packet-gap-ms", packet_gap_ms_, 0.0, 1e6) * 1e-3);
  if (random_packets_ && packet_size_ == 0) throw po::error("--random-packets needs --packet-size");

  FaultOptions& faults = options.faults;
  std::istringstream kinds(faults_);
  for (std::string kind; std::getline(kinds, kind, ',');) {
    const auto chosen = kind == "all" ? allFaults() : std::vector<Fault>{faultNamed(kind)};
    for (const Fault fault : chosen) faults.rate(fault) = checked("fault-rate", fault_rate_, 0.0, 1.0);
  }
  for (const Fault fault : allFaults()) {
    const char* name = faultName(fault);
    if (values.count(name))
      faults.rate(fault) = checked(name, rates_[static_cast<std::size_t>(fault)], 0.0, 1.0);
  }
  for (const std::string& moment : moments_) faults.moments.push_back(parseMoment(moment));
  faults.silence = toNanoseconds(checked("silence-time", silence_, 0.0, kLongest));
  faults.stall = toNanoseconds(checked("stall-time", stall_, 0.0, kLongest));
  faults.outage = toNanoseconds(checked("outage-time", outage_, 0.0, kLongest));
}

std::shared_ptr<ScanSource> CommonArguments::makeSource(int argc, char** argv,
                                                        const std::string& name) const {
  if (!bag_.empty()) return std::make_shared<BagSource>(bag_, topic_);
  if (topic_.empty()) return std::make_shared<RoomSource>();
  ros::init(argc, argv, name, ros::init_options::NoSigintHandler);
  if (!ros::master::check()) {
    throw std::runtime_error("no roscore at " + ros::master::getURI() + "; --topic without --bag needs one");
  }
  return std::make_shared<TopicSource>(topic_, multi_echo_);
}

}  // namespace device_emulators
