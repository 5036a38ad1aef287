// SPDX-License-Identifier: BSD-3-Clause
//
// For tests of the emulators' programs, as their users run them.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <string>
#include <vector>

namespace device_emulators {

constexpr int kPatience = 30;  // s

/// A program and what it prints.
class Program {
 public:
  explicit Program(std::vector<std::string> arguments) {
    int ends[2];
    if (pipe(ends) != 0) return;
    process_ = fork();
    if (process_ == 0) {
      dup2(ends[1], STDOUT_FILENO);
      close(ends[0]);
      std::vector<char*> raw;
      for (std::string& argument : arguments) raw.push_back(argument.data());
      raw.push_back(nullptr);
      execv(raw[0], raw.data());
      _exit(127);
    }
    close(ends[1]);
    output_ = ends[0];
  }
  ~Program() {
    if (process_ > 0) {
      kill(process_, SIGKILL);
      waitpid(process_, nullptr, 0);
    }
    close(output_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Waits until it says so.
  bool isReady() {
    std::string text;
    char byte;
    pollfd readable{output_, POLLIN, 0};
    while (poll(&readable, 1, kPatience * 1000) == 1 && read(output_, &byte, 1) == 1 && byte != '\n')
      text += byte;
    return text == "ready";
  }
  /// Ends it. @return what it printed, "" unless it ended well
  std::string stop(int signal = SIGINT) {
    if (signal > 0) kill(process_, signal);
    std::string text;
    char buffer[256];
    for (ssize_t size; (size = read(output_, buffer, sizeof buffer)) > 0;) text.append(buffer, size);
    int status = -1;
    waitpid(process_, &status, 0);
    process_ = 0;
    status_ = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return status_ == 0 ? text : "";
  }
  /// Once it was stopped, -1 if it didn't exit by itself.
  int status() const { return status_; }

 private:
  pid_t process_ = -1;
  int output_ = -1, status_ = -1;
};

inline sockaddr_in localAddress(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

inline int freePort() {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = localAddress(0);
  socklen_t size = sizeof address;
  bind(listener, reinterpret_cast<sockaddr*>(&address), size);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  close(listener);
  return ntohs(address.sin_port);
}

}  // namespace device_emulators
