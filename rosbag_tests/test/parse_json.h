// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/property_tree/json_parser.hpp>
#include <sstream>
#include <string>

namespace rosbag_tests {

inline boost::property_tree::ptree parseJson(const std::string& text) {
  boost::property_tree::ptree tree;
  std::istringstream in(text);
  boost::property_tree::read_json(in, tree);
  return tree;
}

}  // namespace rosbag_tests
