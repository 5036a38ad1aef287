// SPDX-License-Identifier: BSD-3-Clause
//
// Options as YAML and as a table, and YAML as options.
#include <yaml-cpp/yaml.h>

#include <cctype>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "mapping_common/options.h"

namespace mapping_common {
namespace {

constexpr std::size_t kWidth = 120, kCommentColumn = 29;

// A value that PyYAML and yaml-cpp read as one of its type.
std::string toYamlValue(const OptionValue& value) {
  const auto* number = std::get_if<double>(&value);
  const auto* text = std::get_if<std::string>(&value);
  std::string yaml = text != nullptr ? *text : toText(value);
  if (number != nullptr) {
    if (std::isinf(*number)) return *number > 0.0 ? ".inf" : "-.inf";
    if (yaml.find('.') == std::string::npos) yaml.insert(std::min(yaml.find('e'), yaml.size()), ".0");
  } else if (text != nullptr) {
    bool flag = false;
    double ignored = 0.0;
    bool plain = !yaml.empty() && !YAML::convert<bool>::decode(YAML::Node(yaml), flag) &&
                 !YAML::convert<double>::decode(YAML::Node(yaml), ignored);
    for (const char c : yaml)
      plain = plain && (std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '/');
    if (!plain) yaml = '"' + yaml + '"';
  }
  return yaml;
}

// Text in lines of comments that begin at a column, after what is there already.
std::string withComment(std::string line, const std::string& text) {
  if (text.empty()) return line + '\n';
  line.resize(std::max(line.size() + 1, kCommentColumn), ' ');
  const std::string next(kCommentColumn, ' ');
  std::string all;
  line += '#';
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (line.size() + 1 + word.size() > kWidth) {
      all += line + '\n';
      line = next + "#  ";
    }
    line += ' ' + word;
  }
  return all + line + '\n';
}

std::vector<std::string> pathOf(const std::string& name) {
  std::vector<std::string> path;
  std::istringstream parts(name);
  for (std::string part; std::getline(parts, part, '/');) path.push_back(part);
  return path;
}

void flatten(const std::string& prefix, const YAML::Node& node, OptionValues& values) {
  for (const auto& member : node) {
    const std::string name = prefix + member.first.as<std::string>();
    const YAML::Node& value = member.second;
    bool flag = false;
    int whole = 0;
    double number = 0.0;
    if (value.IsMap()) {
      flatten(name + '/', value, values);
    } else if (!value.IsScalar()) {
      values[name] = std::monostate();
    } else if (value.Tag() == "!") {  // quoted
      values[name] = value.as<std::string>();
    } else if (YAML::convert<bool>::decode(value, flag)) {
      values[name] = flag;
    } else if (YAML::convert<int>::decode(value, whole)) {
      values[name] = whole;
    } else if (YAML::convert<double>::decode(value, number)) {
      values[name] = number;
    } else {
      values[name] = value.as<std::string>();
    }
  }
}

}  // namespace

std::string toYaml(const OptionList& options, const std::string& title) {
  std::string yaml = "# SPDX-License-Identifier: BSD-3-Clause\n#\n", line = "#";
  std::istringstream words(title);
  for (std::string word; words >> word; line += ' ' + word) {
    if (line.size() + 1 + word.size() <= kWidth) continue;
    yaml += line + '\n';
    line = "#";
  }
  yaml += line + '\n';
  std::string section;
  std::vector<std::string> group;  // that is open
  for (const auto& [option, title_of_section] : options) {
    if (title_of_section != section) {
      section = title_of_section;
      yaml += "\n# " + std::string(kWidth - 3 - section.size(), '-') + ' ' + section + '\n';
    }
    std::vector<std::string> path = pathOf(option.name());
    const std::string key = path.back();
    path.pop_back();
    if (path != group && yaml.compare(yaml.size() - 2, 2, "\n\n") != 0 &&
        yaml[yaml.rfind('\n', yaml.size() - 2) + 1] != '#')
      yaml += '\n';
    std::string opened;
    for (std::size_t i = 0; i < path.size(); ++i) {
      opened += path[i] + '/';
      if (i < group.size() && path[i] == group[i]) continue;
      group.resize(i);
      group.push_back(path[i]);
      const auto text = options.groups().find(opened);
      yaml += withComment(std::string(2 * i, ' ') + path[i] + ':',
                          text == options.groups().end() ? "" : text->second);
    }
    group.resize(path.size());
    yaml += withComment(std::string(2 * path.size(), ' ') + key + ": " + toYamlValue(option.get()),
                        (option.isDynamic() ? "(dynamic) " : "") + option.help());
  }
  return yaml;
}

std::string toMarkdown(const OptionList& options) {
  const auto cell = [](std::string text) {
    for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2)
      text.insert(at, 1, '\\');
    return text + " | ";
  };
  std::string table, section = "-";
  for (const auto& [option, title] : options) {
    if (title != section) {
      section = title;
      if (!title.empty()) table += (table.empty() ? "### " : "\n### ") + title + "\n\n";
      table += "| Parameter | Default | |\n| --- | --- | --- |\n";
    }
    table += "| `" + option.name() + "` | " + cell('`' + toYamlValue(option.get()) + '`') +
             cell((option.isDynamic() ? "(dynamic) " : "") + option.help());
    table.back() = '\n';
  }
  return table;
}

OptionValues loadYaml(const std::string& path) {
  try {
    OptionValues values;
    const YAML::Node node = YAML::LoadFile(path);
    if (!node.IsMap() && !node.IsNull())
      throw std::runtime_error(path + " was not loaded: it has to be a map");
    flatten("", node, values);
    return values;
  } catch (const YAML::Exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

}  // namespace mapping_common
