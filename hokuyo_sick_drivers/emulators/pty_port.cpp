// SPDX-License-Identifier: BSD-3-Clause
#include <asm/termbits.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "port.h"

namespace device_emulators {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

void makeRaw(int terminal) {
  termios2 settings;
  if (ioctl(terminal, TCGETS2, &settings) != 0) return;
  settings.c_iflag = 0;
  settings.c_oflag = 0;
  settings.c_lflag = 0;
  settings.c_cflag = (settings.c_cflag & CBAUD) | CS8 | CREAD | CLOCAL;
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  ioctl(terminal, TCSETS2, &settings);
}

}  // namespace

void PtyPort::open() {
  master_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (master_ < 0 || grantpt(master_) != 0 || unlockpt(master_) != 0) fail("no pseudo terminal");
  char name[64];
  if (ptsname_r(master_, name, sizeof name) != 0) fail("no pseudo terminal");
  terminal_ = name;
  // Opened once, so that the master's end shows from now on whether a host has it open.
  const int terminal = ::open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (terminal < 0) fail(terminal_);
  makeRaw(terminal);
  ::close(terminal);

  if (fs::exists(fs::symlink_status(link_)) && !fs::is_symlink(link_)) {
    throw std::runtime_error(link_ + " is there and isn't a link");
  }
  std::error_code error;
  const std::string fresh = link_ + ".new";
  fs::remove(fresh, error);
  fs::create_symlink(terminal_, fresh, error);
  if (!error) fs::rename(fresh, link_, error);
  if (error) throw std::runtime_error("can't make the link " + link_ + ": " + error.message());
}

void PtyPort::close() {
  if (master_ < 0) return;
  std::error_code error;
  if (fs::is_symlink(link_, error) && fs::read_symlink(link_, error) == terminal_) fs::remove(link_, error);
  ::close(master_);
  master_ = -1;
  host_ = false;
}

void PtyPort::update() {
  if (master_ < 0) return;
  pollfd state{master_, POLLIN, 0};
  if (poll(&state, 1, 0) < 0) return;
  const bool host = !(state.revents & POLLHUP) || (host_ && (state.revents & POLLIN));
  if (host && !host_) ++connections_;
  host_ = host;
}

std::string PtyPort::read() {
  char buffer[4096];
  const ssize_t size = ::read(master_, buffer, sizeof buffer);
  return std::string(buffer, size > 0 ? static_cast<std::size_t>(size) : 0);
}

std::size_t PtyPort::write(std::string_view bytes) {
  const ssize_t size = ::write(master_, bytes.data(), bytes.size());
  return size > 0 ? static_cast<std::size_t>(size) : 0;
}

int PtyPort::baudRate() const {
  termios2 settings;
  // Asked of the master, Linux tells the settings of the terminal.
  if (master_ < 0 || ioctl(master_, TCGETS2, &settings) != 0) return 0;
  return static_cast<int>(settings.c_ospeed);
}

}  // namespace device_emulators
