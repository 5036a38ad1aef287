// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <utility>

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
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) fail(path, "can't be opened", errno);
  struct stat status {};
  // One byte more than it says it has, which tells that there is no more.
  std::string bytes(fstat(file, &status) == 0 ? static_cast<std::size_t>(status.st_size) + 1 : 4096, '\0');
  std::size_t size = 0;
  ssize_t count = 0;
  do {
    if (size == bytes.size()) bytes.resize(2 * size);
    count = read(file, &bytes[size], bytes.size() - size);
    if (count > 0) size += static_cast<std::size_t>(count);
  } while (count > 0 || (count < 0 && errno == EINTR));
  const int error = errno;
  close(file);
  if (count < 0) fail(path, "can't be read", error);
  bytes.resize(size);
  return bytes;
}

void requireOwnEnding(const std::string& path) {
  constexpr std::pair<const char*, const char*> kForeign[] = {
      {".bt", "OctoMap's"},       {".ot", "OctoMap's"},       {".pcd", "PCL's"},
      {".ply", "that of clouds"}, {".pgm", "map_server's"},   {".yaml", "that of parameters"},
      {".png", "that of images"}, {".jpg", "that of images"}, {".bag", "rosbag's"}};
  for (const auto& [ending, whose] : kForeign) {
    const std::string end = ending;
    if (path.size() >= end.size() && path.compare(path.size() - end.size(), end.size(), end) == 0) {
      throw std::invalid_argument("path is '" + path + "', but the format isn't " + whose +
                                  ": allowed is another ending, or none");
    }
  }
}

}  // namespace mapping_common
