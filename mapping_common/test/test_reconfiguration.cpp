// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <limits>

#include "mapping_common/reconfiguration.h"

namespace mapping_common {
namespace {

enum class Mode { kSlow, kFast };
constexpr auto choicesOf(Mode) {
  return choices<Mode>({{"slow", Mode::kSlow, "it's safe"}, {"fast", Mode::kFast}});
}

struct Options {
  int count = 3;
  double fixed = 1.0, max_range = std::numeric_limits<double>::infinity();
  bool on = true;
  Mode mode = Mode::kSlow;
  void describe(OptionList& o) {
    o("count", count, "", "how many").within(1, 9).dynamic();
    o("fixed", fixed, "", "");
    o("sensor/max_range", max_range, "m", "no farther").above(0.0).orUnlimited().dynamic();
    o("on", on, "", "").dynamic();
    o("mode", mode, "", "of motion").dynamic();
  }
};

template <class List>
auto valueOf(const List& list, const std::string& name) {
  for (const auto& parameter : list)
    if (parameter.name == name) return parameter.value;
  ADD_FAILURE() << "there is no " << name;
  return decltype(list.front().value)();
}

TEST(Reconfiguration, DescribesWhatIsDynamic) {
  const auto description = Reconfiguration<Options>::__getDescriptionMessage__();
  ASSERT_EQ(1u, description.groups.size());
  const auto& parameters = description.groups[0].parameters;
  ASSERT_EQ(4u, parameters.size());
  EXPECT_EQ("count", parameters[0].name);
  EXPECT_EQ("int", parameters[0].type);
  EXPECT_EQ("max_range", parameters[1].name);
  EXPECT_EQ("m: no farther", parameters[1].description);
  EXPECT_EQ("", parameters[1].edit_method);
  EXPECT_EQ("str", parameters[3].type);
  EXPECT_EQ(
      "{'enum': [{'name': 'slow', 'type': 'str', 'value': 'slow', 'description': 'it\\'s safe'}, "
      "{'name': 'fast', 'type': 'str', 'value': 'fast', 'description': ''}], 'enum_description': 'of "
      "motion'}",
      parameters[3].edit_method);
  EXPECT_EQ(1, valueOf(description.min.ints, "count"));
  EXPECT_EQ(9, valueOf(description.max.ints, "count"));
  EXPECT_EQ(3, valueOf(description.dflt.ints, "count"));
  EXPECT_EQ(-1.0, valueOf(description.min.doubles, "max_range"));
  EXPECT_EQ(-1.0, valueOf(description.dflt.doubles, "max_range"));
  EXPECT_EQ("slow", valueOf(description.dflt.strs, "mode"));
  EXPECT_EQ(1u, description.min.groups.size());
}

TEST(Reconfiguration, TakesWhatComes) {
  Reconfiguration<Options> config;
  dynamic_reconfigure::Config message;
  config.__toMessage__(message);
  EXPECT_EQ(3, valueOf(message.ints, "count"));
  message.ints[0].value = 5;
  message.doubles[0].value = 20.0;
  message.strs[0].value = "fast";
  message.bools.clear();  // what isn't in it stays
  EXPECT_TRUE(config.__fromMessage__(message));
  EXPECT_EQ(5, config.options.count);
  EXPECT_EQ(20.0, config.options.max_range);
  EXPECT_EQ(Mode::kFast, config.options.mode);
  EXPECT_TRUE(config.options.on);
  message.strs[0].value = "faster";
  EXPECT_FALSE(config.__fromMessage__(message));
  EXPECT_EQ("~mode is 'faster', allowed is slow | fast", config.error);
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
