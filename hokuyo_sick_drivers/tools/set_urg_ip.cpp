// SPDX-License-Identifier: BSD-3-Clause
//
// Changes the IP address of a Hokuyo with Ethernet.
#include <mapping_common/tool.h>

#include <atomic>
#include <boost/program_options.hpp>
#include <chrono>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>

#include "hokuyo_sick_drivers/connection.h"
#include "hokuyo_sick_drivers/hokuyo_address.h"

namespace po = boost::program_options;

namespace hokuyo_sick_drivers {
namespace {

const char kUsage[] =
    "Usage: set_urg_ip NEW_ADDRESS NEW_GATEWAY [options]\n"
    "\n"
    "Gives a Hokuyo with Ethernet another IP address, e.g. set_urg_ip 192.168.0.11 192.168.0.1. It takes it "
    "when\n"
    "it is switched off and on.\n\n";

struct Arguments {
  HokuyoAddress wanted;
  Endpoint endpoint{"192.168.0.10", 10940, "", 0};
  double patience = 10.0;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options"), unnamed;
  auto add = options.add_options();
  add("help,h", "print this");
  add("nm", po::value(&a.wanted.netmask)->default_value(a.wanted.netmask), "its new netmask");
  add("ip", po::value(&a.endpoint.host)->default_value(a.endpoint.host), "its address now");
  add("port", po::value(&a.endpoint.tcp_port)->default_value(a.endpoint.tcp_port), "its TCP port");
  add("patience", po::value(&a.patience)->default_value(a.patience, "10"), "s after which it gives up");
  unnamed.add_options()("new_ip", po::value(&a.wanted.address)->required())(
      "new_gw", po::value(&a.wanted.gateway)->required());
  if (!mapping_common::parseArguments(argc, argv, kUsage, options, unnamed)) return false;
  try {
    a.wanted.command();
  } catch (const std::invalid_argument& e) {
    throw po::error(e.what());
  }
  return true;
}

void run(const Arguments& a) {
  HokuyoAddressSetter setter(a.wanted);
  std::string problem =
      "there is no answer from " + a.endpoint.name();  // as the connection's thread knows it
  std::atomic<bool> finished{false};
  {
    Connection connection(a.endpoint, setter,
                          {[] {}, [](const std::string&) {}, [&](const std::string& why) { problem = why; },
                           [&](const std::string& what) { problem = what; }});
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(a.patience);
    while (!finished && std::chrono::steady_clock::now() < end) {
      connection.post([&](Nanoseconds) { finished = setter.finished(); });
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  if (!finished) throw std::runtime_error(problem);
  if (!setter.problem().empty()) throw std::runtime_error(setter.problem());
  std::cout << a.endpoint.name() << " has been told the address " << a.wanted.address
            << ". Switch it off and on.\n";
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  using namespace hokuyo_sick_drivers;
  return mapping_common::runTool<Arguments>(argc, argv, "set_urg_ip", kUsage, parse, run);
}
