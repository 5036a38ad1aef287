// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/hokuyo_address.h"

#include <arpa/inet.h>

#include <cstdint>
#include <cstdio>
#include <stdexcept>
#include <utility>

namespace hokuyo_sick_drivers {
namespace {

constexpr Nanoseconds kPatience = 5 * kSecond;  // it is written to a memory that lasts
const std::string kStop = "QT";

// @param name for the error
std::uint32_t parse(const std::string& text, const char* name) {
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1) {
    throw std::invalid_argument(std::string(name) + " is '" + text +
                                "', expected four numbers from 0 to 255 with dots between them");
  }
  return ntohl(address.s_addr);
}

std::string digits(std::uint32_t address) {
  char text[16];
  std::snprintf(text, sizeof(text), "%03u%03u%03u%03u", address >> 24, address >> 16 & 255,
                address >> 8 & 255, address & 255);
  return text;
}

}  // namespace

std::string HokuyoAddress::command() const {
  const std::uint32_t own = parse(address, "the address"), mask = parse(netmask, "the netmask"),
                      gate = parse(gateway, "the gateway");
  const std::uint32_t hosts = ~mask;
  if ((hosts & (hosts + 1)) != 0 || hosts < 3)
    throw std::invalid_argument("the netmask is " + netmask + ", expected e.g. 255.255.255.0");
  if ((own & hosts) == 0 || (own & hosts) == hosts)
    throw std::invalid_argument("the address is " + address +
                                ", which means a whole network by its netmask " + netmask);
  if (own == gate || (own & mask) != (gate & mask))
    throw std::invalid_argument("the gateway is " + gateway + ", expected another one in the network of " +
                                address + " with netmask " + netmask);
  return "$IP" + digits(own) + digits(mask) + digits(gate);
}

void HokuyoAddressSetter::connected(Nanoseconds now) {
  if (finished()) return;
  step_ = Step::kStop;
  output_.clear();
  reader_.clear();
  send(kStop, now);
}

void HokuyoAddressSetter::send(const std::string& command, Nanoseconds now) {
  // An empty line ends what somebody else may have begun.
  output_.push_back({(command == kStop ? "\n" : "") + command + "\n", 0, false});
  reader_.expect(command);
  deadline_ = now + kPatience;
}

void HokuyoAddressSetter::received(std::string_view bytes, Nanoseconds now) {
  while (!bytes.empty()) {
    bytes.remove_prefix(reader_.consume(bytes, now));
    if (!reader_.complete() || finished()) continue;
    const scip::Message& message = reader_.message();
    const std::string& expected = step_ == Step::kStop ? kStop : command_;
    if (message.echo() != expected) continue;  // a scan, which was on its way
    if (step_ == Step::kStop) {
      step_ = Step::kSet;
      send(command_, now);
    } else if (message.status() == "00") {
      finish("");
    } else {
      finish("the scanner refuses the address, " + scip::describeStatus(message.status()));
    }
  }
}

void HokuyoAddressSetter::tick(Nanoseconds now) {
  if (now < deadline_ || finished()) return;
  finish("the scanner doesn't answer " + (step_ == Step::kStop ? kStop : command_));
}

void HokuyoAddressSetter::finish(const std::string& problem) {
  step_ = Step::kFinished;
  problem_ = problem;
  deadline_ = kNever;
}

Protocol::Output HokuyoAddressSetter::takeOutput() {
  if (output_.empty()) return {};
  Output output = std::move(output_.front());
  output_.pop_front();
  return output;
}

}  // namespace hokuyo_sick_drivers
