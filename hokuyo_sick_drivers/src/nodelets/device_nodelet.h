// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/nodelet.h>

#include <chrono>
#include <cstdint>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "hokuyo_sick_drivers/connection.h"

namespace hokuyo_sick_drivers {

/// A nodelet that drives a device at a port. The protocol, what it calls, and the reports to the diagnostics
/// are run by the connection's thread: nothing of them needs a lock, and no worker of the manager waits for a
/// device.
class DeviceNodelet : public mapping_common::Nodelet {
 protected:
  /// Opens the port from now on. Its coming and going is logged.
  void connect(const Endpoint& endpoint, Protocol& protocol, const Connection::Options& options);
  /// Stops the device and closes the port: for the destructor, as the thread uses what that destroys.
  void disconnect();

  /// Has work done in the connection's thread.
  void post(const std::function<void(Nanoseconds now)>& work) { connection_->post(work); }
  /// @return what `work` returns, or throws, in the connection's thread
  template <class Work>
  auto ask(Work work);

  /// Publishes the diagnostics. Called in the connection's thread, as are the functions below.
  virtual void reportHere() { Nodelet::report(); }
  const Endpoint& endpoint() const { return endpoint_; }
  /// Why the port isn't open; "" if it is.
  const std::string& portProblem() const { return port_problem_; }
  std::size_t disconnects() const { return disconnects_; }
  /// ROS time of a time of the steady clock that is a moment ago, ns. Not positive before simulated time
  /// begins: a warning says so then.
  std::int64_t toRosTime(Nanoseconds steady, double offset) const;

 private:
  void report() final;

  Endpoint endpoint_;
  std::string port_problem_ = "not opened yet";
  std::size_t disconnects_ = 0;
  std::unique_ptr<Connection> connection_;
};

template <class Work>
auto DeviceNodelet::ask(Work work) {
  using Task = std::packaged_task<std::invoke_result_t<Work, Nanoseconds>(Nanoseconds)>;
  const auto task = std::make_shared<Task>(std::move(work));
  auto answer = task->get_future();
  connection_->post([task](Nanoseconds now) { (*task)(now); });
  if (answer.wait_for(std::chrono::seconds(2)) != std::future_status::ready)
    throw std::runtime_error("the driver of " + endpoint_.name() + " is busy");
  return answer.get();
}

}  // namespace hokuyo_sick_drivers
