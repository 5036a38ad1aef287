// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/text.h"

#include <cctype>
#include <cstdlib>

namespace mapping_common {

bool parseNumbers(const std::string& line, std::vector<double>& numbers) {
  numbers.clear();
  const char* p = line.c_str();
  while (true) {
    while (std::isspace(static_cast<unsigned char>(*p))) ++p;
    if (*p == '\0') return p == line.c_str() + line.size();
    char* end = nullptr;
    numbers.push_back(std::strtod(p, &end));
    if (end == p || (*end != '\0' && !std::isspace(static_cast<unsigned char>(*end)))) return false;
    p = end;
  }
}

}  // namespace mapping_common
