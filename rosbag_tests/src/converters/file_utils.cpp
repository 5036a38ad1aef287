// SPDX-License-Identifier: BSD-3-Clause
#include "file_utils.h"

#include <lzma.h>

#include <algorithm>
#include <boost/iostreams/copy.hpp>
#include <boost/iostreams/device/back_inserter.hpp>
#include <boost/iostreams/filter/gzip.hpp>
#include <boost/iostreams/filtering_stream.hpp>
#include <cctype>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <regex>
#include <stdexcept>

namespace rosbag_tests {

void fail(const std::string& where, const std::string& what) {
  throw std::runtime_error(where + ": " + what);
}

namespace {

constexpr std::uint64_t kDecoderMemory = 256u << 20;  // bytes; xz -9 needs 65 MiB

const char* reason(lzma_ret code) {
  switch (code) {
    case LZMA_FORMAT_ERROR:
      return "not an xz file";
    case LZMA_DATA_ERROR:
      return "corrupt xz data";
    case LZMA_BUF_ERROR:
      return "truncated xz data";
    case LZMA_MEMLIMIT_ERROR:
      return "xz data that needs more than 256 MiB to unpack";
    default:
      return "xz data that liblzma can't unpack";
  }
}

std::string unpack(const std::string& packed, const std::string& path) {
  lzma_stream stream = LZMA_STREAM_INIT;
  const std::unique_ptr<lzma_stream, decltype(&lzma_end)> guard(&stream, &lzma_end);
  lzma_ret code = lzma_stream_decoder(&stream, kDecoderMemory, LZMA_CONCATENATED);
  std::string bytes;
  stream.next_in = reinterpret_cast<const std::uint8_t*>(packed.data());
  stream.avail_in = packed.size();
  while (code == LZMA_OK) {
    bytes.resize(2 * bytes.size() + 65536);
    stream.next_out = reinterpret_cast<std::uint8_t*>(&bytes[stream.total_out]);
    stream.avail_out = bytes.size() - stream.total_out;
    code = lzma_code(&stream, LZMA_FINISH);
  }
  if (code != LZMA_STREAM_END)
    fail(path, std::string(reason(code)) + " at byte " + std::to_string(stream.total_in));
  bytes.resize(stream.total_out);
  return bytes;
}

std::string gunzip(std::ifstream& file, const std::string& path) {
  namespace io = boost::iostreams;
  std::string bytes;
  try {
    io::filtering_istream stream;
    stream.push(io::gzip_decompressor());
    stream.push(file);
    stream.exceptions(std::ios::badbit);
    io::copy(stream, io::back_inserter(bytes));
  } catch (const std::ios::failure&) {  // gzip_error, and what a stream makes of it
    fail(path, "not a gzip file, or one that is corrupt or truncated after " + std::to_string(bytes.size()) +
                   " unpacked bytes");
  }
  return bytes;
}

/// File names whose digits count as numbers: 2 before 10.
bool naturalLess(const std::string& a, const std::string& b) {
  const auto digit = [](const std::string& s, std::size_t i) {
    return i < s.size() && std::isdigit(static_cast<unsigned char>(s[i]));
  };
  const auto number = [&](const std::string& s, std::size_t& i) {  // without leading zeros
    while (s[i] == '0' && digit(s, i + 1)) ++i;
    const std::size_t start = i;
    while (digit(s, i)) ++i;
    return s.substr(start, i - start);
  };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a, i) && digit(b, j)) {
      const std::string m = number(a, i), n = number(b, j);
      if (m != n) return m.size() != n.size() ? m.size() < n.size() : m < n;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i, ++j;
    }
  }
  return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

}  // namespace

std::string readFileBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file.is_open() || std::filesystem::is_directory(path)) fail(path, "can't be read");
  const std::filesystem::path extension = std::filesystem::path(path).extension();
  if (extension == ".gz") return gunzip(file, path);
  std::string bytes{std::istreambuf_iterator<char>(file), {}};
  return extension == ".xz" ? unpack(bytes, path) : bytes;
}

std::vector<std::pair<std::string, std::filesystem::path>> matchingFiles(const std::string& folder,
                                                                         const char* pattern) {
  if (!std::filesystem::is_directory(folder)) fail(folder, "not a folder");
  std::vector<std::pair<std::string, std::filesystem::path>> files;
  const std::regex regex(pattern);
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::smatch match;
    const std::string name = entry.path().filename().string();
    if (entry.is_regular_file() && std::regex_match(name, match, regex))
      files.emplace_back(match[1], entry.path());
  }
  std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) {
    return naturalLess(a.second.filename().string(), b.second.filename().string());
  });
  return files;
}

}  // namespace rosbag_tests
