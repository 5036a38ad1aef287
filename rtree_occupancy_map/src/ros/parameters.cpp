// SPDX-License-Identifier: BSD-3-Clause
#include "rtree_occupancy_map/ros/parameters.h"

#include <sstream>
#include <stdexcept>
#include <type_traits>

namespace rtree_occupancy_map {
namespace {

using XmlRpc::XmlRpcValue;

template <class T>
[[noreturn]] void reject(const std::string& name, const T& value, const std::string& expected) {
  std::ostringstream text;
  text << '~' << name << " is " << value << ", " << expected;
  throw std::invalid_argument(text.str());
}

template <class T>
constexpr const char* typeName() {
  if constexpr (std::is_same_v<T, bool>) return "true or false";
  if constexpr (std::is_same_v<T, int>) return "an integer";
  if constexpr (std::is_same_v<T, double>) return "a number";
  return "a string";
}

template <class T>
bool read(XmlRpcValue& from, T& to) {
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
  if (from.getType() != type) return false;
  to = static_cast<T&>(from);
  return true;
}

std::string join(const std::set<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "~" : ", ~") + name;
  return text;
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

template <class T>
T Parameters::get(const std::string& name, const T& fallback) {
  names_.insert(name);
  const auto found = values_.find(name);
  if (found == values_.end()) return fallback;
  T value;
  if (!read(found->second, value)) reject(name, found->second, std::string("expected is ") + typeName<T>());
  return value;
}

template <class T>
T Parameters::get(const std::string& name, const T& fallback, const T& min, const T& max) {
  const T value = get(name, fallback);
  if (!(value >= min && value <= max)) {
    std::ostringstream allowed;
    allowed << "allowed is " << min << " to " << max;
    reject(name, value, allowed.str());
  }
  return value;
}

template bool Parameters::get(const std::string&, const bool&);
template int Parameters::get(const std::string&, const int&);
template double Parameters::get(const std::string&, const double&);
template std::string Parameters::get(const std::string&, const std::string&);
template int Parameters::get(const std::string&, const int&, const int&, const int&);
template double Parameters::get(const std::string&, const double&, const double&, const double&);

void Parameters::rejectUnknown(const std::string& except) const {
  std::set<std::string> unknown;
  for (const auto& [name, value] : values_) {
    if (names_.count(name) == 0 && name.compare(0, except.size(), except) != 0) unknown.insert(name);
  }
  if (!unknown.empty()) {
    throw std::invalid_argument("unknown: " + join(unknown) + "; the parameters are " + join(names_));
  }
}

double maxRange(double parameter) {
  return parameter == -1.0 ? std::numeric_limits<double>::infinity() : parameter;
}

MappingParameters readMappingParameters(Parameters& p) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  MappingParameters m;
  Options& o = m.map;
  // The checks of others don't know what a parameter is called here.
  const auto check = [](const std::string& name, const auto& statement) {
    try {
      statement();
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument('~' + name + ": " + e.what());
    }
  };
  const auto option = [&](const std::string& name, double& value) {
    value = p.get(name, value);
    check(name, [&] { o.validate(); });
  };
  const auto choice = [&](const std::string& name, const std::string& fallback, auto& value,
                          const auto& parse) {
    const std::string text = p.get(name, fallback);
    check(name, [&] { value = parse(text); });
  };

  option("resolution", o.resolution);
  choice("sensor_model/type", "beam", o.sensor_model, parseSensorModel);
  option("sensor_model/hit", o.prob_hit);
  option("sensor_model/miss", o.prob_miss);
  option("sensor_model/min", o.clamping_min);
  option("sensor_model/max", o.clamping_max);
  option("sensor_model/prior", o.prior);
  option("sensor_model/occupancy_threshold", o.occupancy_threshold);
  option("sensor_model/min_range", o.min_range);
  o.max_range = maxRange(p.get("sensor_model/max_range", -1.0));
  check("sensor_model/max_range", [&o] { o.validate(); });
  choice("fusion/rule", "equal", o.fusion_rule, parseFusionRule);
  choice("fusion/strategy", "block", o.fusion_strategy, parseFusionStrategy);
  o.search_order = p.get("fusion/search_order", o.search_order);
  check("fusion/search_order", [&o] { o.validate(); });
  option("fusion/samples_per_metre", o.samples_per_metre);
  o.seed = p.get("seed", 1, 0, std::numeric_limits<int>::max());
  o.dynamic = p.get("dynamic", o.dynamic);
  o.reflectivity = p.get("reflectivity", o.reflectivity);
  o.tree.min_entries = p.get("tree/min_entries", o.tree.min_entries);
  o.tree.max_entries = p.get("tree/max_entries", o.tree.max_entries);
  check("tree", [&o] { o.validate(); });
  choice("tree/split", "quadratic", o.tree.split, parseSplitMethod);

  m.scan.min_z = p.get("pointcloud_min_z", -kInfinity, -kInfinity, kInfinity);
  m.scan.max_z = p.get("pointcloud_max_z", kInfinity, m.scan.min_z, kInfinity);
  m.scan.no_return_clears = p.get("no_return_clears", m.scan.no_return_clears);
  m.queue_size = p.get("queue_size", m.queue_size, 1, 10000);
  m.transform_tolerance = p.get("transform_tolerance", m.transform_tolerance, 0.0, 10.0);

  DisplayOptions& d = m.display;
  d.frame_id = p.get("frame_id", d.frame_id);
  if (d.frame_id.empty()) reject("frame_id", "''", "allowed is the name of a frame");
  m.publish_rate = p.get("publish_rate", m.publish_rate, 0.1, 100.0);
  d.full_map_period = p.get("full_map_period", d.full_map_period, 0.0, 1e6);
  d.latch = p.get("latch", d.latch);
  d.publish_free_space = p.get("publish_free_space", d.publish_free_space);
  m.color_mode = p.get("color_mode", m.color_mode);
  check("color_mode", [&] { d.color.mode = parseColorMode(m.color_mode); });
  d.color.min = p.get("color_min", d.color.min);
  d.color.max = p.get("color_max", d.color.max);
  d.occupancy_min_z = p.get("occupancy_min_z", d.occupancy_min_z);
  d.occupancy_max_z = p.get("occupancy_max_z", d.occupancy_max_z);
  d.validate();

  m.map_file = p.get("map_file", m.map_file);
  m.save_on_shutdown = p.get("save_on_shutdown", m.save_on_shutdown);
  return m;
}

}  // namespace rtree_occupancy_map
