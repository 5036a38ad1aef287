// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/connection.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <future>
#include <stdexcept>
#include <utility>

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kReadSize = 65536;
constexpr Nanoseconds kLookUpPoll = 10 * kMillisecond;

[[noreturn]] void fail(const std::string& what, int error) {
  throw std::runtime_error(what + ": " + std::strerror(error));
}

}  // namespace

struct Connection::Lost : std::runtime_error {
  using std::runtime_error::runtime_error;
};

std::vector<SocketAddress> lookUp(const Endpoint& endpoint) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* first = nullptr;
  const int error =
      getaddrinfo(endpoint.host.c_str(), std::to_string(endpoint.tcp_port).c_str(), &hints, &first);
  if (error != 0) throw std::runtime_error("can't resolve " + endpoint.host + ": " + gai_strerror(error));
  std::vector<SocketAddress> addresses;
  for (const addrinfo* found = first; found != nullptr; found = found->ai_next) {
    addresses.emplace_back();
    addresses.back().size = found->ai_addrlen;
    std::memcpy(&addresses.back().address, found->ai_addr, found->ai_addrlen);
  }
  freeaddrinfo(first);
  return addresses;
}

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) ::close(fd_);
}

Nanoseconds Connection::now() {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * kSecond + time.tv_nsec;
}

Connection::Connection(const Endpoint& endpoint, Protocol& protocol, const Events& events,
                       const Options& options)
    : endpoint_(endpoint),
      protocol_(protocol),
      events_(events),
      options_(options),
      buffer_(kReadSize),
      wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (wake_.get() < 0) fail("can't create an eventfd", errno);
  thread_ = std::thread([this] { run(); });
}

Connection::~Connection() {
  stop_ = true;
  eventfd_write(wake_.get(), 1);
  thread_.join();
}

void Connection::post(const std::function<void(Nanoseconds)>& work) {
  const std::lock_guard<std::mutex> lock(mutex_);
  work_.push_back(work);
  eventfd_write(wake_.get(), 1);
}

void Connection::run() {
  Nanoseconds pause = options_.first_retry;
  while (!stop_) {
    heard_ = false;
    FileDescriptor port;
    try {
      port = open();
    } catch (const std::exception& e) {
      reopening_ = false;
      if (!stop_) events_.refused(e.what());
    }
    if (port.get() >= 0 && serveUntilLost(port.get())) return;
    port = FileDescriptor();
    pause = heard_ ? options_.first_retry : std::min(2 * pause, options_.last_retry);
    const Nanoseconds end = now() + pause;
    while (!stop_ && waitUntil(end)) work();
  }
}

FileDescriptor Connection::open() {
  if (endpoint_.host.empty()) return openSerialPort(endpoint_.device, endpoint_.baud_rate);
  int error = EADDRNOTAVAIL;
  for (const SocketAddress& address : addresses()) {
    FileDescriptor file(socket(address.address.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    error = file.get() < 0 ? errno : connect(file.get(), address);  // IPv6 may be switched off
    if (error != 0) continue;
    const int on = 1;
    setsockopt(file.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    return file;
  }
  fail("can't connect to " + endpoint_.name(), error);
}

// Nothing can end a look-up, which takes as long as name servers are silent. It has a thread of its own that
// may outlive this connection.
std::vector<SocketAddress> Connection::addresses() {
  std::packaged_task<std::vector<SocketAddress>()> task(
      [look_up = options_.look_up, endpoint = endpoint_] { return look_up(endpoint); });
  auto found = task.get_future();
  std::thread(std::move(task)).detach();
  while (found.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
    if (stop_) throw std::runtime_error("the connection is being closed");
    waitUntil(now() + kLookUpPoll);
    work();
  }
  return found.get();
}

// @return 0 or why not
int Connection::connect(int fd, const SocketAddress& address) {
  const int error =
      ::connect(fd, reinterpret_cast<const sockaddr*>(&address.address), address.size) == 0 ? 0 : errno;
  if (error != EINPROGRESS) return error;
  const Nanoseconds end = now() + options_.connect_timeout;
  int events = 0;
  while (events == 0 && !stop_ && now() < end) {
    events = poll(fd, POLLOUT, end);
    work();
  }
  int result = ETIMEDOUT;
  socklen_t size = sizeof(result);
  if (events != 0) getsockopt(fd, SOL_SOCKET, SO_ERROR, &result, &size);
  return result;
}

// @return whether it was stopped, as asked
bool Connection::serveUntilLost(int fd) {
  std::string why;
  output_.clear();
  if (!reopening_) events_.connected();
  reopening_ = false;
  try {
    protocol_.connected(now());
    serve(fd);
    return true;
  } catch (const Lost& lost) {
    why = lost.what();
  } catch (const std::exception& e) {
    events_.failed(e.what());
    why = "the driver failed";
  }
  protocol_.disconnected(now());
  if (!reopening_) events_.lost(why);
  return false;
}

// Returns once the device is stopped.
void Connection::serve(int fd) {
  Nanoseconds give_up = kNever;
  while (true) {
    if (stop_ && give_up == kNever) {
      protocol_.shutDown(now());
      give_up = now() + options_.stop_timeout;
    }
    work();
    // What has come while this process was put aside goes before any time-out.
    if (now() >= protocol_.deadline() && poll(fd, POLLIN, now()) != 0) receive(fd);
    if (now() >= protocol_.deadline()) protocol_.tick(now());
    for (auto output = protocol_.takeOutput(); !output.empty(); output = protocol_.takeOutput()) {
      output_.push_back(std::move(output));
    }
    send(fd);
    if (give_up != kNever && ((protocol_.done() && output_.empty()) || now() >= give_up)) return;
    const short events = output_.empty() ? POLLIN : POLLIN | POLLOUT;
    if ((poll(fd, events, std::min(protocol_.deadline(), give_up)) & ~POLLOUT) != 0) receive(fd);
  }
}

void Connection::send(int fd) {
  while (!output_.empty()) {
    Protocol::Output& output = output_.front();
    while (!output.bytes.empty()) {
      const ssize_t size = endpoint_.host.empty()
                               ? ::write(fd, output.bytes.data(), output.bytes.size())
                               : ::send(fd, output.bytes.data(), output.bytes.size(), MSG_NOSIGNAL);
      if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
      if (size < 0) throw Lost(std::string("can't send: ") + std::strerror(errno));
      output.bytes.erase(0, static_cast<std::size_t>(size));
    }
    if (output.baud_rate != 0 && endpoint_.host.empty()) {
      try {
        setBaudRate(fd, output.baud_rate);
      } catch (const std::runtime_error& e) {
        throw Lost(e.what());
      }
    }
    if (output.reconnect) {
      reopening_ = true;
      throw Lost("to be opened anew");
    }
    output_.pop_front();
  }
}

void Connection::receive(int fd) {
  const ssize_t size = ::read(fd, buffer_.data(), buffer_.size());
  const Nanoseconds time = now();
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (size < 0) throw Lost(std::string("can't read: ") + std::strerror(errno));
  if (size == 0)
    throw Lost(endpoint_.host.empty() ? "the port has gone" : "the device closed the connection");
  heard_ = true;
  protocol_.received({buffer_.data(), static_cast<std::size_t>(size)}, time);
}

// @return false once the time has come
bool Connection::waitUntil(Nanoseconds time) {
  poll(-1, 0, time);
  return now() < time;
}

// Waits for the port, for work, or for the time. @return what poll() says of the port
int Connection::poll(int fd, short events, Nanoseconds until) {
  std::array<pollfd, 2> files{pollfd{wake_.get(), POLLIN, 0}, pollfd{fd, events, 0}};
  const Nanoseconds left = std::clamp<Nanoseconds>(until - now(), 0, 3600 * kSecond);
  const timespec timeout{left / kSecond, left % kSecond};
  if (ppoll(files.data(), files.size(), &timeout, nullptr) <= 0) return 0;
  eventfd_t count = 0;
  eventfd_read(wake_.get(), &count);
  return files[1].revents;
}

void Connection::work() {
  std::vector<std::function<void(Nanoseconds)>> work;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    work.swap(work_);
  }
  for (const auto& function : work) {
    try {
      function(now());
    } catch (const std::exception& e) {
      events_.failed(e.what());
    }
  }
}

}  // namespace hokuyo_sick_drivers
