// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/markdown_table.h"

#include <algorithm>

namespace mapping_common {

std::string markdownTable(const std::vector<std::vector<std::string>>& rows, std::size_t left) {
  std::vector<std::size_t> widths(rows.at(0).size(), 3);
  for (const std::vector<std::string>& row : rows) {
    for (std::size_t i = 0; i < widths.size(); ++i) widths[i] = std::max(widths[i], row.at(i).size());
  }
  std::string table, rule;
  for (std::size_t i = 0; i < widths.size(); ++i)
    rule += "| " + std::string(widths[i] - 1, '-') + (i < left ? "- " : ": ");
  for (const std::vector<std::string>& row : rows) {
    for (std::size_t i = 0; i < widths.size(); ++i) {
      const std::string padding(widths[i] - row[i].size(), ' ');
      table += "| " + (i < left ? row[i] + padding : padding + row[i]) + ' ';
    }
    table += "|\n" + (&row == &rows[0] ? rule + "|\n" : "");
  }
  return table;
}

}  // namespace mapping_common
