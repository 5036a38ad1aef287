// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace mapping_common {

/// A Markdown table whose columns are aligned as text, too.
/// @param rows of cells in ASCII, the header first; all as long as it
/// @param left so many columns, from the first on, are flush left, all others flush right
std::string markdownTable(const std::vector<std::vector<std::string>>& rows, std::size_t left = 1);

}  // namespace mapping_common
