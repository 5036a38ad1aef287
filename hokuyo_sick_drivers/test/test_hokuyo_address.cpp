// SPDX-License-Identifier: BSD-3-Clause
//
// Setting the address of an emulated scanner.
#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <string>

#include "device_link.h"
#include "hokuyo_device.h"
#include "hokuyo_sick_drivers/hokuyo_address.h"

namespace hokuyo_sick_drivers {
namespace {

using device_emulators::HokuyoDevice;
using device_emulators::HokuyoOptions;

const HokuyoAddress kWanted = {"192.168.0.11", "255.255.255.0", "192.168.0.1"};

std::shared_ptr<device_emulators::ScanSource> room() {
  return std::make_shared<device_emulators::RoomSource>();
}

TEST(HokuyoAddressTest, command) {
  EXPECT_EQ(kWanted.command(), "$IP192168000011255255255000192168000001");
  EXPECT_EQ((HokuyoAddress{"10.0.0.3", "255.0.0.0", "10.255.255.254"}.command()),
            "$IP010000000003255000000000010255255254");
}

TEST(HokuyoAddressTest, refusesWhatWouldCutTheScannerOff) {
  const auto why = [](const HokuyoAddress& address) -> std::string {
    try {
      address.command();
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(why({"192.168.0", "255.255.255.0", "192.168.0.1"}).find("the address is '192.168.0'"),
            std::string::npos);
  EXPECT_NE(why({"192.168.0.256", "255.255.255.0", "192.168.0.1"}).find("the address"), std::string::npos);
  EXPECT_NE(why({"192.168.0.11", "255.255.0.255", "192.168.0.1"}).find("the netmask"), std::string::npos);
  EXPECT_NE(why({"192.168.0.255", "255.255.255.0", "192.168.0.1"}).find("whole network"), std::string::npos);
  EXPECT_NE(why({"192.168.0.11", "255.255.255.0", "192.168.1.1"}).find("the gateway"), std::string::npos);
  EXPECT_NE(why({"192.168.0.11", "255.255.255.0", "192.168.0.11"}).find("the gateway"), std::string::npos);
}

TEST(HokuyoAddressTest, isSetWhileTheScannerMeasures) {
  HokuyoOptions options("UST-10LX");
  options.streaming = true;
  HokuyoDevice device(options, room());
  HokuyoAddressSetter setter(kWanted);
  DeviceLink link(setter, device, 0);
  link.runUntil(3 * kSecond);
  EXPECT_TRUE(setter.finished());
  EXPECT_EQ(setter.problem(), "");
  EXPECT_EQ(device.storedAddress(), "192168000011255255255000192168000001");
}

TEST(HokuyoAddressTest, isRefusedByAScannerWithoutEthernet) {
  HokuyoDevice device(HokuyoOptions("UTM-30LX"), room());
  HokuyoAddressSetter setter(kWanted);
  DeviceLink link(setter, device, 0);
  link.runUntil(3 * kSecond);
  EXPECT_TRUE(setter.finished());
  EXPECT_EQ(setter.problem(), "the scanner refuses the address, status 0E");
}

TEST(HokuyoAddressTest, givesUpWhereNothingAnswers) {
  HokuyoAddressSetter setter(kWanted);
  setter.connected(0);
  EXPECT_EQ(setter.deadline(), 5 * kSecond);
  setter.tick(5 * kSecond);
  EXPECT_TRUE(setter.finished());
  EXPECT_EQ(setter.problem(), "the scanner doesn't answer QT");
}

}  // namespace
}  // namespace hokuyo_sick_drivers
