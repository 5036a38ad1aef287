// SPDX-License-Identifier: BSD-3-Clause
#include "run_device.h"

#include <poll.h>
#include <time.h>

#include <algorithm>
#include <csignal>
#include <iostream>
#include <string>

namespace device_emulators {
namespace {

constexpr std::size_t kOutputLimit = 1 << 16;  // a host that doesn't read holds the device up
constexpr Nanoseconds kLongestWait = 10 * kMillisecond;

volatile std::sig_atomic_t stopped = 0;

Nanoseconds readClock(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return time.tv_sec * kSecond + time.tv_nsec;
}

// The signals that end the program come only between its steps.
class Signals {
 public:
  Signals() {
    sigset_t ending;
    sigemptyset(&ending);
    sigaddset(&ending, SIGINT);
    sigaddset(&ending, SIGTERM);
    sigprocmask(SIG_BLOCK, &ending, &before_);
    struct sigaction action {};
    action.sa_handler = [](int) { stopped = 1; };
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGTERM, &action, nullptr);
    signal(SIGPIPE, SIG_IGN);
  }
  ~Signals() { sigprocmask(SIG_SETMASK, &before_, nullptr); }
  const sigset_t& whileWaiting() const { return before_; }
  /// Where there is always input, ppoll() lets none through.
  void deliver() const {
    sigset_t blocked;
    sigprocmask(SIG_SETMASK, &before_, &blocked);
    sigprocmask(SIG_SETMASK, &blocked, nullptr);
  }

 private:
  sigset_t before_;
};

class Runner {
 public:
  Runner(Device& device, Port& port, const RunOptions& options)
      : device_(device), port_(port), options_(options), start_(readClock(CLOCK_MONOTONIC)) {}

  void step(const sigset_t& signals) {
    options_.poll();
    const Nanoseconds now = readClock(CLOCK_MONOTONIC) - start_;
    device_.tick(now);
    if (device_.linkUp() && !port_.isOpen()) port_.open();
    if (!device_.linkUp()) pullCable();
    followConnection(now);
    if (device_.connected()) {
      if (options_.check_baud_rate) device_.setHostBaudRate(port_.baudRate());
      const std::string bytes = port_.read();
      if (!bytes.empty()) device_.received(bytes, now);
      followConnection(now);
    }
    transmit();
    log();
    wait(now, signals);
  }

 private:
  void followConnection(Nanoseconds now) {
    port_.update();
    if (port_.connection() == connection_) return;
    connection_ = port_.connection();
    output_.clear();
    device_.disconnect(now);
    if (connection_ > 0) device_.connect(now);
  }

  void pullCable() {
    output_.clear();
    port_.close();
    connection_ = 0;
  }

  void transmit() {
    flush();
    while (output_.size() < kOutputLimit) {
      const Device::Output output = device_.takeOutput();
      if (output.empty()) return;
      if (output.disconnect) pullCable();
      output_ += output.bytes;
      flush();
    }
  }

  void flush() {
    if (!output_.empty() && port_.connection() > 0) output_.erase(0, port_.write(output_));
  }

  void log() {
    if (!options_.truth) return;
    for (const SentScan& scan : device_.takeSentScans()) {
      options_.truth->write(scan, start_ + readClock(CLOCK_REALTIME) - readClock(CLOCK_MONOTONIC));
    }
  }

  void wait(Nanoseconds now, const sigset_t& signals) {
    pollfd watched[2];
    nfds_t count = 0;
    if (port_.hostDescriptor() >= 0) {
      const short events = output_.empty() ? POLLIN : POLLIN | POLLOUT;
      watched[count++] = {port_.hostDescriptor(), events, 0};
    }
    if (port_.listenDescriptor() >= 0) watched[count++] = {port_.listenDescriptor(), POLLIN, 0};
    Nanoseconds until = now + kLongestWait;
    if (output_.size() < kOutputLimit) until = std::min(until, device_.deadline());
    const Nanoseconds left = std::max<Nanoseconds>(until + start_ - readClock(CLOCK_MONOTONIC), 0);
    const timespec timeout{static_cast<time_t>(left / kSecond), static_cast<long>(left % kSecond)};
    ppoll(watched, count, &timeout, &signals);
  }

  Device& device_;
  Port& port_;
  const RunOptions& options_;
  const Nanoseconds start_;
  int connection_ = 0;
  std::string output_;
};

}  // namespace

void runDevice(Device& device, Port& port, const RunOptions& options) {
  const Signals signals;
  port.open();
  std::cout << "ready" << std::endl;
  Runner runner(device, port, options);
  while (!stopped) {
    runner.step(signals.whileWaiting());
    signals.deliver();
  }
  port.close();
}

void printCounts(const Device& device) {
  const Counts& counts = device.counts();
  std::cout << "connects " << counts.connects << "\ncommands " << counts.commands << "\nscans "
            << counts.scans << "\nskipped " << counts.skipped << '\n';
  for (const Fault fault : allFaults()) {
    if (device.faults().count(fault) > 0)
      std::cout << "injected " << faultName(fault) << ' ' << device.faults().count(fault) << '\n';
  }
  std::cout << std::flush;
}

}  // namespace device_emulators
