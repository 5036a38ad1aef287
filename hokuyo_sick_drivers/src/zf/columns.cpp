// SPDX-License-Identifier: BSD-3-Clause
#include "columns.h"

#include <algorithm>
#include <cctype>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "numbers.h"

namespace hokuyo_sick_drivers {
namespace {

const std::vector<std::string> kWords = {"x", "y", "z", "i", "r", "g", "b", "rf", "gf", "bf"};

[[noreturn]] void fail(const std::string& words, const std::string& why) {
  throw std::runtime_error("can't be read by the columns \"" + words + "\": " + why +
                           "; allowed are x y z i r g b rf gf bf, _, and - before x y z");
}

// Our word for a column that a header names.
std::string wordFor(const std::string& name) {
  static const std::map<std::string, std::string> kOthers = {{"red", "r"}, {"green", "g"}, {"blue", "b"}};
  if (const auto other = kOthers.find(name); other != kOthers.end()) return other->second;
  if (std::find(kWords.begin(), kWords.end(), name) != kWords.end()) return name;
  for (const char* part : {"intensity", "reflect", "remission"}) {
    if (name.find(part) != name.npos) return "i";
  }
  return "_";
}

}  // namespace

Columns::Columns(const std::string& words) {
  std::istringstream in(words);
  std::string word;
  position_.fill(-1);
  factor_.fill(1.0);
  while (in >> word) {
    if (count_ == kMost) fail(words, "there are more than " + std::to_string(kMost));
    const int column = static_cast<int>(count_++);
    if (word == "_") continue;
    const bool minus = word[0] == '-';
    const auto found = std::find(kWords.begin(), kWords.end(), minus ? word.substr(1) : word);
    auto name = static_cast<std::size_t>(found - kWords.begin());
    if (found == kWords.end() || (minus && name > kZ)) fail(words, "\"" + word + "\" isn't one");
    const bool is_share = name >= kNames;  // a colour from 0 to 1
    if (is_share) name -= kNames - kRed;
    if (position_[name] >= 0) fail(words, "\"" + word + "\" is there twice");
    position_[name] = column;
    factor_[name] = minus ? -1.0 : is_share ? 255.0 : 1.0;
  }
  if (!has(kX) || !has(kY) || !has(kZ)) fail(words, "x, y or z is missing");
  if (has(kRed) != has(kGreen) || has(kGreen) != has(kBlue)) fail(words, "r, g and b come together");
}

std::optional<Columns> Columns::usual(std::size_t count) {
  static const std::map<std::size_t, const char*> kUsual = {
      {3, "x y z"}, {4, "x y z i"}, {6, "x y z r g b"}, {7, "x y z i r g b"}, {8, "_ _ x y z _ _ _"}};
  const auto found = kUsual.find(count);
  return found == kUsual.end() ? std::nullopt : std::optional(Columns(found->second));
}

std::optional<Columns> Columns::named(std::string_view header) {
  std::vector<std::string> words;
  std::string name;
  const auto end = [&] {
    if (!name.empty()) words.push_back(wordFor(name));
    name.clear();
  };
  for (const char c : header.substr(std::min(header.find_first_not_of("/# \t"), header.size()))) {
    if (isSeparator(c)) {
      end();
    } else {
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    }
  }
  end();
  std::string all;
  for (auto word = words.begin(); word != words.end(); ++word)  // of several intensities, the first
    all += (std::find(words.begin(), word, *word) == word ? *word : "_") + ' ';
  try {
    return Columns(all);
  } catch (const std::runtime_error&) {  // some other text
    return std::nullopt;
  }
}

void Columns::read(const double* fields, const IntensityMap& intensity, ScanPoint& point) const {
  point.x = value(fields, kX);
  point.y = value(fields, kY);
  point.z = value(fields, kZ);
  point.valid = isMeasured(point.x, point.y, point.z);
  if (hasIntensity()) point.intensity = intensity(value(fields, kIntensity));
  if (hasColour()) {
    point.r = toColour(value(fields, kRed));
    point.g = toColour(value(fields, kGreen));
    point.b = toColour(value(fields, kBlue));
  }
}

}  // namespace hokuyo_sick_drivers
