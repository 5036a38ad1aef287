// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <string>

#include "hokuyo_sick_drivers/protocol.h"
#include "hokuyo_sick_drivers/scip.h"

namespace hokuyo_sick_drivers {

/// The IPv4 settings of a scanner with Ethernet, e.g. 192.168.0.10, 255.255.255.0 and 192.168.0.1 as
/// delivered.
struct HokuyoAddress {
  std::string address, netmask = "255.255.255.0", gateway;

  /// SCIP's command that sets them: $IP and each as four numbers of three digits.
  /// @throws std::invalid_argument for what is no address, or would cut the scanner off its gateway
  std::string command() const;
};

/// Gives a scanner with Ethernet another address, which it takes when it is switched on the next time. It is
/// stopped for that.
class HokuyoAddressSetter : public Protocol {
 public:
  explicit HokuyoAddressSetter(const HokuyoAddress& address) : command_(address.command()) {}

  /// Whether it is over, one way or the other.
  bool finished() const { return step_ == Step::kFinished; }
  /// Why it failed; "" if it didn't.
  const std::string& problem() const { return problem_; }

  void connected(Nanoseconds now) override;
  void disconnected(Nanoseconds) override { deadline_ = kNever; }
  void received(std::string_view bytes, Nanoseconds now) override;
  void tick(Nanoseconds now) override;
  Nanoseconds deadline() const override { return deadline_; }
  Output takeOutput() override;
  void shutDown(Nanoseconds) override {}
  bool done() const override { return true; }

 private:
  enum class Step { kStop, kSet, kFinished };

  void send(const std::string& command, Nanoseconds now);
  void finish(const std::string& problem);

  const std::string command_;
  Step step_ = Step::kStop;
  std::string problem_;
  Nanoseconds deadline_ = kNever;
  std::deque<Output> output_;
  scip::MessageReader reader_;
};

}  // namespace hokuyo_sick_drivers
