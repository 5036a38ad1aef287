// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "mapping_common/stamps.h"

namespace mapping_common {
namespace {

using Order = Stamps::Order;

TEST(Stamps, GoOn) {
  Stamps stamps;
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(100.0)));
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(100.0)));
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(1e9)));
  EXPECT_EQ(Order::kLate, stamps.check("laser", ros::Time(1e9 - 0.5)));
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time()));  // says nothing
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(1e9)));
}

TEST(Stamps, ExtremeOnesAreRefusedAndForgotten) {
  Stamps stamps;
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(1e9)));
  for (const std::uint32_t second : {Stamps::kLastSecond + 1, 4000000000U, 4294967295U}) {
    EXPECT_THROW(stamps.check("laser", ros::Time(second, 999999999)), std::invalid_argument);
  }
  try {
    Stamps::require(ros::Time(4000000000U), "its stamp");
    ADD_FAILURE();
  } catch (const std::invalid_argument& e) {
    EXPECT_STREQ("its stamp is 4000000000 s, after 2038", e.what());
  }
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(1e9 + 0.1)));
  // The greatest difference.
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(Stamps::kLastSecond, 999999999)));
  EXPECT_EQ(Order::kJumpedBack, stamps.check("laser", ros::Time(0, 1)));
  EXPECT_NEAR(Stamps::kLastSecond + 1.0, stamps.jump(), 1e-6);
}

TEST(Stamps, AJumpIsSaidOnce) {
  Stamps stamps;
  for (const char* sensor : {"laser", "lidar"}) stamps.check(sensor, ros::Time(200.0));
  EXPECT_EQ(Order::kJumpedBack, stamps.check("lidar", ros::Time(100.0)));
  EXPECT_EQ(100.0, stamps.jump());
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(100.0)));
  EXPECT_EQ(Order::kNext, stamps.check("lidar", ros::Time(100.1)));
}

TEST(Stamps, AShortJumpIsToldFromALateMessage) {
  Stamps stamps;
  stamps.check("laser", ros::Time(100.0));
  EXPECT_EQ(Order::kLate, stamps.check("laser", ros::Time(98.0)));
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(100.1)));
  EXPECT_EQ(Order::kLate, stamps.check("laser", ros::Time(98.1)));
  EXPECT_EQ(Order::kJumpedBack, stamps.check("laser", ros::Time(98.2)));
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(98.3)));
}

TEST(Stamps, ALateSensorIsNoJump) {
  Stamps stamps;
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(Order::kNext, stamps.check("early", ros::Time(100.0 + 0.1 * i)));
    EXPECT_EQ(Order::kNext, stamps.check("late", ros::Time(98.5 + 0.1 * i)));
  }
  // Nor where both have the same name.
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(Order::kNext, stamps.check("one", ros::Time(100.0 + 0.1 * i)));
    EXPECT_EQ(Order::kLate, stamps.check("one", ros::Time(98.5 + 0.1 * i)));
  }
}

TEST(Stamps, SensorsWithoutEndAreForgotten) {
  Stamps stamps;
  stamps.check("first", ros::Time(200.0));
  for (int i = 0; i < 10000; ++i) stamps.check(std::to_string(i), ros::Time(200.0));
  EXPECT_EQ(Order::kNext, stamps.check("first", ros::Time(100.0)));
}

TEST(Stamps, TheSimulatedClockTells) {
  ros::Time::setNow(ros::Time(100.0));
  Stamps stamps;
  EXPECT_EQ(Order::kNext, stamps.check("laser", ros::Time(100.0)));
  ros::Time::setNow(ros::Time(99.5));
  EXPECT_EQ(Order::kJumpedBack, stamps.check("laser", ros::Time(99.5)));
  EXPECT_EQ(0.5, stamps.jump());
}

}  // namespace
}  // namespace mapping_common

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::Time::init();
  return RUN_ALL_TESTS();
}
