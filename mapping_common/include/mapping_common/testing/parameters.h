// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/options.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>

namespace mapping_common {

/// A file of the repository that the code generates: says where it differs, or, with MAPPING_REGENERATE set
/// in the environment (scripts/parameters does), writes it.
inline void expectGenerated(const std::string& path, const std::string& text) {
  const std::string file = std::filesystem::exists(path) ? readFile(path) : "";
  if (file == text) return;
  if (std::getenv("MAPPING_REGENERATE") != nullptr) {
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    return writeFile(std::filesystem::weakly_canonical(path).string(),
                     [&text](std::ostream& out) { out << text; });
  }
  std::istringstream is(file), should(text);
  std::string a, b;
  int line = 0;
  do {
    ++line;
    if (!std::getline(is, a)) a = "(its end)";
    if (!std::getline(should, b)) b = "(its end)";
  } while (a == b);
  ADD_FAILURE() << path << " isn't what the code generates, scripts/parameters writes it. Line " << line
                << " is\n  " << a << "\nand should be\n  " << b;
}

/// The YAML file and the table of a nodelet's parameters.
template <class Parameters>
void expectDocumented(const std::string& nodelet, const std::string& yaml, const std::string& table,
                      const std::string& more = "") {
  Parameters parameters;
  const std::string text =
      "Parameters of " + nodelet +
      ", all of them, with their defaults. Those marked (dynamic) can be changed while it "
      "runs, with rqt_reconfigure. A misspelt parameter is an error." +
      (more.empty() ? "" : ' ' + more);
  expectGenerated(yaml, toYaml(optionsOf(parameters), text + " Written by scripts/parameters: don't edit."));
  expectGenerated(table, "# Parameters\n\n" + text + "\n\n" + toMarkdown(optionsOf(parameters)));
}

/// Another value that an option's type and bounds allow; the same where there is none.
inline OptionValue anotherValue(const Option& option) {
  const OptionValue value = option.get();
  const auto allows = [&option](double number) { return number >= option.min() && number <= option.max(); };
  if (const auto* flag = std::get_if<bool>(&value)) return !*flag;
  if (const auto* whole = std::get_if<int>(&value)) return allows(*whole + 1) ? *whole + 1 : *whole - 1;
  if (const auto* number = std::get_if<double>(&value)) {
    for (const double other : {*number + 1e-3, *number - 1e-3, 1.0})
      if (allows(other) && std::isfinite(other)) return other;
  }
  if (option.choices().empty()) return std::string("another");
  for (const auto& [name, text] : option.choices())
    if (OptionValue(name) != value) return name;
  return value;
}

/// Defaults are valid, each option has a value of its own and a text, and those that are dynamic have
/// different last parts of their names.
template <class Parameters>
void expectSound() {
  Parameters defaults;
  EXPECT_NO_THROW(validate(defaults));
  std::set<std::string> dynamic;
  for (const auto& [option, section] : optionsOf(defaults)) {
    EXPECT_NE("", option.unit() + option.text() + (option.choices().empty() ? "" : "choices"))
        << option.name();
    if (option.isDynamic())
      EXPECT_TRUE(dynamic.insert(option.name().substr(option.name().rfind('/') + 1)).second) << option.name();
    Parameters changed;
    OptionList list = optionsOf(changed);
    const OptionValue value = anotherValue(option);
    list.find(option.name())->set(value);
    for (const auto& [other, s] : optionsOf(defaults))
      EXPECT_EQ(other.name() == option.name() ? value : other.get(), list.find(other.name())->get())
          << option.name() << " changes " << other.name();
  }
}

/// The message that a YAML text is refused with, "" where it isn't.
template <class Parameters>
std::string rejection(const std::string& path) {
  Parameters parameters;
  try {
    assign(parameters, loadYaml(path), {}, "~");
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

}  // namespace mapping_common
