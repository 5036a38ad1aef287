// SPDX-License-Identifier: BSD-3-Clause
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "port.h"

namespace device_emulators {

void TcpPort::open() {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port_));
  if (inet_pton(AF_INET, address_.c_str(), &address.sin_addr) != 1) {
    throw std::runtime_error("'" + address_ + "' is no IPv4 address");
  }
  listener_ = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  const int on = 1;
  setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(listener_, 4) != 0) {
    const std::string why = std::strerror(errno);
    close();
    throw std::runtime_error("TCP port " + address_ + ":" + std::to_string(port_) + ": " + why);
  }
}

void TcpPort::dropClient(bool reset) {
  if (client_ < 0) return;
  if (reset) {
    const linger at_once{1, 0};
    setsockopt(client_, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  }
  ::close(client_);
  client_ = -1;
}

void TcpPort::close() {
  dropClient(true);
  if (listener_ >= 0) ::close(listener_);
  listener_ = -1;
}

void TcpPort::update() {
  if (listener_ < 0) return;
  const int fresh = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (fresh < 0) return;
  // The first client may have gone without our having read so.
  pollfd first{client_, POLLRDHUP, 0};
  if (client_ >= 0 && poll(&first, 1, 0) != 0) dropClient(false);
  if (client_ >= 0 && !replace_) {
    ::close(fresh);
    return;
  }
  dropClient(true);
  client_ = fresh;
  ++connections_;
  const int on = 1;
  setsockopt(client_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

std::string TcpPort::read() {
  char buffer[4096];
  const ssize_t size = recv(client_, buffer, sizeof buffer, 0);
  if (size == 0 || (size < 0 && errno != EAGAIN && errno != EINTR)) dropClient(false);
  return std::string(buffer, size > 0 ? static_cast<std::size_t>(size) : 0);
}

std::size_t TcpPort::write(std::string_view bytes) {
  const ssize_t size = send(client_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  if (size < 0 && errno != EAGAIN && errno != EINTR) dropClient(false);
  return size > 0 ? static_cast<std::size_t>(size) : 0;
}

}  // namespace device_emulators
