// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace mapping_common {

/// Words with spaces, commas or semicolons between them: what a list of strings is as an option's value.
/// Each once, in their order.
std::vector<std::string> listOf(const std::string& text);

/// The private parameters of a node.
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
  void read(Options& options, const std::vector<std::string>& others = {}) const {
    assign(options, values_, others, "~");
  }

 private:
  void flatten(const std::string& prefix, XmlRpc::XmlRpcValue& value);
  OptionValues values_;
};

}  // namespace mapping_common
