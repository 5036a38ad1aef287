// SPDX-License-Identifier: BSD-3-Clause
//
// Options are structs with a member function describe(OptionList&) that says of each member what it is
// called, what it may be and what it is for. All that handles options follows from it: checks, parameters,
// dynamic reconfiguration, command lines, files, the YAML file that ships and the table in the documentation.
#pragma once

#include <array>
#include <cstddef>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace mapping_common {

/// A value as users write it; that of an enum is its name. std::monostate: anything else, which no option
/// takes.
using OptionValue = std::variant<bool, int, double, std::string, std::monostate>;
/// By the options' names.
using OptionValues = std::map<std::string, OptionValue>;

/// As users write it, for messages and YAML: true, 3, 0.5, 'text'.
std::string toText(const OptionValue& value);

/// What a value is called. Beside each enum stands a function choicesOf(Enum) that returns all of them; of
/// functions and classes that do the same in different ways there is a table.
template <class T>
struct Choice {
  const char* name;
  T value;
  const char* text = "";  ///< what it does
};
template <class T>
using Table = std::vector<Choice<T>>;

template <class Enum, std::size_t N>
constexpr std::array<Choice<Enum>, N> choices(const Choice<Enum> (&all)[N]) {
  std::array<Choice<Enum>, N> copy{};
  for (std::size_t i = 0; i < N; ++i) copy[i] = all[i];
  return copy;
}

template <class Enum>
std::string nameOf(Enum value) {
  for (const auto& choice : choicesOf(value))
    if (choice.value == value) return choice.name;
  return "";
}

/// @throws std::invalid_argument that names those there are
template <class Choices>
auto valueOf(const Choices& choices, const std::string& name) {
  std::string names;
  for (const auto& choice : choices) {
    if (choice.name == name) return choice.value;
    names += (names.empty() ? "" : " | ") + std::string(choice.name);
  }
  throw std::invalid_argument('\'' + name + "' is none of " + names);
}
template <class Enum>
Enum valueOf(const std::string& name) {
  return valueOf(choicesOf(Enum()), name);
}
template <class T>
std::vector<std::string> namesOf(const Table<T>& table) {
  std::vector<std::string> names;
  for (const Choice<T>& row : table) names.emplace_back(row.name);
  return names;
}

/// One option: where its value is, and what is said of it.
class Option {
 public:
  enum class Type { kBool, kInt, kDouble, kString };

  template <class T>
  Option(std::string name, T& field, std::string unit, std::string text);

  /// What a number may be. Without any of these: all but NaN.
  Option& within(double min, double max) { return atLeast(min).atMost(max); }
  Option& atLeast(double min) { return min_ = min, above_ = false, *this; }
  Option& atMost(double max) { return max_ = max, below_ = false, *this; }
  Option& above(double min) { return min_ = min, above_ = true, *this; }
  Option& below(double max) { return max_ = max, below_ = true, *this; }
  /// Users write -1 for infinity.
  Option& orUnlimited() { return unlimited_ = true, *this; }
  /// Users write degrees for radians.
  Option& inDegrees() { return scale_ = 180.0 / 3.14159265358979323846, *this; }
  /// What a string may be. An enum's names are known.
  Option& oneOf(const std::vector<std::string>& names);
  template <class T>
  Option& oneOf(const Table<T>& table) {
    for (const Choice<T>& row : table) choices_.emplace_back(row.name, row.text);
    return *this;
  }
  Option& notEmpty() { return not_empty_ = true, *this; }
  /// May change while the program runs.
  Option& dynamic() { return dynamic_ = true, *this; }

  const std::string& name() const { return name_; }
  const std::string& unit() const { return unit_; }
  const std::string& text() const { return text_; }
  Type type() const { return type_; }
  bool isDynamic() const { return dynamic_; }
  /// Of a number; infinite where there is none.
  double min() const { return unlimited_ ? -1.0 : min_; }
  double max() const { return max_; }
  /// Names and what they do; empty: any.
  const std::vector<std::pair<std::string, std::string>>& choices() const { return choices_; }
  /// e.g. "0 to 1 m", "above 0", "none | huber"; "" where all of the type are.
  std::string allowed() const;

  /// What it does, with what its values do.
  std::string meaning() const;
  /// In one line: unit or what is allowed, meaning.
  std::string help() const;
  /// The same under another name.
  Option named(const std::string& name) const;

  /// As users write it.
  OptionValue get() const;
  /// The same as a word, see parse.
  std::string word() const;
  /// An integer will do for a number, and for a string, as roslaunch takes what looks like one for it.
  /// @throws std::invalid_argument that names the option, the value and what is expected
  void set(const OptionValue& value);
  /// The same from a word, as command lines and files have it.
  void parse(const std::string& word);
  /// @throws std::invalid_argument that names the option, its value and what is allowed
  void check() const;
  [[noreturn]] void reject(const std::string& value, const std::string& expected) const;

 private:
  std::string name_, unit_, text_;
  Type type_ = Type::kString;
  double min_ = -std::numeric_limits<double>::infinity(), max_ = std::numeric_limits<double>::infinity();
  double scale_ = 1.0;  // what users write for 1
  bool above_ = false, below_ = false, unlimited_ = false, not_empty_ = false, dynamic_ = false;
  std::vector<std::pair<std::string, std::string>> choices_;
  OptionValue scaled() const;

  std::function<OptionValue()> get_;
  std::function<void(const OptionValue&)> set_;  // of a value of the right type
};

/// The options of a struct that outlives it, in order.
class OptionList {
 public:
  /// @param prefix of names in messages, e.g. "~" for parameters
  explicit OptionList(std::string prefix = "") : prefix_(std::move(prefix)) {}

  /// @param field bool, a number, std::string, an enum, or std::optional of an enum: "" is none
  /// @param unit e.g. "m"; "" for none
  template <class T>
  Option& operator()(const std::string& name, T& field, const std::string& unit, const std::string& text);
  /// What follows is about this.
  void section(const std::string& title) { section_ = title; }
  /// A struct's options, with `name/` before their names.
  template <class Options>
  void group(const std::string& name, const std::string& text, Options& options);
  /// A condition on several options, after they have been described.
  /// @param allowed of the option of that name, in words
  void require(bool holds, const std::string& name, const std::string& allowed);

  struct Entry {
    Option option;
    std::string section;
  };
  auto begin() const { return entries_.begin(); }
  auto end() const { return entries_.end(); }
  std::size_t size() const { return entries_.size(); }
  const std::map<std::string, std::string>& groups() const { return groups_; }
  /// @return nullptr where there is none of that name
  Option* find(const std::string& name);

  /// @param others how the names start that are somebody else's, e.g. "debug_image/"
  /// @throws std::invalid_argument that names the option, its value and what is expected; or those there are
  /// none of, what may be meant, and those there are
  void assign(const OptionValues& values, const std::vector<std::string>& others = {});
  /// @throws std::invalid_argument that names the first option that won't do, its value and what is allowed
  void check() const;

 private:
  std::string prefix_, group_, section_, failed_;
  std::map<std::string, std::string> groups_;
  std::deque<Entry> entries_;
};

/// @param prefix of names in messages
template <class Options>
OptionList optionsOf(Options& options, const std::string& prefix = "") {
  OptionList list(prefix);
  options.describe(list);
  return list;
}

/// @return the same
/// @throws std::invalid_argument that names the first option that won't do, its value and what is allowed
template <class Options>
const Options& validate(const Options& options, const std::string& prefix = "") {
  Options copy = options;
  optionsOf(copy, prefix).check();
  return options;
}

/// Sets and checks what is named. Where it throws nothing has changed.
/// @throws std::invalid_argument as OptionList::assign, OptionList::check
template <class Options>
void assign(Options& options, const OptionValues& values, const std::vector<std::string>& others = {},
            const std::string& prefix = "") {
  Options changed = options;
  optionsOf(changed, prefix).assign(values, others);
  validate(changed, prefix);
  options = std::move(changed);
}

/// Those that may change while the program runs.
template <class Options>
void copyDynamic(Options from, Options& to) {
  OptionList list = optionsOf(to);
  for (const auto& [option, section] : optionsOf(from))
    if (option.isDynamic()) list.find(option.name())->set(option.get());
}

/// Whether all that is described is alike.
template <class Options>
bool same(Options a, Options b) {
  OptionList list = optionsOf(b);
  for (const auto& [option, section] : optionsOf(a))
    if (option.get() != list.find(option.name())->get()) return false;
  return true;
}

/// The YAML file with all options, their values and what they are for.
std::string toYaml(const OptionList& options, const std::string& title);
/// The same as a table.
std::string toMarkdown(const OptionList& options);
/// Numbers, booleans and strings of a YAML file, as rosparam would load them; a member's name is that of its
/// map, a slash and its own.
/// @throws std::runtime_error that names the file and the line
OptionValues loadYaml(const std::string& path);

// -----------------------------------------------------------------------------------------------------------

namespace detail {
template <class T>
struct IsOptional : std::false_type {};
template <class T>
struct IsOptional<std::optional<T>> : std::true_type {};
}  // namespace detail

template <class T>
Option::Option(std::string name, T& field, std::string unit, std::string text)
    : name_(std::move(name)), unit_(std::move(unit)), text_(std::move(text)) {
  if constexpr (std::is_enum_v<T>) {
    for (const auto& choice : choicesOf(T())) choices_.emplace_back(choice.name, choice.text);
    get_ = [&field] { return nameOf(field); };
    set_ = [&field](const OptionValue& value) {
      for (const auto& choice : choicesOf(T()))
        if (choice.name == std::get<std::string>(value)) field = choice.value;
    };
  } else if constexpr (detail::IsOptional<T>::value) {
    using Enum = typename T::value_type;
    for (const auto& choice : choicesOf(Enum())) choices_.emplace_back(choice.name, choice.text);
    choices_.emplace_back("", "");
    get_ = [&field] { return field ? nameOf(*field) : std::string(); };
    set_ = [&field](const OptionValue& value) {
      field.reset();
      for (const auto& choice : choicesOf(Enum()))
        if (choice.name == std::get<std::string>(value)) field = choice.value;
    };
  } else {
    using Value = std::conditional_t<std::is_same_v<T, bool> || std::is_same_v<T, std::string>, T,
                                     std::conditional_t<std::is_floating_point_v<T>, double,
                                                        std::enable_if_t<!std::is_pointer_v<T>, int>>>;
    type_ = std::is_same_v<Value, bool>     ? Type::kBool
            : std::is_same_v<Value, int>    ? Type::kInt
            : std::is_same_v<Value, double> ? Type::kDouble
                                            : Type::kString;
    get_ = [&field] { return static_cast<Value>(field); };
    set_ = [&field](const OptionValue& value) { field = static_cast<T>(std::get<Value>(value)); };
  }
}

template <class T>
Option& OptionList::operator()(const std::string& name, T& field, const std::string& unit,
                               const std::string& text) {
  entries_.push_back({Option(group_ + name, field, unit, text), section_});
  return entries_.back().option;
}

template <class Options>
void OptionList::group(const std::string& name, const std::string& text, Options& options) {
  const std::string outside = group_;
  group_ += name + '/';
  groups_[group_] = text;
  options.describe(*this);
  group_ = outside;
}

}  // namespace mapping_common
