// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_common/tool.h>
#include <ros/init.h>

#include <boost/program_options.hpp>
#include <memory>
#include <optional>
#include <string>

#include "emulator_arguments.h"
#include "hokuyo_device.h"
#include "run_device.h"

namespace po = boost::program_options;

namespace device_emulators {
namespace {

const char kUsage[] =
    "Usage: hokuyo_emulator --tcp PORT | --pty LINK [options]\n"
    "\n"
    "Behaves as a Hokuyo laser scanner does (SCIP 2) on a TCP port or on a pseudo terminal. Prints "
    "\"ready\"\n"
    "when a driver can connect, and at the end (SIGINT, SIGTERM) what it has sent and injected.\n";

struct Arguments {
  CommonArguments common;
  std::shared_ptr<ScanSource> source;
  HokuyoOptions options;
  std::string pty, address = "127.0.0.1";
  int tcp = 0;
  bool replace = false;
};

/// False if help was asked for and printed.
bool parse(int argc, char** argv, Arguments& a) {
  HokuyoOptions& o = a.options;
  std::string model = o.model.name, known;
  for (const std::string& name : hokuyoModels()) known += " " + name;
  double start_ms = 0.0, intensity_scale = 1.0;
  bool keep_streaming = false;

  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("tcp", po::value(&a.tcp), "TCP port to listen on; devices have 10940");
  add("address", po::value(&a.address)->default_value(a.address), "to listen on; 0.0.0.0: all");
  add("replace", po::bool_switch(&a.replace),
      "a second TCP client replaces the first; else it is turned away");
  add("keep-streaming", po::bool_switch(&keep_streaming),
      "streaming outlives a TCP client that closes, as it does on a pseudo terminal");
  add("pty", po::value(&a.pty), "link to make to a pseudo terminal");
  add("baud", po::value(&o.line.baud_rate)->default_value(0),
      "RS-232 at this rate, which the host has to set too; 0: USB, as fast as it goes");
  add("model", po::value(&model)->default_value(model), ("one of" + known).c_str());
  add("drift-ppm", po::value(&o.drift_ppm)->default_value(0.0, "0"), "how much faster the device's clock is");
  add("start-ms", po::value(&start_ms)->default_value(0.0, "0"),
      "the clock at the start; it wraps at 16777216");
  add("sum-semicolon", po::bool_switch(&o.sum_semicolon),
      "the semicolons of VV, PP and II count for the sums, as in some firmware");
  add("quit-cuts-scan", po::bool_switch(&o.quit_cuts_scan),
      "QT ends a scan at a row's end; else it is finished");
  add("partial-group", po::bool_switch(&o.partial_group),
      "steps left over from whole clusters make a value too");
  add("intensity-scale", po::value(&intensity_scale)->default_value(1.0, "1"),
      "from the source's intensities to those sent");
  a.common.addTo(all);

  const auto given = mapping_common::parseArguments(argc, argv, kUsage, all);
  if (!given) return false;
  if ((given->count("tcp") > 0) == (given->count("pty") > 0)) throw po::error("give one of --tcp and --pty");
  if (given->count("tcp") && (a.tcp < 1 || a.tcp > 65535)) throw po::error("--tcp must be from 1 to 65535");
  if (!(start_ms >= 0.0 && start_ms < 1 << 24)) throw po::error("--start-ms must be in [0, 16777216)");
  if (!(std::abs(o.drift_ppm) <= 1e5)) throw po::error("--drift-ppm must be from -100000 to 100000");
  if (o.line.baud_rate < 0 || (o.line.baud_rate > 0 && a.pty.empty())) {
    throw po::error("--baud must not be negative, and needs --pty");
  }
  if (!(intensity_scale >= 0.0)) throw po::error("--intensity-scale must not be negative");
  o.model = hokuyoModel(model);
  o.model.intensity_scale = intensity_scale;
  o.start_ms = static_cast<std::uint32_t>(start_ms);
  o.stop_on_close = a.pty.empty() && !keep_streaming;
  a.common.apply(*given, o);
  a.source = a.common.makeSource(argc, argv, "hokuyo_emulator");
  return true;
}

void run(const Arguments& a) {
  RunOptions options;
  HokuyoDevice device(a.options, a.source);
  if (a.common.needsRos()) options.poll = [] { ros::spinOnce(); };
  std::optional<TruthLog> truth;
  if (!a.common.truth().empty()) options.truth = &truth.emplace(a.common.truth());
  std::unique_ptr<Port> port;
  if (a.pty.empty()) {
    port = std::make_unique<TcpPort>(a.address, a.tcp, a.replace);
  } else {
    port = std::make_unique<PtyPort>(a.pty);
  }
  runDevice(device, *port, options);
  printCounts(device);
}

}  // namespace
}  // namespace device_emulators

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "hokuyo_emulator", device_emulators::kUsage,
                                 device_emulators::parse, device_emulators::run);
}
