// SPDX-License-Identifier: BSD-3-Clause
//
// Options as dynamic_reconfigure has them, without a .cfg file: those that are dynamic, by the last part of
// their names (min_range of sensor_model/min_range).
#pragma once

#include <dynamic_reconfigure/Config.h>
#include <dynamic_reconfigure/ConfigDescription.h>
#include <mapping_common/options.h>
#include <ros/node_handle.h>

#include <cstdint>
#include <string>

namespace mapping_common {

void toMessage(const OptionList& options, dynamic_reconfigure::Config& message);
/// @throws std::invalid_argument as Option::set
void fromMessage(const dynamic_reconfigure::Config& message, OptionList options);
dynamic_reconfigure::ConfigDescription describe(const OptionList& options);
/// Sets the node's parameters, by their whole names.
void toServer(const OptionList& options, const ros::NodeHandle& node);

/// What dynamic_reconfigure::Server asks of a configuration; for others it usually generates that from a .cfg
/// file.
template <class Options>
struct Reconfiguration {
  Options options;
  std::string error;  ///< why what was asked for is no value of an option; "" if all are

  // NOLINTBEGIN(bugprone-reserved-identifier): as dynamic_reconfigure::Server calls them
  void __toMessage__(dynamic_reconfigure::Config& message) const {
    Options copy = options;
    toMessage(optionsOf(copy), message);
  }
  bool __fromMessage__(const dynamic_reconfigure::Config& message) {
    try {
      fromMessage(message, optionsOf(options, "~"));
    } catch (const std::exception& e) {
      error = e.what();
    }
    return error.empty();
  }
  void __toServer__(const ros::NodeHandle& node) const {
    Options copy = options;
    toServer(optionsOf(copy), node);
  }
  void __fromServer__(const ros::NodeHandle&) {}  // the nodelet has read them
  void __clamp__() {}                             // what is out of range is refused
  std::uint32_t __level__(const Reconfiguration&) const { return 0; }
  static dynamic_reconfigure::ConfigDescription __getDescriptionMessage__() {
    Options options;
    return describe(optionsOf(options));
  }
  static Reconfiguration __getDefault__() { return {}; }
  static Reconfiguration __getMin__() { return {}; }
  static Reconfiguration __getMax__() { return {}; }
  // NOLINTEND(bugprone-reserved-identifier)
};

}  // namespace mapping_common
