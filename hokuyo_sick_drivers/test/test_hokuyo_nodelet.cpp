// SPDX-License-Identifier: BSD-3-Clause
#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/nodelet_test.h>
#include <netinet/in.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/MultiEchoLaserScan.h>
#include <std_srvs/Trigger.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "fake_hokuyo.h"
#include "hokuyo_sick_drivers/connection.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::Recorder;
using mapping_common::waitFor;

int listenAt(std::uint16_t& port) {
  const int listener = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
  const int on = 1;
  setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  socklen_t size = sizeof(address);
  EXPECT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(listen(listener, 1), 0);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  port = ntohs(address.sin_port);
  return listener;
}

// The fake at a TCP port, in real time, from its construction to its destruction.
class FakeServer {
 public:
  using SetUp = std::function<void(FakeHokuyo&)>;
  explicit FakeServer(const SetUp& set_up) : FakeServer(0, set_up) {}
  explicit FakeServer(
      std::uint16_t port = 0, const SetUp& set_up = [](FakeHokuyo&) {})
      : port(port), listener_(listenAt(this->port)) {
    thread_ = std::thread([this, set_up] { run(set_up); });
  }
  ~FakeServer() {
    stop_ = true;
    thread_.join();
  }

  std::uint16_t port;

 private:
  void run(const SetUp& set_up) {
    FakeHokuyo device;
    set_up(device);
    std::unique_ptr<FileDescriptor> client;
    while (!stop_) {
      const int accepted = accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK);
      if (accepted >= 0) client = std::make_unique<FileDescriptor>(accepted);
      const Nanoseconds now = Connection::now();
      char buffer[256];
      const ssize_t size = client ? ::read(client->get(), buffer, sizeof(buffer)) : 0;
      if (size > 0) device.input({buffer, static_cast<std::size_t>(size)}, now);
      const std::string bytes = device.output(now);
      if (client) send(client->get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  FileDescriptor listener_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class HokuyoNodeletTest : public mapping_common::NodeletTest {
 protected:
  HokuyoNodeletTest() : NodeletTest("hokuyo_sick_drivers/HokuyoNodelet", "hokuyo") {
    setParam("ip_address", std::string("127.0.0.1"));
    setParam("frame_id", std::string("scanner"));
  }
  void connectTo(const FakeServer& server) { setParam("ip_port", static_cast<int>(server.port)); }

  bool hasStatus(std::uint8_t level, const std::string& words) const {
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.name == name_.substr(1) + ": Hardware Status" && status.level == level &&
            status.message.find(words) != std::string::npos)
          return true;
      }
    }
    return false;
  }
  void expectStatus(std::uint8_t level, const std::string& words) {
    EXPECT_TRUE(waitFor([&] { return hasStatus(level, words); })) << words;
  }
  std::size_t rays(const Recorder<sensor_msgs::LaserScan>& scans) const {
    return scans.messages.empty() ? 0 : scans.messages.back().ranges.size();
  }
};

TEST_F(HokuyoNodeletTest, publishesScans) {
  const FakeServer server;
  connectTo(server);
  Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return scans.messages.size() > 40; }));
  const auto& scan = scans.messages.back();
  EXPECT_EQ(scan.header.frame_id, "scanner");
  EXPECT_NEAR((ros::Time::now() - scan.header.stamp).toSec(), 0.5, 0.5);
  EXPECT_EQ(scan.ranges.size(), 1081u);
  EXPECT_EQ(scan.intensities.size(), 1081u);
  EXPECT_EQ(scan.intensities[7], 307.0f);
  EXPECT_NEAR(scan.ranges[7] - scan.ranges[0], 0.007, 1e-5);
  EXPECT_NEAR(scan.angle_min, -0.75 * M_PI, 1e-6);
  EXPECT_NEAR(scan.angle_max, 0.75 * M_PI, 1e-6);
  EXPECT_NEAR(scan.scan_time, 0.025, 1e-6);
  for (std::size_t i = 1; i < scans.messages.size(); ++i) {
    EXPECT_GT(scans.messages[i].header.stamp, scans.messages[i - 1].header.stamp);
  }
  expectDiagnostic("Hardware Status", "Vendor Name", "Hokuyo Automatic Co.,Ltd.");
  expectDiagnostic("Hardware Status", "Count: wrong lengths", "0");
  expectDiagnostic("Scans", "Expected rate (Hz)", "40.00");
}

TEST_F(HokuyoNodeletTest, publishesMultipleEchoes) {
  const FakeServer server;
  connectTo(server);
  setParam("publish_multiecho", true);
  ros::NodeHandle own(name_);
  Recorder<sensor_msgs::MultiEchoLaserScan> echoes(own, "echoes");
  Recorder<sensor_msgs::LaserScan> first(own, "first"), last(own, "last"), intense(own, "most_intense");
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return !echoes.messages.empty() && !intense.messages.empty(); }));
  const auto& message = echoes.messages.back();
  ASSERT_EQ(message.ranges.size(), 1081u);
  EXPECT_EQ(message.ranges[3].echoes.size(), 2u);
  EXPECT_EQ(message.ranges[4].echoes.size(), 1u);
  EXPECT_EQ(message.intensities[3].echoes[1], 903.0f);
  EXPECT_EQ(first.messages.back().intensities[3], 303.0f);
  EXPECT_EQ(last.messages.back().intensities[3], 903.0f);
  EXPECT_EQ(intense.messages.back().intensities[3], 903.0f);
}

TEST_F(HokuyoNodeletTest, changesWhileItRuns) {
  const FakeServer server;
  connectTo(server);
  Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  ASSERT_TRUE(load());
  ASSERT_TRUE(waitFor([&] { return rays(scans) == 1081; }));
  dynamic_reconfigure::Reconfigure change;
  change.request.config.ints.resize(1);
  change.request.config.ints[0].name = "cluster";
  change.request.config.ints[0].value = 4;
  ASSERT_TRUE(ros::service::call(name_ + "/set_parameters", change));
  EXPECT_TRUE(waitFor([&] { return rays(scans) == 270; }));

  // No ray lies there: refused, and everything stays as it is.
  change.request.config.ints.clear();
  change.request.config.doubles.resize(1);
  change.request.config.doubles[0].name = "angle_min";
  change.request.config.doubles[0].value = 3.0;
  ASSERT_TRUE(ros::service::call(name_ + "/set_parameters", change));
  for (const auto& value : change.response.config.doubles) {
    if (value.name == "angle_min") {
      EXPECT_LT(value.value, -3.0);
    }
  }
  scans.messages.clear();
  EXPECT_TRUE(waitFor([&] { return rays(scans) == 270; }));
}

TEST_F(HokuyoNodeletTest, tellsTheDevicesState) {
  const FakeServer server;
  connectTo(server);
  Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  ASSERT_TRUE(load());
  ASSERT_TRUE(scans.waitForOne());
  std_srvs::Trigger trigger;
  ASSERT_TRUE(ros::service::call(name_ + "/update_laser_status", trigger));
  EXPECT_TRUE(trigger.response.success);
  EXPECT_EQ(trigger.response.message, "Sensor works well.");
  ASSERT_TRUE(waitFor([&] { return scans.messages.size() > 40; }));
  const ros::Duration time = scans.messages.back().header.stamp - scans.messages.front().header.stamp;
  EXPECT_NEAR(time.toSec() / (scans.messages.size() - 1), 0.025, 0.002) << "scans between are missing";
}

TEST_F(HokuyoNodeletTest, tellsTroubleWhileItMeasures) {
  const FakeServer server([](FakeHokuyo& device) { device.state = "Trouble!! Error No. =[00->33]"; });
  connectTo(server);
  Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  ASSERT_TRUE(load());
  expectStatus(diagnostic_msgs::DiagnosticStatus::ERROR,
               "Measuring, but the device says: Trouble!! Error No. =[00->33]");
  EXPECT_FALSE(scans.messages.empty());
}

TEST_F(HokuyoNodeletTest, tellsWhyItDoesNotMeasure) {
  const FakeServer server([](FakeHokuyo& device) {
    device.state = "Trouble!! Error No. =[00->33]";
    device.statuses["ME"] = "0L";
  });
  connectTo(server);
  ASSERT_TRUE(load());
  expectStatus(
      diagnostic_msgs::DiagnosticStatus::ERROR,
      "Not measuring: the device doesn't start measuring, status 0L (abnormal state); the device says: "
      "Trouble!! Error No. =[00->33]");
}

TEST_F(HokuyoNodeletTest, advisesWhereIntensitiesStallTheDevice) {
  const FakeServer server([](FakeHokuyo& device) { device.stalls_beyond = 381; });
  connectTo(server);
  Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  ASSERT_TRUE(load());
  expectStatus(diagnostic_msgs::DiagnosticStatus::WARN, "Set cluster to 3");
  scans.messages.clear();
  ASSERT_TRUE(waitFor([&] { return scans.messages.size() > 40; }));
  EXPECT_TRUE(scans.messages.back().intensities.empty());
}

TEST_F(HokuyoNodeletTest, saysThatItIsConnectedEachTime) {
  auto server = std::make_unique<FakeServer>();
  connectTo(*server);
  const std::uint16_t port = server->port;
  const std::string name = "127.0.0.1:" + std::to_string(port);
  mapping_common::LogRecorder log(node_);
  ASSERT_TRUE(log.waitForLink());
  ASSERT_TRUE(load());
  for (std::size_t i = 1; i <= 3; ++i) {
    EXPECT_TRUE(waitFor([&] { return log.count("Connected to " + name) == i; })) << i;
    server.reset();  // a cable that is pulled, and put back
    EXPECT_TRUE(waitFor([&] { return log.count("Connection to " + name + " lost") == i; })) << i;
    server = std::make_unique<FakeServer>(port);
  }
}

// Their scans have topics of their own, nothing else needs one.
TEST_F(HokuyoNodeletTest, twoOfThemShareANamespace) {
  const FakeServer server, rear_server([](FakeHokuyo&device) { device.state = "Stable 000 no error."; });
  connectTo(server);
  ASSERT_TRUE(load());
  const std::string rear = "/" + test_ + "/rear";
  ros::param::set(rear + "/ip_address", std::string("127.0.0.1"));
  ros::param::set(rear + "/ip_port", static_cast<int>(rear_server.port));
  ros::param::set(rear + "/publish_multiecho", true);
  nodelet::NodeletLoad load_rear;
  load_rear.request.name = rear;
  load_rear.request.type = type_;
  load_rear.request.remap_source_args = {"/" + test_ + "/scan"};
  load_rear.request.remap_target_args = {"/" + test_ + "/rear_scan"};
  ASSERT_TRUE(ros::service::call("/manager/load_nodelet", load_rear) && load_rear.response.success);

  ros::NodeHandle front_node(name_), rear_node(rear);
  Recorder<sensor_msgs::MultiEchoLaserScan> front_echoes(front_node, "echoes"),
      rear_echoes(rear_node, "echoes");
  Recorder<sensor_msgs::LaserScan> shared_scans(node_, "scan"), rear_scans(node_, "rear_scan");
  ASSERT_TRUE(waitFor([&] {
    return front_echoes.messages.size() > 3 && rear_echoes.messages.size() > 3 &&
           !shared_scans.messages.empty() && !rear_scans.messages.empty();
  }));
  for (const auto& message : front_echoes.messages) EXPECT_EQ(message.ranges[3].echoes.size(), 1u);
  for (const auto& message : rear_echoes.messages) EXPECT_EQ(message.ranges[3].echoes.size(), 2u);
  for (const auto& [of, state] :
       {std::pair(name_, "Sensor works well."), std::pair(rear, "Stable 000 no error.")}) {
    std_srvs::Trigger trigger;
    ASSERT_TRUE(ros::service::call(of + "/update_laser_status", trigger));
    EXPECT_EQ(trigger.response.message, state);
  }
  nodelet::NodeletUnload unload_rear;
  unload_rear.request.name = rear;
  EXPECT_TRUE(ros::service::call("/manager/unload_nodelet", unload_rear));
}

TEST_F(HokuyoNodeletTest, hasUrgNodesNamesWhereRemapped) {
  const FakeServer server;
  connectTo(server);
  Recorder<sensor_msgs::LaserScan> first(node_, "first");
  ASSERT_TRUE(load({name_ + "/first", name_ + "/update_laser_status"},
                   {"/" + test_ + "/first", "/" + test_ + "/update_laser_status"}));
  EXPECT_TRUE(first.waitForOne());
  std_srvs::Trigger trigger;
  EXPECT_TRUE(ros::service::call("/" + test_ + "/update_laser_status", trigger));
}

TEST_F(HokuyoNodeletTest, waitsForTheDeviceAndComesBack) {
  auto server = std::make_unique<FakeServer>();
  connectTo(*server);
  const std::uint16_t port = server->port;
  server.reset();
  Recorder<sensor_msgs::LaserScan> scans(node_, "scan");
  ASSERT_TRUE(load());
  EXPECT_TRUE(waitFor([&] { return !diagnostics_.messages.empty(); }));
  for (int i = 0; i < 2; ++i) {
    server = std::make_unique<FakeServer>(port);
    scans.messages.clear();
    EXPECT_TRUE(scans.waitForOne());
    server.reset();
  }
  EXPECT_TRUE(waitFor([&] {
    const std::string count = diagnostic("Hardware Status", "Count: reconnects");
    return !count.empty() && count != "0";
  }));
}

TEST_F(HokuyoNodeletTest, acceptsTheConfigurationThatShips) {
  EXPECT_TRUE(load());
}

TEST_F(HokuyoNodeletTest, rejectsAnglesTheWrongWayRound) {
  setParam("angle_min", 1.0);
  setParam("angle_max", -1.0);
  EXPECT_FALSE(load());
}

TEST_F(HokuyoNodeletTest, rejectsClusterOutOfRange) {
  setParam("cluster", 100);
  EXPECT_FALSE(load());
}

TEST_F(HokuyoNodeletTest, rejectsUnknownParameter) {
  setParam("ip_adress", std::string("127.0.0.1"));
  EXPECT_FALSE(load());
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_hokuyo_nodelet");
  return RUN_ALL_TESTS();
}
