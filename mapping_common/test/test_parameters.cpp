// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "mapping_common/parameters.h"

namespace mapping_common {
namespace {

struct Options {
  int rate = 1;
  double scale = 1.0;
  std::string name, number;
  bool on = false;
  void describe(OptionList& o) {
    o("rate", rate, "Hz", "").within(1, 50);
    o("model/scale", scale, "", "");
    o("name", name, "", "");
    o("number", number, "", "");
    o("on", on, "", "");
  }
};

XmlRpc::XmlRpcValue make() {
  XmlRpc::XmlRpcValue all;
  all["rate"] = 40;
  all["name"] = std::string("front");
  all["number"] = 7;  // roslaunch makes numbers of what looks like one
  all["model"]["scale"] = 2;
  all["on"] = true;
  return all;
}

std::string rejection(const XmlRpc::XmlRpcValue& all) {
  Options options;
  try {
    Parameters(all).read(options);
  } catch (const std::invalid_argument& e) {
    EXPECT_EQ(1, options.rate);
    return e.what();
  }
  return "";
}

TEST(Parameters, AreRead) {
  Options options;
  Parameters(make()).read(options);
  EXPECT_EQ(40, options.rate);
  EXPECT_EQ(2.0, options.scale);
  EXPECT_EQ("front", options.name);
  EXPECT_EQ("7", options.number);
  EXPECT_TRUE(options.on);
  Parameters(XmlRpc::XmlRpcValue()).read(options);
  EXPECT_EQ(40, options.rate);
}

TEST(Parameters, ListsOfStringsAreOneString) {
  auto all = make();
  all["name"].clear();
  all["name"][0] = std::string("front/points");
  all["name"][1] = std::string("rear/points");
  Options options;
  Parameters(all).read(options);
  EXPECT_EQ("front/points; rear/points", options.name);
  all["name"][1] = 3;
  EXPECT_NE(std::string::npos, rejection(all).find("name is a list"));
}

TEST(Parameters, AreRejectedByName) {
  auto all = make();
  all["rate"] = 60;
  EXPECT_EQ("~rate is 60, allowed is 1 to 50 Hz", rejection(all));
  all = make();
  all["model"]["scale"] = std::string("wide");
  EXPECT_EQ("~model/scale is 'wide', expected is a number", rejection(all));
  all = make();
  XmlRpc::XmlRpcValue list;
  list[0] = 1;
  all["name"] = list;
  EXPECT_EQ("~name is a list, expected is a string", rejection(all));
  all = make();
  all["model"]["scales"] = 1.0;
  EXPECT_EQ("unknown: ~model/scales (~model/scale?); there are ~model/scale, ~name, ~number, ~on, ~rate",
            rejection(all));
}

TEST(Parameters, ListsAreWords) {
  EXPECT_EQ((std::vector<std::string>{"edges", "/slam/loops", "a"}), listOf(" edges,/slam/loops; a  edges"));
  EXPECT_TRUE(listOf(" ;, ").empty());
}

}  // namespace
}  // namespace mapping_common
