// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/socket.h>

#include <atomic>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "hokuyo_sick_drivers/protocol.h"

namespace hokuyo_sick_drivers {

/// An open file, closed at the end.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor();
  int get() const { return fd_; }

 private:
  int fd_;
};

/// Where a device is: at a TCP port or at a serial one.
struct Endpoint {
  std::string host;  ///< name or address; empty: serial
  int tcp_port = 0;
  std::string device;    ///< e.g. /dev/ttyUSB0
  int baud_rate = 9600;  ///< to start with; raw, 8 data bits, no parity, no flow control

  std::string name() const { return host.empty() ? device : host + ":" + std::to_string(tcp_port); }
};

/// Where a host is. A name may have several.
struct SocketAddress {
  sockaddr_storage address{};
  socklen_t size = 0;
};
/// The addresses of a host, IPv4 and IPv6, in the order in which they are to be tried; may take long.
/// @throws std::runtime_error that says why there are none
std::vector<SocketAddress> lookUp(const Endpoint& endpoint);

/// Runs a protocol on a port, in a thread of its own, until it is destroyed. A port that isn't there, or
/// goes, is opened anew by its name, again and again.
class Connection {
 public:
  struct Options {
    Nanoseconds connect_timeout = kSecond;                         ///< for each address
    Nanoseconds first_retry = kSecond / 10, last_retry = kSecond;  ///< pause, doubled each time
    Nanoseconds stop_timeout = 2 * kSecond;  ///< that the protocol's shutDown() may take
    std::function<std::vector<SocketAddress>(const Endpoint&)> look_up = lookUp;
  };
  /// Called in the connection's thread. None may throw. That the protocol has the port opened anew is no
  /// event, as long as it can be.
  struct Events {
    std::function<void()> connected;
    std::function<void(const std::string& why)> lost;     ///< after connected
    std::function<void(const std::string& why)> refused;  ///< couldn't be opened
    /// An exception has left the protocol or posted work. If the port was open, `lost` follows.
    std::function<void(const std::string& what)> failed;
  };

  /// Starts. From now on the protocol belongs to the connection's thread.
  Connection(const Endpoint& endpoint, Protocol& protocol, const Events& events, const Options& options);
  Connection(const Endpoint& endpoint, Protocol& protocol, const Events& events)
      : Connection(endpoint, protocol, events, Options()) {}
  /// Stops the device, waits for that, and closes the port.
  ~Connection();

  /// Has `work` done in the connection's thread, at once, be the port open, being opened or not. Work that
  /// comes while the connection is being destroyed may be dropped.
  void post(const std::function<void(Nanoseconds now)>& work);

  /// CLOCK_MONOTONIC, the time that the protocol gets.
  static Nanoseconds now();

 private:
  struct Lost;  // thrown where the port is gone

  void run();
  FileDescriptor open();
  std::vector<SocketAddress> addresses();
  int connect(int fd, const SocketAddress& address);
  bool serveUntilLost(int fd);
  void serve(int fd);
  void send(int fd);
  void receive(int fd);
  bool waitUntil(Nanoseconds time);
  int poll(int fd, short events, Nanoseconds until);
  void work();

  const Endpoint endpoint_;
  Protocol& protocol_;
  const Events events_;
  const Options options_;

  std::deque<Protocol::Output> output_;
  std::vector<char> buffer_;
  bool heard_ = false;      // something, since the port was opened
  bool reopening_ = false;  // as the protocol asked for it

  FileDescriptor wake_;  // readable when there is work or the end has come
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::vector<std::function<void(Nanoseconds)>> work_;
  std::thread thread_;
};

/// @return the port, non-blocking
/// @throws std::runtime_error that says why it can't be opened, locked or set up
FileDescriptor openSerialPort(const std::string& device, int baud_rate);
/// Waits until all is sent, then switches.
/// @throws std::runtime_error
void setBaudRate(int fd, int baud_rate);

}  // namespace hokuyo_sick_drivers
