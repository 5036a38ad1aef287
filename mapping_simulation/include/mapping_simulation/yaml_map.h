// SPDX-License-Identifier: BSD-3-Clause
// Strict reading of YAML mappings: a missing, unknown, repeated or out-of-range key is an exception that
// names the file, the line, the key, the value and what is allowed.
#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace mapping_simulation {

/// Closed interval of allowed values, and their unit for messages.
struct Limits {
  double min;
  double max;
  const char* unit = "";
};

constexpr Limits kMetres{-1e5, 1e5, "m"};
constexpr Limits kDegrees{-360.0, 360.0, "deg"};
constexpr Limits kRatio{0.0, 1.0};

class YamlMap {
 public:
  /// The mapping that a file consists of.
  static YamlMap load(const std::string& file);
  /// A mapping inside `file`; `node` is called `name` in messages.
  YamlMap(const YAML::Node& node, const std::string& file, const std::string& name);

  bool has(const std::string& key) const;
  /// Node of a key that must be there.
  YAML::Node node(const std::string& key) const;
  /// Mapping of a key that must be there.
  YamlMap map(const std::string& key) const { return YamlMap(node(key), file_, key); }
  /// Nodes of a sequence that must be there and not be empty.
  std::vector<YAML::Node> sequence(const std::string& key) const;

  // Values. Without a fallback the key must be there.
  double number(const std::string& key, Limits limits, std::optional<double> fallback = {}) const;
  int integer(const std::string& key, Limits limits, std::optional<int> fallback = {}) const;
  bool flag(const std::string& key, bool fallback) const;
  std::string text(const std::string& key, std::optional<std::string> fallback = {}) const;
  std::string choice(const std::string& key, const std::vector<std::string>& allowed) const;
  std::vector<double> numbers(const std::string& key, Limits limits, std::size_t min_size,
                              std::size_t max_size) const;
  Eigen::Vector3d vector3(const std::string& key, Limits limits,
                          std::optional<Eigen::Vector3d> fallback = {}) const;
  /// Pose from `position` (m, default 0) and either `yaw_deg` or `rpy_deg` (default 0).
  Eigen::Isometry3d pose() const;

  /// Values of a sequence node that is called `name` in messages.
  std::vector<double> numbers(const YAML::Node& node, const std::string& name, Limits limits,
                              std::size_t min_size, std::size_t max_size) const;

  /// Marks a key as known though this reader has no use for it.
  void ignore(const std::string& key) const { known_.insert(key); }
  /// Throws if there is a key that none of the calls above asked for. To be called when all keys were read.
  void finish() const;

  YAML::Node node() const { return node_; }
  const std::string& file() const { return file_; }
  [[noreturn]] void fail(const YAML::Node& at, const std::string& what) const;

 private:
  YAML::Node find(const std::string& key) const;
  double toNumber(const YAML::Node& node, const std::string& name, Limits limits) const;

  YAML::Node node_;
  std::string file_;
  std::string name_;
  mutable std::set<std::string> known_;
};

/// Rotation by roll, pitch, yaw about the fixed axes x, y, z (REP 103); degrees.
Eigen::Quaterniond fromRpyDegrees(double roll, double pitch, double yaw);

}  // namespace mapping_simulation
