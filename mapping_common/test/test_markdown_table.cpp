// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/markdown_table.h>

#include <stdexcept>

namespace mapping_common {
namespace {

TEST(MarkdownTable, ColumnsAreAligned) {
  EXPECT_EQ(
      "| cost      | lost |   m |\n"
      "| --------- | ---: | --: |\n"
      "| occupancy |    1 | 0.5 |\n"
      "| auto      |   12 |   - |\n",
      markdownTable({{"cost", "lost", "m"}, {"occupancy", "1", "0.5"}, {"auto", "12", "-"}}));
  EXPECT_EQ("| a   | b   |\n| --- | --- |\n", markdownTable({{"a", "b"}}, 2));
}

TEST(MarkdownTable, RowsAreAsLongAsTheHeader) {
  EXPECT_THROW(markdownTable({{"a", "b"}, {"1"}}), std::out_of_range);
  EXPECT_THROW(markdownTable({}), std::out_of_range);
}

}  // namespace
}  // namespace mapping_common
