// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/reconfiguration.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mapping_common {
namespace {

using dynamic_reconfigure::Config;
using Type = Option::Type;

std::string lastPartOf(const std::string& name) {
  return name.substr(name.rfind('/') + 1);  // npos + 1 is 0
}

std::vector<Option> dynamicOnes(const OptionList& options) {
  std::vector<Option> dynamic;
  for (const auto& [option, section] : options)
    if (option.isDynamic()) dynamic.push_back(option);
  return dynamic;
}

void append(Config& message, const std::string& name, const OptionValue& value) {
  const auto add = [&name](auto& list, const auto& content) {
    list.emplace_back();
    list.back().name = name;
    list.back().value = content;
  };
  if (const auto* flag = std::get_if<bool>(&value)) add(message.bools, *flag);
  if (const auto* whole = std::get_if<int>(&value)) add(message.ints, *whole);
  if (const auto* number = std::get_if<double>(&value)) add(message.doubles, *number);
  if (const auto* text = std::get_if<std::string>(&value)) add(message.strs, *text);
}

// There is one group of all, as generated configurations have it.
void appendGroup(Config& message) {
  message.groups.emplace_back();
  message.groups.back().name = "Default";
  message.groups.back().state = true;
}

OptionValue bound(Type type, double number) {
  constexpr double kInt = std::numeric_limits<int>::max();
  switch (type) {
    case Type::kBool:
      return number > 0.0;
    case Type::kInt:
      return static_cast<int>(std::clamp(number, -kInt, kInt));
    case Type::kDouble:
      return number;
    case Type::kString:
      break;
  }
  return std::string();
}

// A Python literal, which rqt_reconfigure evaluates.
std::string enumOf(const Option& option) {
  if (option.choices().empty()) return "";
  const auto quoted = [](const std::string& text) {
    std::string literal = "'";
    for (const char c : text) literal += c == '\'' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    return literal + "'";
  };
  std::string all;
  for (const auto& [name, text] : option.choices()) {
    all += (all.empty() ? "" : ", ") + std::string("{'name': ") + quoted(name) +
           ", 'type': 'str', 'value': " + quoted(name) + ", 'description': " + quoted(text) + "}";
  }
  return "{'enum': [" + all + "], 'enum_description': " + quoted(option.text()) + "}";
}

}  // namespace

void toMessage(const OptionList& options, Config& message) {
  for (const Option& option : dynamicOnes(options)) append(message, lastPartOf(option.name()), option.get());
  appendGroup(message);
}

void fromMessage(const Config& message, OptionList options) {
  OptionValues values;
  const auto take = [&](const auto& list, auto type) {
    for (const auto& parameter : list) values[parameter.name] = static_cast<decltype(type)>(parameter.value);
  };
  take(message.bools, bool());
  take(message.ints, int());
  take(message.doubles, double());
  take(message.strs, std::string());
  OptionValues known;
  for (const Option& option : dynamicOnes(options)) {
    const auto value = values.find(lastPartOf(option.name()));
    if (value != values.end()) known[option.name()] = value->second;
  }
  options.assign(known);
}

dynamic_reconfigure::ConfigDescription describe(const OptionList& options) {
  static const char* const kTypes[] = {"bool", "int", "double", "str"};
  dynamic_reconfigure::ConfigDescription description;
  description.groups.emplace_back();
  description.groups[0].name = "Default";
  for (const Option& option : dynamicOnes(options)) {
    const std::string name = lastPartOf(option.name());
    dynamic_reconfigure::ParamDescription parameter;
    parameter.name = name;
    parameter.type = kTypes[static_cast<int>(option.type())];
    parameter.description = option.unit().empty() ? option.text() : option.unit() + ": " + option.text();
    parameter.edit_method = enumOf(option);
    description.groups[0].parameters.push_back(parameter);
    const bool flag = option.type() == Type::kBool;
    append(description.min, name, bound(option.type(), flag ? 0.0 : option.min()));
    append(description.max, name, bound(option.type(), flag ? 1.0 : option.max()));
    append(description.dflt, name, option.get());
  }
  for (Config* config : {&description.min, &description.max, &description.dflt}) appendGroup(*config);
  return description;
}

void toServer(const OptionList& options, const ros::NodeHandle& node) {
  for (const Option& option : dynamicOnes(options)) {
    std::visit(
        [&](const auto& value) {
          if constexpr (!std::is_same_v<std::decay_t<decltype(value)>, std::monostate>)
            node.setParam(option.name(), value);
        },
        option.get());
  }
}

}  // namespace mapping_common
