// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <rtree_occupancy_map/options.h>
#include <rtree_occupancy_map/ros/map_publisher.h>
#include <rtree_occupancy_map/ros/scan_conversion.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <map>
#include <set>
#include <string>

namespace rtree_occupancy_map {

/// The private parameters of a node, read one by one and checked, so that no misspelt one goes unnoticed.
class Parameters {
 public:
  /// @param all a struct, nested as the parameters' names are; anything else is no parameters at all
  explicit Parameters(XmlRpc::XmlRpcValue all);

  /// The parameter's value, or `fallback` where it isn't set.
  /// @tparam T bool, int, double (an integer will do) or std::string
  /// @throws std::invalid_argument that names the parameter, its value and what is expected
  template <class T>
  T get(const std::string& name, const T& fallback);
  /// The same within min and max.
  template <class T>
  T get(const std::string& name, const T& fallback, const T& min, const T& max);

  /// @param except how names start that somebody else reads
  /// @throws std::invalid_argument that names the parameters nobody asked for, and those there are
  void rejectUnknown(const std::string& except) const;
  /// All that was asked for.
  const std::set<std::string>& names() const { return names_; }

 private:
  void flatten(const std::string& prefix, XmlRpc::XmlRpcValue& value);

  std::map<std::string, XmlRpc::XmlRpcValue> values_;
  std::set<std::string> names_;
};

/// What the mapping nodelet is started with; config/mapping.yaml explains each.
struct MappingParameters {
  Options map;
  ScanLimits scan;
  DisplayOptions display;
  std::string color_mode = "height";
  std::string map_file;
  std::string save_on_shutdown;
  int queue_size = 10;
  double transform_tolerance = 0.0;  ///< s
  double publish_rate = 2.0;         ///< Hz
};

/// @throws std::invalid_argument that names the parameter, its value and the allowed range
MappingParameters readMappingParameters(Parameters& parameters);

/// -1, as in octomap_server, stands for no limit: infinity.
double maxRange(double parameter);

}  // namespace rtree_occupancy_map
