// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/connection.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <utility>

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kReadSize = 65536;

[[noreturn]] void fail(const std::string& what, int error) {
  throw std::runtime_error(what + ": " + std::strerror(error));
}

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

Addresses resolve(const Endpoint& endpoint) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int error =
      getaddrinfo(endpoint.host.c_str(), std::to_string(endpoint.tcp_port).c_str(), &hints, &found);
  if (error != 0) throw std::runtime_error("can't resolve " + endpoint.host + ": " + gai_strerror(error));
  return {found, &freeaddrinfo};
}

}  // namespace

struct Connection::Lost : std::runtime_error {
  using std::runtime_error::runtime_error;
};

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
    try {
      const FileDescriptor port = open();
      output_.clear();
      events_.connected();
      protocol_.connected(now());
      try {
        serve(port.get());
        return;
      } catch (const Lost& lost) {
        protocol_.disconnected(now());
        events_.lost(lost.what());
      }
    } catch (const std::runtime_error& e) {
      if (!stop_) events_.refused(e.what());
    }
    pause = heard_ ? options_.first_retry : std::min(2 * pause, options_.last_retry);
    const Nanoseconds end = now() + pause;
    while (!stop_ && waitUntil(end)) work();
  }
}

FileDescriptor Connection::open() {
  if (endpoint_.host.empty()) return openSerialPort(endpoint_.device, endpoint_.baud_rate);
  int error = 0;
  const Addresses addresses = resolve(endpoint_);
  for (const addrinfo* address = addresses.get(); address != nullptr; address = address->ai_next) {
    FileDescriptor file(socket(address->ai_family, address->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC,
                               address->ai_protocol));
    if (file.get() < 0) fail("can't create a socket", errno);
    error = connect(file.get(), address->ai_addr, address->ai_addrlen) == 0 ? 0 : errno;
    if (error == EINPROGRESS) {
      const Nanoseconds end = now() + options_.connect_timeout;
      int events = 0;
      while (events == 0 && !stop_ && now() < end) {
        events = poll(file.get(), POLLOUT, end);
        work();
      }
      socklen_t size = sizeof(error);
      error = ETIMEDOUT;
      if (events != 0) getsockopt(file.get(), SOL_SOCKET, SO_ERROR, &error, &size);
    }
    if (error == 0) {
      const int on = 1;
      setsockopt(file.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
      return file;
    }
  }
  fail("can't connect to " + endpoint_.name(), error);
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
    if (output.reconnect) throw Lost("the device doesn't answer as it should");
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
  for (const auto& function : work) function(now());
}

}  // namespace hokuyo_sick_drivers
