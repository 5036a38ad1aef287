// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_common/tool.h>
#include <ros/init.h>

#include <boost/program_options.hpp>
#include <iostream>
#include <optional>
#include <string>

#include "emulator_arguments.h"
#include "run_device.h"
#include "sick_device.h"

namespace po = boost::program_options;

namespace device_emulators {
namespace {

const char kUsage[] =
    "Usage: sick_emulator --pty LINK [options]\n"
    "\n"
    "Behaves as a SICK LMS 2xx does on a pseudo terminal. Prints \"ready\" when a driver can connect, and at "
    "the\n"
    "end (SIGINT, SIGTERM) what it has sent and injected.\n";

struct Arguments {
  CommonArguments common;
  std::shared_ptr<ScanSource> source;
  SickOptions options;
  std::string pty;
  bool ignore_baud = false;
};

void setDelay(const char* name, double milliseconds, Nanoseconds& delay) {
  if (!(milliseconds >= 0.0 && milliseconds <= 1e5)) {
    throw po::error("--" + std::string(name) + " must be from 0 to 100000");
  }
  delay = toNanoseconds(milliseconds * 1e-3);
}

/// False if help was asked for and printed.
bool parse(int argc, char** argv, Arguments& a) {
  SickOptions& o = a.options;
  std::string model = o.model.name;
  int configuration_size = 34, flags = 0;
  const auto milliseconds = [](Nanoseconds delay) { return static_cast<double>(delay) / kMillisecond; };
  double ack = milliseconds(o.ack_delay), reply = milliseconds(o.reply_delay),
         mode = milliseconds(o.mode_delay), configure = milliseconds(o.configure_delay),
         gap = milliseconds(o.byte_gap);

  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("pty", po::value(&a.pty)->required(), "link to make to a pseudo terminal");
  add("model", po::value(&model)->default_value(model), "LMS291-S05 or LMS291-S14");
  add("baud", po::value(&o.line.baud_rate)->default_value(9600), "rate at the start");
  add("power-up-baud", po::value(&o.power_up_baud_rate)->default_value(9600),
      "rate after a reset or power failure");
  add("ignore-baud", po::bool_switch(&a.ignore_baud),
      "understand a host that has set another rate than the device's");
  add("ack-delay-ms", po::value(&ack)->default_value(ack), "from a command to ACK or NAK");
  add("reply-delay-ms", po::value(&reply)->default_value(reply), "from ACK to a reply");
  add("mode-delay-ms", po::value(&mode)->default_value(mode), "from ACK to A0h");
  add("configure-delay-ms", po::value(&configure)->default_value(configure), "from ACK to F7h");
  add("byte-gap-ms", po::value(&gap)->default_value(gap),
      "longest gap within a command, which is dropped after that");
  add("configuration-size", po::value(&configuration_size)->default_value(34),
      "34, or 32 as in old firmware");
  add("refuse-by-mode", po::bool_switch(&o.refuse_by_mode),
      "77h outside of installation mode gets A0h 02h; else F7h 00h");
  add("wide-codes", po::bool_switch(&o.coding.wide_codes),
      "modes 0Dh and 0Eh: no reading is FFFFh and below; else 1FFFh and below");
  add("flags", po::value(&flags)->default_value(0), "0 to 7, in the upper three bits of each range of F5h");
  add("index-at-end", po::bool_switch(&o.coding.index_at_end),
      "F5h has one real-time index at the end; else one after each group");
  add("intensity-scale", po::value(&o.coding.intensity_scale)->default_value(1.0, "1"),
      "from the source's intensities to those sent");
  a.common.addTo(all);

  const auto given = mapping_common::parseArguments(argc, argv, kUsage, all);
  if (!given) return false;
  for (const int baud : {o.line.baud_rate, o.power_up_baud_rate}) {
    if (baud != 9600 && baud != 19200 && baud != 38400 && baud != 500000)
      throw po::error("--baud and --power-up-baud must be 9600, 19200, 38400 or 500000");
  }
  if (flags < 0 || flags > 7) throw po::error("--flags must be from 0 to 7");
  if (configuration_size != 32 && configuration_size != 34) {
    throw po::error("--configuration-size must be 32 or 34");
  }
  if (!(o.coding.intensity_scale >= 0.0)) throw po::error("--intensity-scale must not be negative");
  o.model = sickModel(model);
  o.configuration_size = static_cast<std::size_t>(configuration_size);
  o.coding.flags = static_cast<unsigned>(flags);
  setDelay("ack-delay-ms", ack, o.ack_delay);
  setDelay("reply-delay-ms", reply, o.reply_delay);
  setDelay("mode-delay-ms", mode, o.mode_delay);
  setDelay("configure-delay-ms", configure, o.configure_delay);
  setDelay("byte-gap-ms", gap, o.byte_gap);
  a.common.apply(*given, o);
  a.source = a.common.makeSource(argc, argv, "sick_emulator");
  return true;
}

void run(const Arguments& a) {
  RunOptions options;
  options.check_baud_rate = !a.ignore_baud;
  SickDevice device(a.options, a.source);
  if (a.common.needsRos()) options.poll = [] { ros::spinOnce(); };
  std::optional<TruthLog> truth;
  if (!a.common.truth().empty()) options.truth = &truth.emplace(a.common.truth());
  PtyPort port(a.pty);
  runDevice(device, port, options);
  printCounts(device);
  std::cout << "configuration writes " << device.configurationWrites() << std::endl;
}

}  // namespace
}  // namespace device_emulators

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "sick_emulator", device_emulators::kUsage,
                                 device_emulators::parse, device_emulators::run);
}
