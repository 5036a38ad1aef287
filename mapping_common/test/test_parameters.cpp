// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <functional>

#include "mapping_common/parameters.h"
#include "mapping_common/testing/temp_dir.h"

namespace mapping_common {
namespace {

using XmlRpc::XmlRpcValue;

Parameters make() {
  XmlRpcValue all;
  all["rate"] = 40;
  all["name"] = std::string("front");
  all["model"]["range"] = 30.5;
  all["on"] = true;
  return Parameters(all);
}

std::string rejection(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(Parameters, ValuesAndFallbacks) {
  Parameters p = make();
  EXPECT_EQ(40, p.get("rate", 1));
  EXPECT_EQ(40.0, p.get("rate", 1.0));  // an integer is a number
  EXPECT_EQ(30.5, p.get("model/range", 1.0, 0.0, 100.0));
  EXPECT_TRUE(p.get("on", false));
  EXPECT_EQ("front", p.choice("name", "rear", {"front", "rear"}));
  EXPECT_EQ("40", p.get("rate", std::string()));  // roslaunch makes numbers of what looks like one
  EXPECT_EQ("x", p.get("other", std::string("x")));
}

TEST(Parameters, RejectionsNameParameterValueAndWhatIsAllowed) {
  Parameters p = make();
  EXPECT_TRUE(mentions(rejection([&] { p.get("model/range", 1.0, 0.0, 30.0); }),
                       {"~model/range", "30.5", "0 to 30"}));
  EXPECT_TRUE(mentions(rejection([&] { p.get("name", 1); }), {"~name", "front", "an integer"}));
  EXPECT_TRUE(mentions(rejection([&] { p.choice("name", "a", {"a", "b"}); }), {"~name", "'front'", "a, b"}));
}

TEST(Parameters, UnknownOnesAreRejected) {
  Parameters p = make();
  p.get("rate", 1);
  p.get("name", std::string());
  EXPECT_TRUE(mentions(rejection([&] { p.rejectUnknown({"model/"}); }), {"unknown: ~on;", "~name, ~rate"}));
  EXPECT_EQ("", rejection([&] { p.rejectUnknown({"model/", "on"}); }));
}

TEST(Parameters, MisspeltOnesAreGuessed) {
  XmlRpc::XmlRpcValue all;
  all["robust_kernal"] = "cauchy";
  all["odometry"] = true;
  Parameters p(all);
  p.get("robust_kernel", std::string());
  p.get("robust_scale", 1.0);
  EXPECT_TRUE(mentions(rejection([&] { p.rejectUnknown(); }),
                       {"unknown: ~odometry, ~robust_kernal (~robust_kernel?);"}));
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
