// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/parameters.h"

#include <algorithm>
#include <numeric>
#include <type_traits>
#include <utility>

namespace mapping_common {
namespace {

using XmlRpc::XmlRpcValue;

template <class T>
constexpr const char* typeName() {
  if constexpr (std::is_same_v<T, bool>) return "true or false";
  if constexpr (std::is_same_v<T, int>) return "an integer";
  if constexpr (std::is_same_v<T, double>) return "a number";
  return "a string";
}

template <class T>
bool readAs(XmlRpcValue& from, T& to) {
  constexpr auto type = std::is_same_v<T, bool>     ? XmlRpcValue::TypeBoolean
                        : std::is_same_v<T, int>    ? XmlRpcValue::TypeInt
                        : std::is_same_v<T, double> ? XmlRpcValue::TypeDouble
                                                    : XmlRpcValue::TypeString;
  if constexpr (std::is_same_v<T, double>) {
    if (from.getType() == XmlRpcValue::TypeInt) {
      to = static_cast<int&>(from);
      return true;
    }
  }
  if constexpr (std::is_same_v<T, std::string>) {
    if (from.getType() == XmlRpcValue::TypeInt) {
      to = std::to_string(static_cast<int&>(from));
      return true;
    }
  }
  if (from.getType() != type) return false;
  to = static_cast<T&>(from);
  return true;
}

template <class Names>
std::string join(const Names& names, const std::string& before) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? before : ", " + before) + name;
  return text;
}

// Levenshtein's: letters to insert, remove or replace.
std::size_t editDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);  // distances from the first i letters of a to those of b
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, diagonal + 1, row[j] + 1});
    }
  }
  return row.back();
}

}  // namespace

Parameters::Parameters(XmlRpcValue all) {
  if (all.getType() == XmlRpcValue::TypeStruct) flatten("", all);
}

void Parameters::flatten(const std::string& prefix, XmlRpcValue& value) {
  for (auto& [name, member] : value) {
    if (member.getType() == XmlRpcValue::TypeStruct) {
      flatten(prefix + name + '/', member);
    } else {
      values_[prefix + name] = member;
    }
  }
}

OptionValues Parameters::values() const {
  OptionValues values;
  for (auto [name, value] : values_) {
    OptionValue& to = values[name];
    if (value.getType() == XmlRpcValue::TypeBoolean) {
      to = static_cast<bool&>(value);
    } else if (value.getType() == XmlRpcValue::TypeInt) {
      to = static_cast<int&>(value);
    } else if (value.getType() == XmlRpcValue::TypeDouble) {
      to = static_cast<double&>(value);
    } else if (value.getType() == XmlRpcValue::TypeString) {
      to = static_cast<std::string&>(value);
    } else {
      to = std::monostate();
    }
  }
  return values;
}

template <class T>
T Parameters::get(const std::string& name, const T& fallback) {
  names_.insert(name);
  const auto found = values_.find(name);
  if (found == values_.end()) return fallback;
  T value;
  if (!readAs(found->second, value)) {
    rejectParameter(name, found->second, std::string("expected is ") + typeName<T>());
  }
  return value;
}

template <class T>
T Parameters::get(const std::string& name, const T& fallback, const T& min, const T& max) {
  const T value = get(name, fallback);
  if (!(value >= min && value <= max)) {
    std::ostringstream allowed;
    allowed << "allowed is " << min << " to " << max;
    rejectParameter(name, value, allowed.str());
  }
  return value;
}

std::string Parameters::choice(const std::string& name, const std::string& fallback,
                               const std::vector<std::string>& allowed) {
  const std::string value = get(name, fallback);
  if (std::find(allowed.begin(), allowed.end(), value) == allowed.end()) {
    rejectParameter(name, '\'' + value + '\'', "allowed is " + join(allowed, ""));
  }
  return value;
}

template bool Parameters::get(const std::string&, const bool&);
template int Parameters::get(const std::string&, const int&);
template double Parameters::get(const std::string&, const double&);
template std::string Parameters::get(const std::string&, const std::string&);
template int Parameters::get(const std::string&, const int&, const int&, const int&);
template double Parameters::get(const std::string&, const double&, const double&, const double&);

void Parameters::rejectUnknown(const std::vector<std::string>& except) const {
  const auto expected = [&](const std::string& name) {
    return names_.count(name) > 0 || std::any_of(except.begin(), except.end(), [&](const std::string& start) {
             return name.compare(0, start.size(), start) == 0;
           });
  };
  std::vector<std::string> unknown;
  for (const auto& [name, value] : values_) {
    if (expected(name)) continue;
    unknown.push_back(name);
    const auto closest = std::min_element(names_.begin(), names_.end(), [&](const auto& a, const auto& b) {
      return editDistance(name, a) < editDistance(name, b);
    });
    if (closest != names_.end() && 3 * editDistance(name, *closest) <= name.size()) {
      unknown.back() += " (~" + *closest + "?)";
    }
  }
  if (!unknown.empty()) {
    throw std::invalid_argument("unknown: " + join(unknown, "~") + "; the parameters are " +
                                join(names_, "~"));
  }
}

}  // namespace mapping_common
