// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "mapping_common/options.h"
#include "mapping_common/testing/temp_dir.h"

namespace mapping_common {
namespace {

enum class Gear { kForward, kReverse };
constexpr auto choicesOf(Gear) {
  return choices<Gear>(
      {{"forward", Gear::kForward, "towards x"}, {"reverse", Gear::kReverse, "the other way"}});
}

struct WheelOptions {
  double radius = 0.1;
  double width = 0.05;
  void describe(OptionList& o) {
    o("radius", radius, "m", "of the tyre").within(0.01, 1.0);
    o("width", width, "m", "").above(0.0).below(1.0);
    o.require(width < radius, "width", "less than radius");
  }
};

struct RobotOptions {
  std::string name = "robot";
  Gear gear = Gear::kForward;
  std::optional<Gear> last_gear;
  double max_speed = std::numeric_limits<double>::infinity();
  double offset = 0.0, turn = 1.5707963267948966;
  unsigned wheels_count = 4;
  bool lights = true;
  WheelOptions wheels;
  void describe(OptionList& o) {
    o.section("the body");
    o("name", name, "", "what it is called").notEmpty();
    o("gear", gear, "", "of the drive").dynamic();
    o("last_gear", last_gear, "", "");
    o("max_speed", max_speed, "m/s", "it goes no faster").above(0.0).orUnlimited().dynamic();
    o("offset", offset, "", "");
    o("turn", turn, "deg", "").within(0.0, 180.0).inDegrees();
    o("wheels_count", wheels_count, "", "").within(3, 8);
    o("lights", lights, "", "whether they are on").dynamic();
    o.section("what it stands on");
    o.group("wheels", "all alike", wheels);
  }
};

std::string rejection(const OptionValues& values) {
  RobotOptions robot;
  try {
    assign(robot, values, {"other/"}, "~");
  } catch (const std::invalid_argument& e) {
    EXPECT_EQ(4u, robot.wheels_count);
    return e.what();
  }
  return "";
}

TEST(Options, AreAssignedByName) {
  RobotOptions robot;
  using Text = std::string;  // a literal would be a bool
  assign(robot,
         {{"name", 7},
          {"gear", Text("reverse")},
          {"last_gear", Text("forward")},
          {"max_speed", 2},
          {"offset", -0.5},
          {"turn", 45},
          {"wheels_count", 6},
          {"lights", false},
          {"wheels/radius", 0.3},
          {"other/thing", 1}},
         {"other/"});
  EXPECT_EQ("7", robot.name);
  EXPECT_EQ(Gear::kReverse, robot.gear);
  EXPECT_EQ(Gear::kForward, robot.last_gear);
  EXPECT_EQ(2.0, robot.max_speed);
  EXPECT_EQ(-0.5, robot.offset);
  EXPECT_DOUBLE_EQ(0.7853981633974483, robot.turn);
  EXPECT_EQ(6u, robot.wheels_count);
  EXPECT_FALSE(robot.lights);
  EXPECT_EQ(0.3, robot.wheels.radius);
  assign(robot, {{"last_gear", Text()}, {"max_speed", -1}});
  EXPECT_EQ(std::nullopt, robot.last_gear);
  EXPECT_TRUE(std::isinf(robot.max_speed));
}

TEST(Options, AreRejectedByNameValueAndWhatIsAllowed) {
  using Text = std::string;
  const double nan = std::nan("");
  EXPECT_EQ("", rejection({}));
  EXPECT_EQ("~wheels_count is 2, allowed is 3 to 8", rejection({{"wheels_count", 2}}));
  EXPECT_EQ("~wheels_count is 4.5, expected is an integer", rejection({{"wheels_count", 4.5}}));
  EXPECT_EQ("~wheels/radius is 1.5, allowed is 0.01 to 1 m", rejection({{"wheels/radius", 1.5}}));
  EXPECT_EQ("~wheels/radius is nan, allowed is 0.01 to 1 m", rejection({{"wheels/radius", nan}}));
  EXPECT_EQ("~wheels/width is 1, allowed is above 0 to below 1 m", rejection({{"wheels/width", 1}}));
  EXPECT_EQ("~wheels/width is 0.5, allowed is less than radius", rejection({{"wheels/width", 0.5}}));
  EXPECT_EQ("~max_speed is 0, allowed is more than 0 m/s, or -1: no limit", rejection({{"max_speed", 0}}));
  EXPECT_EQ("~offset is nan, allowed is a number", rejection({{"offset", nan}}));
  EXPECT_EQ("~turn is 200, allowed is 0 to 180 deg", rejection({{"turn", 200}}));
  EXPECT_EQ("~gear is 'up', allowed is forward | reverse", rejection({{"gear", Text("up")}}));
  EXPECT_EQ("~last_gear is 'up', allowed is forward | reverse | ''", rejection({{"last_gear", Text("up")}}));
  EXPECT_EQ("~name is '', allowed is a name", rejection({{"name", Text()}}));
  EXPECT_EQ("~name is true, expected is a string", rejection({{"name", true}}));
  EXPECT_EQ("~lights is 1, expected is true or false", rejection({{"lights", 1}}));
  EXPECT_EQ("~offset is a list, expected is a number", rejection({{"offset", std::monostate()}}));
}

TEST(Options, ThatThereAreNotAreGuessed) {
  EXPECT_EQ(
      "unknown: ~engine, ~wheels/radios (~wheels/radius?); there are ~gear, ~last_gear, ~lights, ~max_speed, "
      "~name, "
      "~offset, ~turn, ~wheels/radius, ~wheels/width, ~wheels_count",
      rejection({{"engine", 1}, {"wheels/radios", 1}}));
}

TEST(Options, ThatAreDynamicAreCopied) {
  RobotOptions from, to;
  from.lights = false;
  from.max_speed = 3.0;
  from.wheels_count = 3;
  copyDynamic(from, to);
  EXPECT_FALSE(to.lights);
  EXPECT_EQ(3.0, to.max_speed);
  EXPECT_EQ(4u, to.wheels_count);
}

TEST(Options, OfEnumsHaveNames) {
  EXPECT_EQ("reverse", nameOf(Gear::kReverse));
  EXPECT_EQ("", nameOf(static_cast<Gear>(7)));
}

const char kYaml[] = R"(# SPDX-License-Identifier: BSD-3-Clause
#
# A robot.

# ------------------------------------------------------------------------------------------------------------- the body
name: robot                  # what it is called
gear: forward                # (dynamic) of the drive. forward: towards x; reverse: the other way
last_gear: ""                # forward | reverse | '': forward: towards x; reverse: the other way
max_speed: -1.0              # (dynamic) more than 0 m/s, or -1: no limit: it goes no faster
offset: 1.0e-05
turn: 90.0                   # 0 to 180 deg
wheels_count: 4              # 3 to 8
lights: true                 # (dynamic) whether they are on

# ---------------------------------------------------------------------------------------------------- what it stands on
wheels:                      # all alike
  radius: 0.1                # 0.01 to 1 m: of the tyre
  width: 0.05                # above 0 to below 1 m
)";

TEST(Options, AsYamlAreReadBack) {
  RobotOptions robot;
  robot.offset = 1e-5;
  EXPECT_EQ(kYaml, toYaml(optionsOf(robot), "A robot."));
  robot.name = "no";
  robot.last_gear = Gear::kReverse;
  robot.max_speed = 0.1;
  robot.wheels.radius = 1.0 / 3.0;
  const TempDir dir;
  RobotOptions read;
  assign(read, loadYaml(dir.write("a.yaml", toYaml(optionsOf(robot), "A robot."))));
  for (const auto& [option, section] : optionsOf(robot))
    EXPECT_EQ(option.get(), optionsOf(read).find(option.name())->get()) << option.name();
}

TEST(Options, AsATableAreWhole) {
  RobotOptions robot;
  const std::string table = toMarkdown(optionsOf(robot));
  EXPECT_TRUE(
      mentions(table, {"### the body\n\n| Parameter | Default | |\n| --- | --- | --- |\n",
                       "| `gear` | `forward` | (dynamic) of the drive. forward: towards x; reverse: the",
                       "| `last_gear` | `\"\"` | forward \\| reverse \\| '': ",
                       "| `wheels/radius` | `0.1` | 0.01 to 1 m: of the tyre |\n"}));
}

TEST(Options, OfWhatIsNoYamlAreRefused) {
  const TempDir dir;
  EXPECT_TRUE(
      mentions(errorOf([&] { loadYaml(dir.write("bad.yaml", "a: [1, 2\nb: }")); }), {"bad.yaml", "line"}));
  EXPECT_TRUE(mentions(errorOf([&] { loadYaml(dir.write("bad.yaml", "text")); }), {"bad.yaml", "a map"}));
  EXPECT_NE("", errorOf([] { loadYaml("/nowhere.yaml"); }));
  EXPECT_TRUE(loadYaml(dir.write("empty.yaml", "")).empty());
  EXPECT_EQ(OptionValue(std::monostate()), loadYaml(dir.write("list.yaml", "a: [1, 2]")).at("a"));
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
