// SPDX-License-Identifier: BSD-3-Clause
//
// Writes E57 files for tests, bit by bit, with the streams cut to packets as oddly as the format allows.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <vector>

namespace hokuyo_sick_drivers {

/// One field of the points: its element in the prototype, and the bits of its records.
struct E57TestField {
  std::string element;
  unsigned bits = 0;
  std::vector<std::uint64_t> raw;
  std::string bytes;  ///< of strings, instead
};

struct E57TestScan {
  std::string xml;  ///< elements before the points
  std::vector<E57TestField> fields;
  std::uint64_t records = 0;
};

template <class Float>
E57TestField floatField(const std::string& name, const std::vector<Float>& values,
                        const std::string& attributes = "") {
  E57TestField field;
  field.bits = 8 * sizeof(Float);
  field.element = '<' + name + " type=\"Float\"" + (sizeof(Float) == 4 ? " precision=\"single\"" : "") +
                  attributes + "/>";
  for (const Float value : values) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof value);
    field.raw.push_back(bits);
  }
  return field;
}

/// @param type the element's type and other attributes
inline E57TestField integerField(const std::string& name, std::int64_t min, std::int64_t max,
                                 const std::vector<std::int64_t>& values,
                                 const std::string& type = "Integer\"", bool tell_range = true) {
  E57TestField field;
  field.element = '<' + name + " type=\"" + type;
  if (tell_range)
    field.element += " minimum=\"" + std::to_string(min) + "\" maximum=\"" + std::to_string(max) + '"';
  field.element += "/>";
  while (field.bits < 64 &&
         (static_cast<std::uint64_t>(max) - static_cast<std::uint64_t>(min)) >> field.bits != 0) {
    ++field.bits;
  }
  for (const std::int64_t value : values) {
    field.raw.push_back(static_cast<std::uint64_t>(value) - static_cast<std::uint64_t>(min));
  }
  return field;
}

inline E57TestField scaledField(const std::string& name, std::int64_t min, std::int64_t max,
                                const std::string& scale, const std::vector<std::int64_t>& values) {
  return integerField(name, min, max, values, "ScaledInteger\" " + scale);
}

inline E57TestField stringField(const std::string& name, const std::vector<std::string>& values) {
  E57TestField field;
  field.element = '<' + name + " type=\"String\"/>";
  for (const std::string& value : values) field.bytes += static_cast<char>(value.size() << 1U) + value;
  return field;
}

class E57TestFile {
 public:
  /// @param seed of where streams are cut, and of the index and empty packets between the others
  explicit E57TestFile(unsigned seed = 1) : random_(seed) {}

  std::string xml_head = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  std::string namespaces = "xmlns=\"http://www.astm.org/COMMIT/E57/2010-e57-v1.0\"";
  std::size_t longest_part = 700;  ///< bytes of a stream in a packet

  std::string make(const std::vector<E57TestScan>& scans) {
    logical_.assign(48, '\0');
    std::string data3d;
    for (const E57TestScan& scan : scans) {
      const std::uint64_t offset = physical(logical_.size());
      writeSection(scan);
      data3d += "<vectorChild type=\"Structure\">" + scan.xml +
                "<points type=\"CompressedVector\" fileOffset=\"" +
                std::to_string(scan.records > 0 ? offset : 0) + "\" recordCount=\"" +
                std::to_string(scan.records) + "\"><prototype type=\"Structure\">";
      for (const E57TestField& field : scan.fields) data3d += field.element;
      data3d += "</prototype><codecs type=\"Vector\"/></points></vectorChild>";
    }
    return finish(xml_head + "<e57Root type=\"Structure\" " + namespaces +
                  "><versionMajor type=\"Integer\">1</versionMajor><versionMinor type=\"Integer\"/><data3D "
                  "type=\"Vector\">" +
                  data3d + "</data3D></e57Root>\n  ");
  }

  /// Any XML.
  std::string finish(const std::string& xml) {
    if (logical_.size() < 48) logical_.assign(48, '\0');
    const std::uint64_t xml_offset = physical(logical_.size());
    logical_ += xml;
    logical_.resize((logical_.size() + 1019) / 1020 * 1020, '\0');
    std::string header = "ASTM-E57";
    header += little<4>(1) + little<4>(0) + little<8>(logical_.size() / 1020 * 1024) + little<8>(xml_offset) +
              little<8>(xml.size()) + little<8>(1024);
    logical_.replace(0, 48, header);
    std::string file;
    for (std::size_t at = 0; at < logical_.size(); at += 1020) file += seal(logical_.substr(at, 1020));
    return file;
  }

  /// A page with its checksum.
  static std::string seal(const std::string& page) {
    std::uint32_t crc = 0xFFFFFFFFU;
    for (const char c : page) {
      crc ^= static_cast<unsigned char>(c);
      for (int i = 0; i < 8; ++i) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0x82F63B78U : 0U);
    }
    crc = ~crc;
    std::string sealed = page;
    for (int shift = 24; shift >= 0; shift -= 8)
      sealed += static_cast<char>(crc >> static_cast<unsigned>(shift));
    return sealed;
  }

 private:
  template <int N>
  static std::string little(std::uint64_t value) {
    std::string bytes;
    for (unsigned i = 0; i < N; ++i) bytes += static_cast<char>(value >> 8 * i);
    return bytes;
  }
  static std::uint64_t physical(std::uint64_t logical) { return logical / 1020 * 1024 + logical % 1020; }

  static std::string pack(const E57TestField& field) {
    std::string bytes = field.bytes;
    std::size_t bit = 0;
    for (const std::uint64_t raw : field.raw) {
      for (unsigned i = 0; i < field.bits; ++i, ++bit) {
        if (bit % 8 == 0) bytes += '\0';
        bytes.back() = static_cast<char>(bytes.back() | ((raw >> i & 1U) << bit % 8));
      }
    }
    return bytes;
  }

  std::size_t below(std::size_t end) { return random_() % end; }

  void writeSection(const E57TestScan& scan) {
    const std::size_t header = logical_.size();
    logical_.append(32, '\0');
    const std::size_t start = logical_.size();
    std::vector<std::string> streams;
    for (const E57TestField& field : scan.fields) streams.push_back(pack(field));
    bool more = !streams.empty();
    while (more) {
      if (below(4) == 0)
        writePacket(0, std::string(12 + 16, '\0'));  // an index without entries that are used
      if (below(4) == 0) writePacket(2, std::string(4 * below(3), '\0'));
      if (below(4) == 0) writePacket(1, std::string("\0\0\0\0", 4));  // a data packet without any
      std::string lengths, data;
      more = false;
      for (std::string& stream : streams) {
        const std::size_t part = std::min(stream.size(), below(3) == 0 ? 0 : below(longest_part));
        lengths += little<2>(part);
        data += stream.substr(0, part);
        stream.erase(0, part);
        more = more || !stream.empty();
      }
      writePacket(1, little<2>(streams.size()) + lengths + data);
    }
    logical_.replace(header, 32,
                     std::string("\1\0\0\0\0\0\0\0", 8) + little<8>(logical_.size() - header) +
                         little<8>(physical(start)) + little<8>(0));
  }

  void writePacket(unsigned type, std::string rest) {
    rest.resize((rest.size() + 3) / 4 * 4, '\0');
    logical_ += static_cast<char>(type);
    logical_ += '\0';
    logical_ += little<2>(rest.size() + 4 - 1) + rest;
  }

  std::mt19937 random_;
  std::string logical_;
};

}  // namespace hokuyo_sick_drivers
