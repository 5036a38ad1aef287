// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/vocabulary_file.h"

#include <mapping_common/files.h>

#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <type_traits>

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              "vocabulary files are little endian, and written as they are in memory");

namespace ibuild_loop_closure {
namespace {

constexpr char kMagic[8] = {'I', 'B', 'U', 'I', 'L', 'D', 'V', 'C'};
constexpr std::uint32_t kVersion = 2;

// FNV-1a over words of 8 bytes, in four lanes: a gigabyte takes a quarter of a second.
class Checksum {
 public:
  void add(const char* data, std::size_t size) {
    while (size > 0 && filled_ > 0) push(*data++), --size;
    for (; size >= sizeof(block_); data += sizeof(block_), size -= sizeof(block_)) mix(data);
    while (size > 0) push(*data++), --size;
  }
  std::uint64_t value() const {
    Checksum last = *this;
    last.push(1);
    while (last.filled_ > 0) last.push(0);
    std::uint64_t sum = kOffset;
    for (std::uint64_t lane : last.lanes_) sum = (sum ^ lane ^ (lane >> 29)) * kPrime;
    return sum ^ (sum >> 32);
  }

 private:
  static constexpr std::uint64_t kOffset = 14695981039346656037u, kPrime = 1099511628211u;
  void push(char byte) {
    block_[filled_++] = byte;
    if (filled_ == sizeof(block_)) {
      mix(block_);
      filled_ = 0;
    }
  }
  void mix(const char* data) {
    for (int i = 0; i < 4; ++i) {
      std::uint64_t word;
      std::memcpy(&word, data + 8 * i, 8);
      lanes_[i] = (lanes_[i] ^ word) * kPrime;
      lanes_[i] ^= lanes_[i] >> 47;
    }
  }
  std::uint64_t lanes_[4] = {kOffset, kOffset + 1, kOffset + 2, kOffset + 3};
  char block_[32];
  std::size_t filled_ = 0;
};

class Writer {
 public:
  explicit Writer(std::ostream& out) : out_(out) {}
  void bytes(const void* data, std::size_t size) {
    checksum_.add(static_cast<const char*>(data), size);
    out_.write(static_cast<const char*>(data), static_cast<std::streamsize>(size));
  }
  template <class T>
  void operator()(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes(&value, sizeof(T));
  }
  template <class T>
  void operator()(const std::vector<T>& values) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    bytes(values.data(), values.size() * sizeof(T));
  }
  std::uint64_t checksum() const { return checksum_.value(); }

 private:
  std::ostream& out_;
  Checksum checksum_;
};

class Reader {
 public:
  Reader(const char* begin, const char* end) : at_(begin), end_(end) {}
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }
  template <class T>
  void operator()(T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    copy(&value, 1, sizeof(T));
  }
  template <class T>
  void operator()(std::vector<T>& values) {
    values.resize(count(sizeof(T)));
    copy(values.data(), values.size(), sizeof(T));
  }
  // A number of things of at least that size each.
  std::size_t count(std::size_t size) {
    std::uint64_t count = 0;
    (*this)(count);
    if (count > left() / size)
      throw std::runtime_error("it is inconsistent: it says that it holds more than it does");
    return count;
  }

 private:
  void copy(void* to, std::size_t count, std::size_t size) {
    if (left() / size < count) throw std::runtime_error("it is truncated");
    if (count > 0) std::memcpy(to, at_, count * size);
    at_ += count * size;
  }
  const char *at_, *end_;
};

template <class Archive, class Options>
void visitOptions(Archive& archive, int& delta, Options& o) {
  std::int32_t type = static_cast<std::int32_t>(o.type), nearest = o.nearest;
  archive(delta);
  archive(type);
  archive(nearest);
  archive(o.links);
  archive(o.insert_breadth);
  archive(o.search_breadth);
  if (type < 0 || type > static_cast<std::int32_t>(IndexType::kGraph))
    throw std::runtime_error("it has an index of an unknown type");
  o.type = static_cast<IndexType>(type);
  o.nearest = nearest != 0;
}

View readView(Reader& read) {
  View view;
  read(view.size.width);
  read(view.size.height);
  read(view.features.points);
  read(view.features.descriptors);
  read(view.depths);
  const std::size_t count = view.features.descriptors.size();
  if (view.features.points.size() != count || (!view.depths.empty() && view.depths.size() != count))
    throw std::runtime_error("it has an image whose features are incomplete");
  return view;
}

VocabularyFile parse(const std::string& bytes) {
  std::uint32_t version = 0;
  std::uint64_t checksum = 0;
  if (bytes.size() < sizeof(kMagic) || std::memcmp(bytes.data(), kMagic, sizeof(kMagic)) != 0)
    throw std::runtime_error("it isn't a vocabulary of this package");
  if (bytes.size() < sizeof(kMagic) + sizeof(version) + sizeof(checksum))
    throw std::runtime_error("it is truncated");
  const char* end = bytes.data() + bytes.size() - sizeof(checksum);
  Reader read(bytes.data() + sizeof(kMagic), end);
  read(version);
  if (version != kVersion) {
    throw std::runtime_error("it has format version " + std::to_string(version) + ", this program reads " +
                             std::to_string(kVersion));
  }
  std::memcpy(&checksum, end, sizeof(checksum));
  Checksum expected;
  expected.add(bytes.data(), bytes.size() - sizeof(checksum));
  if (expected.value() != checksum)
    throw std::runtime_error("it is truncated or corrupted: its checksum is wrong");

  VocabularyFile file;
  Vocabulary::Content& content = file.content;
  visitOptions(read, content.delta, content.index);
  read(content.words);
  content.image_words.resize(read.count(sizeof(std::uint64_t)));
  for (std::vector<int>& words : content.image_words) read(words);
  read(content.links);
  file.views.reserve(read.count(sizeof(std::uint64_t)));
  for (std::size_t i = 0, count = file.views.capacity(); i < count; ++i) file.views.push_back(readView(read));
  if (!file.views.empty() && file.views.size() != content.image_words.size())
    throw std::runtime_error("it has features of some images only");
  if (read.left() > 0) throw std::runtime_error("it holds more than it says");
  return file;
}

// As mapping_common::readFile, into memory of the right size at once.
std::string readWhole(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = in ? static_cast<std::streamoff>(in.tellg()) : -1;
  if (size < 0 || size == std::numeric_limits<std::streamoff>::max())
    throw std::runtime_error("it can't be opened");
  std::string bytes(static_cast<std::size_t>(size), '\0');
  in.seekg(0);
  in.read(&bytes[0], size);
  if (!in) throw std::runtime_error("it can't be read");
  return bytes;
}

}  // namespace

void saveVocabulary(const std::string& path, const VocabularyFile& file) {
  mapping_common::writeFile(path, [&file](std::ostream& out) {
    Writer write(out);
    write(kMagic);
    write(kVersion);
    int delta = file.content.delta;
    IndexOptions index = file.content.index;
    visitOptions(write, delta, index);
    write(file.content.words);
    write(static_cast<std::uint64_t>(file.content.image_words.size()));
    for (const std::vector<int>& words : file.content.image_words) write(words);
    write(file.content.links);
    write(static_cast<std::uint64_t>(file.views.size()));
    for (const View& view : file.views) {
      write(view.size.width);
      write(view.size.height);
      write(view.features.points);
      write(view.features.descriptors);
      write(view.depths);
    }
    const std::uint64_t checksum = write.checksum();
    write(checksum);
  });
}

VocabularyFile loadVocabulary(const std::string& path) {
  try {
    return parse(readWhole(path));
  } catch (const std::exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

}  // namespace ibuild_loop_closure
