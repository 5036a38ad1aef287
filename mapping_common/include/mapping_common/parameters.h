// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace mapping_common {

/// Says that a parameter's value won't do.
/// @param expected the rest of the sentence, e.g. "allowed is 0 to 1"
/// @throws std::invalid_argument
template <class T>
[[noreturn]] void rejectParameter(const std::string& name, const T& value, const std::string& expected) {
  std::ostringstream text;
  text << '~' << name << " is " << value << ", " << expected;
  throw std::invalid_argument(text.str());
}

/// The private parameters of a node, read one by one and checked, so that no misspelt one goes unnoticed.
class Parameters {
 public:
  /// @param all a struct, nested as the parameters' names are; anything else is no parameters at all
  explicit Parameters(XmlRpc::XmlRpcValue all);

  /// Sets what is given of a struct's options, checks them, and that there are no others.
  /// @param others how the names start that somebody else reads
  /// @throws std::invalid_argument that names the parameter, its value and what is allowed; or those there
  /// are
  ///   none of, what may be meant, and those there are. The options are as they were then
  template <class Options>
  void read(Options& options, const std::vector<std::string>& others = {"reconfigure/"}) const {
    assign(options, values(), others, "~");
  }
  OptionValues values() const;

  /// The parameter's value, or `fallback` where it isn't set.
  /// @tparam T bool, int, double or std::string; an integer will do for the last two, as roslaunch takes
  ///   every number for one
  /// @throws std::invalid_argument that names the parameter, its value and what is expected
  template <class T>
  T get(const std::string& name, const T& fallback);
  /// The same within min and max.
  template <class T>
  T get(const std::string& name, const T& fallback, const T& min, const T& max);
  /// The same for one of a few words.
  std::string choice(const std::string& name, const std::string& fallback,
                     const std::vector<std::string>& allowed);

  /// @param except how the names start that somebody else reads, e.g. "reconfigure/"
  /// @throws std::invalid_argument that names the parameters nobody asked for, what may be meant, and those
  /// there are
  void rejectUnknown(const std::vector<std::string>& except = {}) const;
  /// All that was asked for.
  const std::set<std::string>& names() const { return names_; }

 private:
  void flatten(const std::string& prefix, XmlRpc::XmlRpcValue& value);

  std::map<std::string, XmlRpc::XmlRpcValue> values_;
  std::set<std::string> names_;
};

}  // namespace mapping_common
