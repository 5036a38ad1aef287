// SPDX-License-Identifier: BSD-3-Clause
#include <mapping_simulation/yaml_map.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace mapping_simulation {
namespace {

template <typename Strings>
std::string join(const Strings& strings) {
  std::string joined;
  for (const std::string& s : strings) joined += (joined.empty() ? "" : ", ") + s;
  return joined;
}

std::string quote(const YAML::Node& node) {
  return node.IsScalar() ? "'" + node.Scalar() + "'" : YAML::Dump(node);
}

}  // namespace

YamlMap YamlMap::load(const std::string& file) {
  try {
    return YamlMap(YAML::LoadFile(file), file, "the file");
  } catch (const YAML::BadFile&) {
    throw std::runtime_error(file + ": can't be read");
  } catch (const YAML::ParserException& e) {
    throw std::runtime_error(file + ":" + std::to_string(e.mark.line + 1) + ": not YAML: " + e.msg);
  }
}

YamlMap::YamlMap(const YAML::Node& node, const std::string& file, const std::string& name)
    : node_(node), file_(file), name_(name) {
  if (!node_.IsMap()) fail(node_, name + " must be a mapping of keys to values");
}

void YamlMap::fail(const YAML::Node& at, const std::string& what) const {
  throw std::runtime_error(file_ + ":" + std::to_string(at.Mark().line + 1) + ": " + what);
}

YAML::Node YamlMap::find(const std::string& key) const {
  known_.insert(key);
  return node_[key];
}

bool YamlMap::has(const std::string& key) const {
  return find(key).IsDefined();
}

YAML::Node YamlMap::node(const std::string& key) const {
  const YAML::Node value = find(key);
  if (!value.IsDefined()) fail(node_, "key '" + key + "' is missing in " + name_);
  return value;
}

std::vector<YAML::Node> YamlMap::sequence(const std::string& key) const {
  const YAML::Node value = node(key);
  if (!value.IsSequence() || value.size() == 0) fail(value, key + " is " + quote(value) + ": must be a list");
  return std::vector<YAML::Node>(value.begin(), value.end());
}

double YamlMap::toNumber(const YAML::Node& node, const std::string& name, Limits limits) const {
  double value = NAN;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) ||
      !(value >= limits.min && value <= limits.max)) {
    std::ostringstream what;
    what << name << " is " << quote(node) << ": must be a number in [" << limits.min << ", " << limits.max
         << "]";
    if (*limits.unit) what << ' ' << limits.unit;
    fail(node, what.str());
  }
  return value;
}

double YamlMap::number(const std::string& key, Limits limits, std::optional<double> fallback) const {
  return !has(key) && fallback ? *fallback : toNumber(node(key), key, limits);
}

int YamlMap::integer(const std::string& key, Limits limits, std::optional<int> fallback) const {
  if (!has(key) && fallback) return *fallback;
  const double value = toNumber(node(key), key, limits);
  if (value != std::floor(value))
    fail(node(key), key + " is " + quote(node(key)) + ": must be a whole number");
  return static_cast<int>(value);
}

bool YamlMap::flag(const std::string& key, bool fallback) const {
  if (!has(key)) return fallback;
  bool value = false;
  if (!node(key).IsScalar() || !YAML::convert<bool>::decode(node(key), value)) {
    fail(node(key), key + " is " + quote(node(key)) + ": must be true or false");
  }
  return value;
}

std::string YamlMap::text(const std::string& key, std::optional<std::string> fallback) const {
  if (!has(key) && fallback) return *fallback;
  const YAML::Node value = node(key);
  if (!value.IsScalar() || value.Scalar().empty())
    fail(value, key + " is " + quote(value) + ": must be a text");
  return value.Scalar();
}

std::string YamlMap::choice(const std::string& key, const std::vector<std::string>& allowed) const {
  const std::string value = text(key);
  if (std::find(allowed.begin(), allowed.end(), value) == allowed.end()) {
    fail(node(key), key + " is '" + value + "': must be one of " + join(allowed));
  }
  return value;
}

std::vector<double> YamlMap::numbers(const std::string& key, Limits limits, std::size_t min_size,
                                     std::size_t max_size) const {
  return numbers(node(key), key, limits, min_size, max_size);
}

std::vector<double> YamlMap::numbers(const YAML::Node& node, const std::string& name, Limits limits,
                                     std::size_t min_size, std::size_t max_size) const {
  if (!node.IsSequence() || node.size() < min_size || node.size() > max_size) {
    const std::string size = std::to_string(min_size);
    fail(node, name + " is " + quote(node) + ": must be a list of " +
                   (min_size == max_size ? size : size + " to " + std::to_string(max_size)) + " numbers");
  }
  std::vector<double> values;
  for (const YAML::Node& element : node) values.push_back(toNumber(element, name, limits));
  return values;
}

Eigen::Vector3d YamlMap::vector3(const std::string& key, Limits limits,
                                 std::optional<Eigen::Vector3d> fallback) const {
  if (!has(key) && fallback) return *fallback;
  return Eigen::Vector3d(numbers(key, limits, 3, 3).data());
}

Eigen::Isometry3d YamlMap::pose() const {
  if (has("yaw_deg") && has("rpy_deg")) fail(node("rpy_deg"), "yaw_deg and rpy_deg exclude each other");
  Eigen::Vector3d rpy = vector3("rpy_deg", kDegrees, Eigen::Vector3d::Zero());
  rpy.z() = number("yaw_deg", kDegrees, rpy.z());
  Eigen::Isometry3d pose(fromRpyDegrees(rpy.x(), rpy.y(), rpy.z()));
  pose.translation() = vector3("position", kMetres, Eigen::Vector3d::Zero());
  return pose;
}

void YamlMap::finish() const {
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : quote(entry.first);
    if (!known_.count(key))
      fail(entry.first, "unknown key '" + key + "' in " + name_ + "; known: " + join(known_));
    if (!seen.insert(key).second) fail(entry.first, "key '" + key + "' appears twice in " + name_);
  }
}

Eigen::Quaterniond fromRpyDegrees(double roll, double pitch, double yaw) {
  constexpr double kRadians = M_PI / 180.0;
  return Eigen::AngleAxisd(yaw * kRadians, Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(pitch * kRadians, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll * kRadians, Eigen::Vector3d::UnitX());
}

}  // namespace mapping_simulation
