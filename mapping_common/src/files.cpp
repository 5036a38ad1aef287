// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace mapping_common {
namespace {

[[noreturn]] void fail(const std::string& path, const std::string& what, int error) {
  throw std::runtime_error(path + " " + what + (error != 0 ? std::string(": ") + std::strerror(error) : ""));
}

bool flushToDisk(const std::string& path) {
  const int file = open(path.c_str(), O_WRONLY);
  if (file < 0) return false;
  const bool flushed = fsync(file) == 0;
  close(file);
  return flushed;
}

}  // namespace

void writeFile(const std::string& path, const std::function<void(std::ostream&)>& write) {
  const std::string temporary = path + ".tmp" + std::to_string(getpid());
  try {
    errno = 0;
    std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
    if (!out) fail(path, "can't be written", errno);
    write(out);
    out.close();
    if (!out || !flushToDisk(temporary)) fail(path, "can't be written", errno);
    if (std::rename(temporary.c_str(), path.c_str()) != 0) fail(path, "can't be replaced", errno);
  } catch (...) {
    std::remove(temporary.c_str());
    throw;
  }
}

std::string readFile(const std::string& path) {
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  std::ostringstream bytes;
  if (!in || !(bytes << in.rdbuf())) {
    if (in && in.peek() == std::ifstream::traits_type::eof() && errno == 0) return "";  // an empty file
    fail(path, "can't be read", errno);
  }
  return bytes.str();
}

}  // namespace mapping_common
