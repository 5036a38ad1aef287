// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <iomanip>
#include <locale>
#include <sstream>
#include <string>
#include <vector>

namespace rosbag_tests {

/// A number as JSON has it: what isn't finite becomes null.
inline std::string jsonNumber(double value) {
  if (!std::isfinite(value)) return "null";
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << std::setprecision(12) << value;
  return out.str();
}

inline std::string jsonString(const std::string& text) {
  std::ostringstream out;
  out << '"';
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20)
      out << "\\u" << std::hex << std::setw(4) << std::setfill('0') << static_cast<int>(c) << std::dec;
    else if (c == '"' || c == '\\')
      out << '\\' << c;
    else
      out << c;
  }
  out << '"';
  return out.str();
}

/// [a, b, ...] of values that are JSON already.
inline std::string jsonArray(const std::vector<std::string>& values) {
  std::string out = "[";
  for (std::size_t i = 0; i < values.size(); ++i) out += (i ? ", " : "") + values[i];
  return out + "]";
}

/// An object, key by key.
class JsonObject {
 public:
  JsonObject& add(const std::string& key, double value) { return raw(key, jsonNumber(value)); }
  JsonObject& add(const std::string& key, const std::string& value) { return raw(key, jsonString(value)); }
  /// A value that is JSON already.
  JsonObject& raw(const std::string& key, const std::string& json) {
    body_ += (body_.empty() ? "" : ",\n") + jsonString(key) + ": " + json;
    return *this;
  }
  std::string str() const { return "{" + body_ + "}"; }

 private:
  std::string body_;
};

}  // namespace rosbag_tests
