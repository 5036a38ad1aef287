// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/options.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numeric>
#include <stdexcept>

namespace mapping_common {
namespace {

template <class Names>
std::string join(const Names& names, const std::string& separator) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : separator) + name;
  return text;
}

// The fewest digits that are read as the same number, e.g. "0.1", "1e-05".
std::string digits(double value) {
  char text[32];
  if (std::trunc(value) == value && std::abs(value) < 1e15)
    return std::to_string(static_cast<long long>(value));
  for (int precision = 6; precision <= 17; ++precision) {
    std::snprintf(text, sizeof(text), "%.*g", precision, value);
    if (std::strtod(text, nullptr) == value) break;
  }
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

std::string toText(const OptionValue& value) {
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto* whole = std::get_if<int>(&value)) return std::to_string(*whole);
  if (const auto* number = std::get_if<double>(&value)) return digits(*number);
  if (const auto* text = std::get_if<std::string>(&value)) return '\'' + *text + '\'';
  return "a list";
}

Option& Option::oneOf(const std::vector<std::string>& names) {
  for (const std::string& name : names) choices_.emplace_back(name, "");
  return *this;
}

std::string Option::allowed() const {
  if (type_ == Type::kBool) return "";
  if (type_ == Type::kString) {
    std::vector<std::string> names;
    for (const auto& [name, text] : choices_) names.push_back(name.empty() ? "''" : name);
    return join(names, " | ");
  }
  const std::string unit = unit_.empty() ? "" : ' ' + unit_;
  std::string text;
  if (std::isfinite(min_) && std::isfinite(max_)) {
    text = (above_ ? "above " : "") + digits(min_) + " to " + (below_ ? "below " : "") + digits(max_) + unit;
  } else if (std::isfinite(min_)) {
    text = above_ ? "more than " + digits(min_) + unit : digits(min_) + unit + " or more";
  } else if (std::isfinite(max_)) {
    text = below_ ? "less than " + digits(max_) + unit : digits(max_) + unit + " or less";
  }
  return unlimited_ ? text + ", or -1: no limit" : text;
}

std::string Option::meaning() const {
  std::string text = text_, separator = text.empty() ? "" : ". ";
  for (const auto& [name, what] : choices_) {
    if (what.empty()) continue;
    text += separator + name + ": " + what;
    separator = "; ";
  }
  return text;
}

std::string Option::help() const {
  bool told = !choices_.empty();  // by the meaning
  for (const auto& [name, what] : choices_) told = told && !what.empty();
  const std::string may_be = told ? "" : allowed().empty() ? unit_ : allowed(), text = meaning();
  return may_be + (may_be.empty() || text.empty() ? "" : ": ") + text;
}

Option Option::named(const std::string& name) const {
  Option copy = *this;
  copy.name_ = name;
  return copy;
}

std::string Option::word() const {
  const OptionValue value = get();
  const auto* text = std::get_if<std::string>(&value);
  return text != nullptr ? *text : toText(value);
}

OptionValue Option::scaled() const {
  OptionValue value = get_();
  if (scale_ == 1.0) return value;
  return std::round(1e9 * scale_ * std::get<double>(value)) / 1e9;  // 85, not 85.00000000000001
}

OptionValue Option::get() const {
  const OptionValue value = scaled();
  return unlimited_ && value == OptionValue(std::numeric_limits<double>::infinity()) ? OptionValue(-1.0)
                                                                                     : value;
}

void Option::set(const OptionValue& value) {
  static const char* const kTypes[] = {"true or false", "an integer", "a number", "a string"};
  const auto* whole = std::get_if<int>(&value);
  if (type_ == Type::kDouble && whole != nullptr) return set(static_cast<double>(*whole));
  if (type_ == Type::kString && whole != nullptr) return set(std::to_string(*whole));
  if (value.index() != static_cast<std::size_t>(type_))
    reject(toText(value), std::string("expected is ") + kTypes[static_cast<int>(type_)]);
  if (unlimited_ && value == OptionValue(-1.0)) return set_(std::numeric_limits<double>::infinity());
  const auto isValue = [&](const auto& choice) { return choice.first == std::get<std::string>(value); };
  if (!choices_.empty() && std::none_of(choices_.begin(), choices_.end(), isValue))
    reject(toText(value), "allowed is " + allowed());
  scale_ == 1.0 ? set_(value) : set_(std::get<double>(value) / scale_);
}

void Option::parse(const std::string& word) {
  char* end = nullptr;
  const double number = std::strtod(word.c_str(), &end);
  const bool is_number = !word.empty() && *end == '\0';
  if (type_ == Type::kBool && (word == "true" || word == "false")) return set(word == "true");
  if (type_ == Type::kDouble && is_number) return set(number);
  if (type_ == Type::kInt && is_number && std::abs(number) < 2147483648.0 && std::trunc(number) == number)
    return set(static_cast<int>(number));
  set(word);
}

void Option::check() const {
  const OptionValue value = scaled();
  double number = 0.0;
  if (const auto* whole = std::get_if<int>(&value)) number = *whole;
  if (const auto* real = std::get_if<double>(&value)) number = *real;
  const auto* text = std::get_if<std::string>(&value);
  bool holds = type_ == Type::kBool || type_ == Type::kString ||
               ((above_ ? number > min_ : number >= min_) && (below_ ? number < max_ : number <= max_));
  if (text != nullptr && not_empty_) holds = !text->empty();
  if (text != nullptr && !choices_.empty()) {
    holds = std::any_of(choices_.begin(), choices_.end(), [&](const auto& c) { return c.first == *text; });
  }
  if (holds) return;
  const std::string range = allowed(), any = text != nullptr ? "a name" : "a number";
  reject(toText(get()), "allowed is " + (range.empty() ? any : range));
}

void Option::reject(const std::string& value, const std::string& expected) const {
  throw std::invalid_argument(name_ + " is " + value + ", " + expected);
}

void OptionList::require(bool holds, const std::string& name, const std::string& allowed) {
  const Option* option = find(group_ + name);
  if (option == nullptr)
    throw std::logic_error("a condition on " + group_ + name + ", which isn't described");
  if (holds || !failed_.empty()) return;
  failed_ = prefix_ + option->name() + " is " + toText(option->get()) + ", allowed is " + allowed;
}

Option* OptionList::find(const std::string& name) {
  const auto found =
      std::find_if(entries_.begin(), entries_.end(), [&](const Entry& e) { return e.option.name() == name; });
  return found == entries_.end() ? nullptr : &found->option;
}

void OptionList::assign(const OptionValues& values, const std::vector<std::string>& others) {
  std::vector<std::string> unknown;
  for (const auto& [name, value] : values) {
    if (Option* option = find(name)) {
      try {
        option->set(value);
      } catch (const std::invalid_argument& e) {
        throw std::invalid_argument(prefix_ + e.what());
      }
      continue;
    }
    const auto isOf = [&name = name](const std::string& start) {
      return name.compare(0, start.size(), start) == 0;
    };
    if (std::any_of(others.begin(), others.end(), isOf)) continue;
    unknown.push_back(prefix_ + name);
    const auto distance = [&name = name](const Entry& e) { return editDistance(name, e.option.name()); };
    const auto closest =
        std::min_element(entries_.begin(), entries_.end(),
                         [&](const Entry& a, const Entry& b) { return distance(a) < distance(b); });
    if (closest != entries_.end() && 3 * distance(*closest) <= name.size())
      unknown.back() += " (" + prefix_ + closest->option.name() + "?)";
  }
  if (unknown.empty()) return;
  std::vector<std::string> names;
  for (const Entry& entry : entries_) names.push_back(prefix_ + entry.option.name());
  std::sort(names.begin(), names.end());
  throw std::invalid_argument("unknown: " + join(unknown, ", ") + "; there are " + join(names, ", "));
}

void OptionList::check() const {
  try {
    for (const Entry& entry : entries_) entry.option.check();
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(prefix_ + e.what());
  }
  if (!failed_.empty()) throw std::invalid_argument(failed_);
}

}  // namespace mapping_common
