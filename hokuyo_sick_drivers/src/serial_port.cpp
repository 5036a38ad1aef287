// SPDX-License-Identifier: BSD-3-Clause
//
// Linux's own termios2 instead of the C library's termios: it takes any baud rate, 250000 and 750000 too.
#include <asm/termbits.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <stdexcept>

#include "hokuyo_sick_drivers/connection.h"

namespace hokuyo_sick_drivers {
namespace {

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

// Rates that have a name keep it, for whoever looks at the port by other means.
tcflag_t toFlag(int baud_rate) {
  static const std::map<int, tcflag_t> flags = {
      {9600, B9600},     {19200, B19200},   {38400, B38400},   {57600, B57600},   {115200, B115200},
      {230400, B230400}, {460800, B460800}, {500000, B500000}, {921600, B921600}, {1000000, B1000000}};
  const auto flag = flags.find(baud_rate);
  return flag != flags.end() ? flag->second : BOTHER;
}

// Raw: 8 data bits, no parity, one stop bit, no flow control, no echo, nothing translated.
void setUp(int fd, int baud_rate) {
  termios2 settings{};
  if (ioctl(fd, TCGETS2, &settings) != 0) fail("can't read the port's settings");
  settings.c_iflag = settings.c_oflag = settings.c_lflag = 0;
  settings.c_cflag = CS8 | CLOCAL | CREAD | toFlag(baud_rate);
  settings.c_ispeed = settings.c_ospeed = static_cast<speed_t>(baud_rate);
  settings.c_cc[VMIN] = 1;  // nothing there is EAGAIN, a hung up line is 0
  settings.c_cc[VTIME] = 0;
  if (ioctl(fd, TCSETS2, &settings) != 0)
    fail("can't set the port to " + std::to_string(baud_rate) + " baud");
}

}  // namespace

FileDescriptor openSerialPort(const std::string& device, int baud_rate) {
  FileDescriptor file(open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (file.get() < 0) fail("can't open " + device);
  if (flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
    throw std::runtime_error(device + " is in use by another program");
  }
  setUp(file.get(), baud_rate);
  ioctl(file.get(), TCFLSH, TCIOFLUSH);
  return file;
}

void setBaudRate(int fd, int baud_rate) {
  while (ioctl(fd, TCSBRK, 1) != 0) {  // tcdrain
    if (errno != EINTR) fail("can't send");
  }
  setUp(fd, baud_rate);
}

}  // namespace hokuyo_sick_drivers
