// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/parameters.h"

namespace mapping_common {

using XmlRpc::XmlRpcValue;

Parameters::Parameters(XmlRpcValue all) {
  if (all.getType() == XmlRpcValue::TypeStruct) flatten("", all);
}

void Parameters::flatten(const std::string& prefix, XmlRpcValue& value) {
  for (auto& [name, member] : value) {
    OptionValue& to = values_[prefix + name];
    switch (member.getType()) {
      case XmlRpcValue::TypeStruct:
        values_.erase(prefix + name);
        flatten(prefix + name + '/', member);
        break;
      case XmlRpcValue::TypeBoolean:
        to = static_cast<bool&>(member);
        break;
      case XmlRpcValue::TypeInt:
        to = static_cast<int&>(member);
        break;
      case XmlRpcValue::TypeDouble:
        to = static_cast<double&>(member);
        break;
      case XmlRpcValue::TypeString:
        to = static_cast<std::string&>(member);
        break;
      default:
        to = std::monostate();
    }
  }
}

}  // namespace mapping_common
