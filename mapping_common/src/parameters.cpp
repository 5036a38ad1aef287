// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/parameters.h"

#include <algorithm>

namespace mapping_common {

using XmlRpc::XmlRpcValue;

namespace {

// A list of strings as one, with "; " between them.
OptionValue joined(XmlRpcValue& list) {
  std::string text;
  for (int i = 0; i < list.size(); ++i) {
    if (list[i].getType() != XmlRpcValue::TypeString) return std::monostate();
    text += (i > 0 ? "; " : "") + static_cast<std::string&>(list[i]);
  }
  return text;
}

}  // namespace

std::vector<std::string> listOf(const std::string& text) {
  std::vector<std::string> words;
  for (std::size_t at = 0; (at = text.find_first_not_of(" \t\n,;", at)) != std::string::npos;) {
    const std::size_t end = std::min(text.find_first_of(" \t\n,;", at), text.size());
    const std::string word = text.substr(at, end - at);
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
    at = end;
  }
  return words;
}

Parameters::Parameters(XmlRpcValue all) {
  if (all.getType() == XmlRpcValue::TypeStruct) flatten("", all);
}

void Parameters::flatten(const std::string& prefix, XmlRpcValue& value) {
  for (auto& [name, member] : value) {
    OptionValue& to = values_[prefix + name];
    switch (member.getType()) {
      case XmlRpcValue::TypeStruct:
        values_.erase(prefix + name);
        flatten(prefix + name + '/', member);
        break;
      case XmlRpcValue::TypeBoolean:
        to = static_cast<bool&>(member);
        break;
      case XmlRpcValue::TypeInt:
        to = static_cast<int&>(member);
        break;
      case XmlRpcValue::TypeDouble:
        to = static_cast<double&>(member);
        break;
      case XmlRpcValue::TypeString:
        to = static_cast<std::string&>(member);
        break;
      case XmlRpcValue::TypeArray:
        to = joined(member);
        break;
      default:
        to = std::monostate();
    }
  }
}

}  // namespace mapping_common
