// SPDX-License-Identifier: BSD-3-Clause
#include "hokuyo_sick_drivers/zf/byte_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace hokuyo_sick_drivers {
namespace {

class FileSource : public ByteSource {
 public:
  explicit FileSource(const std::string& path)
      : path_(path), file_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    struct stat status {};
    if (file_ < 0 || fstat(file_, &status) != 0) fail();
    if (!S_ISREG(status.st_mode)) {
      close(file_);
      throw std::runtime_error(path + " is no regular file");
    }
    size_ = static_cast<std::uint64_t>(status.st_size);
  }
  ~FileSource() override { close(file_); }
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;

  std::uint64_t size() const override { return size_; }

  std::size_t read(std::uint64_t offset, char* to, std::size_t count) override {
    std::size_t done = 0;
    while (done < count && offset + done < size_) {
      const ssize_t got = pread(file_, to + done, count - done, static_cast<off_t>(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) throw std::runtime_error(path_ + " can't be read: " + std::strerror(errno));
      if (got == 0) break;
      done += static_cast<std::size_t>(got);
    }
    return done;
  }

 private:
  [[noreturn]] void fail() {
    const int error = errno;
    if (file_ >= 0) close(file_);
    throw std::runtime_error(path_ + " can't be read: " + std::strerror(error));
  }

  std::string path_;
  int file_;
  std::uint64_t size_ = 0;
};

class MemorySource : public ByteSource {
 public:
  MemorySource(const char* bytes, std::size_t size) : bytes_(bytes), size_(size) {}

  std::uint64_t size() const override { return size_; }

  std::size_t read(std::uint64_t offset, char* to, std::size_t count) override {
    if (offset >= size_) return 0;
    count = std::min(count, size_ - static_cast<std::size_t>(offset));
    std::copy_n(bytes_ + offset, count, to);
    return count;
  }

 private:
  const char* bytes_;
  std::size_t size_;
};

}  // namespace

std::shared_ptr<ByteSource> openFile(const std::string& path) {
  return std::make_shared<FileSource>(path);
}

std::shared_ptr<ByteSource> openMemory(const char* bytes, std::size_t size) {
  return std::make_shared<MemorySource>(bytes, size);
}

}  // namespace hokuyo_sick_drivers
