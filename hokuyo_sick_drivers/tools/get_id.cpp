// SPDX-License-Identifier: BSD-3-Clause
//
// Prints the serial number of a Hokuyo, by which udev can name its port.
#include <mapping_common/tool.h>

#include <boost/program_options.hpp>
#include <chrono>
#include <future>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>

#include "hokuyo_sick_drivers/connection.h"
#include "hokuyo_sick_drivers/hokuyo.h"

namespace po = boost::program_options;

namespace hokuyo_sick_drivers {
namespace {

const char kUsage[] =
    "Usage: getID /dev/ttyACM0 [q]\n"
    "       getID ADDRESS:PORT [q]\n"
    "\n"
    "Prints the serial number of the Hokuyo at a port; with q nothing else, for scripts and udev. For "
    "scanners\n"
    "whose ports change, this line in /etc/udev/rules.d/99-hokuyo.rules gives each a name of its own, e.g.\n"
    "/dev/hokuyo_H0902680:\n"
    "\n"
    "  SUBSYSTEM==\"tty\", ATTRS{idVendor}==\"15d1\", PROGRAM=\"/PATH/TO/getID /dev/%k q\", "
    "SYMLINK+=\"hokuyo_%c\"\n\n";

struct Arguments {
  std::string port, quiet;
  Endpoint endpoint;
  double patience = 10.0;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options"), unnamed;
  options.add_options()("help,h", "print this");
  options.add_options()("patience", po::value(&a.patience)->default_value(a.patience, "10"),
                        "s after which it gives up");
  unnamed.add_options()("port", po::value(&a.port)->required())("quiet", po::value(&a.quiet));
  if (!mapping_common::parseArguments(argc, argv, kUsage, options, unnamed)) return false;
  const std::size_t colon = a.port.rfind(':');
  if (a.port.find('/') != std::string::npos || colon == std::string::npos) {
    a.endpoint = {"", 0, a.port, 115200};
    return true;
  }
  const std::string number = a.port.substr(colon + 1);
  if (number.empty() || number.size() > 5 || number.find_first_not_of("0123456789") != std::string::npos)
    throw po::error("the TCP port is '" + number + "', expected a number");
  a.endpoint = {a.port.substr(0, colon), std::stoi(number), "", 0};
  return true;
}

void run(const Arguments& a) {
  Hokuyo::Options options;
  options.synchronize_clock = false;
  if (a.endpoint.host.empty()) options.baud_rates = {115200, 19200, 38400, 57600, 250000, 500000, 750000};
  std::string problem = "there is no answer from " + a.port;  // as the connection's thread knows it
  Hokuyo hokuyo(options, {}, {[](const HokuyoScan&) {}, [](Hokuyo::Level, const std::string&) {}});
  Connection connection(a.endpoint, hokuyo,
                        {[] {}, [](const std::string&) {}, [&](const std::string& why) { problem = why; },
                         [&](const std::string& what) { problem = what; }});
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(a.patience);
  std::string id, why;
  while (id.empty()) {
    std::promise<void> done;
    connection.post([&](Nanoseconds) {
      const Hokuyo::Status status = hokuyo.status();
      if (status.info.count("SERI") > 0) id = status.info.at("SERI");
      why = problem;
      done.set_value();
    });
    done.get_future().wait();
    if (!id.empty()) break;
    if (std::chrono::steady_clock::now() > end) throw std::runtime_error(why);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  if (a.quiet.empty()) std::cout << "Device at " << a.port << " has ID ";
  std::cout << id << std::endl;
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  using namespace hokuyo_sick_drivers;
  return mapping_common::runTool<Arguments>(argc, argv, "getID", kUsage, parse, run);
}
