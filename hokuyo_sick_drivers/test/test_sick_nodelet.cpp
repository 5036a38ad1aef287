// SPDX-License-Identifier: BSD-3-Clause
//
// What the nodelet does with bad parameters and without a device.
#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/nodelet_test.h>
#include <sensor_msgs/LaserScan.h>

#include <string>

namespace hokuyo_sick_drivers {
namespace {

class SickNodelet : public mapping_common::NodeletTest {
 protected:
  SickNodelet() : mapping_common::NodeletTest("hokuyo_sick_drivers/SickNodelet", "sick") {
    setParam("port", std::string("/dev/there_is_no_such_port"));
  }

  void expectRefused(const std::string& what) {
    const std::string why = whyNotLoaded();
    EXPECT_NE(std::string::npos, why.find(what)) << why;
  }
  std::string summary() const {
    std::string text;
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.name.find(name_.substr(1) + ": Device") != std::string::npos) text = status.message;
      }
    }
    return text;
  }
};

TEST_F(SickNodelet, SaysThatThereIsNoDevice) {
  ASSERT_TRUE(load());
  EXPECT_TRUE(mapping_common::waitFor([this] {
    return summary().find("Not connected: can't open /dev/there_is_no_such_port") == 0;
  })) << summary();
  expectDiagnostic("Device", "Serial Port", "/dev/there_is_no_such_port");
  expectDiagnostic("Device", "Scans", "0");
  mapping_common::Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  mapping_common::spinFor(1.0);
  EXPECT_TRUE(scans.messages.empty());
  unload();
  EXPECT_TRUE(load());
}

TEST_F(SickNodelet, LoadsTheConfigurationThatShips) {
  ASSERT_TRUE(ros::param::has(name_ + "/use_rep_117"));
  EXPECT_TRUE(load());
}

TEST_F(SickNodelet, ReconfiguresWithoutADevice) {
  ASSERT_TRUE(load());
  dynamic_reconfigure::Reconfigure call;
  call.request.config.doubles.resize(1);
  call.request.config.doubles[0].name = "time_offset";
  call.request.config.doubles[0].value = 0.25;
  ASSERT_TRUE(ros::service::waitForService(name_ + "/set_parameters", ros::Duration(10.0)));
  ASSERT_TRUE(ros::service::call(name_ + "/set_parameters", call));
  expectDiagnostic("Device", "User Time Offset", "0.2500");
}

TEST_F(SickNodelet, RefusesAnUnknownRate) {
  setParam("baud", 115200);
  expectRefused("115200");
}

TEST_F(SickNodelet, RefusesAMisspeltParameter) {
  setParam("intensities", std::string("normalised"));
  expectRefused("~intensities");
}

TEST_F(SickNodelet, RefusesAnUnknownWord) {
  setParam("intensity", std::string("loud"));
  expectRefused("~intensity is 'loud', allowed is none | normalised | direct");
}

TEST_F(SickNodelet, RefusesWhatDoesNotFitInATelegram) {
  setParam("intensity", std::string("normalised"));
  setParam("angle", 180);
  setParam("resolution", 0.5);
  expectRefused("361 values with intensities don't fit in a telegram");
}

TEST_F(SickNodelet, RefusesPartialScansWithIntensities) {
  setParam("intensity", std::string("direct"));
  setParam("angle", 180);
  setParam("resolution", 1.0);
  setParam("interlaced", true);
  expectRefused("interlaced");
}

TEST_F(SickNodelet, RefusesAnOffsetOutOfRange) {
  setParam("time_offset", 5.0);
  expectRefused("~time_offset is 5, allowed is -1 to 1");
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_sick_nodelet");
  ros::NodeHandle node;  // keeps ROS up between the tests
  return RUN_ALL_TESTS();
}
