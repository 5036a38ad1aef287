// SPDX-License-Identifier: BSD-3-Clause
//
// The nodelets in this process, the emulators' programs in others, real ports and real time in between.
// LIVE_SECONDS (default 4) makes a soak of it, LIVE_BAG and LIVE_TOPIC have the Hokuyo see a bag's scans.
#include <gtest/gtest.h>
#include <mapping_common/testing/nodelet_test.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/slowness.h>
#include <mapping_common/testing/temp_dir.h>
#include <nodelet/loader.h>
#include <ros/callback_queue.h>
#include <sensor_msgs/LaserScan.h>
#include <sys/resource.h>

#include <fstream>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

#include "program.h"
#include "round_trip.h"

namespace hokuyo_sick_drivers {
namespace {

using device_emulators::Program;
using mapping_common::findRecording;
using mapping_common::TempDir;
using mapping_common::waitFor;
using mapping_common::withoutRecording;

const double kSeconds = static_cast<double>(environment("LIVE_SECONDS", 4));

double cpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

/// What the emulator sent.
std::vector<device_emulators::SentScan> readTruth(const std::string& path) {
  std::vector<device_emulators::SentScan> scans;
  std::ifstream file(path);
  std::string line, field;
  std::getline(file, line);
  const auto list = [&](std::istream& fields, std::vector<std::uint32_t>& values) {
    std::getline(fields, field, ',');
    std::istringstream numbers(field);
    for (std::uint32_t value; numbers >> value;) values.push_back(value);
  };
  while (std::getline(file, line)) {
    std::istringstream fields(line);
    device_emulators::SentScan scan;
    std::getline(fields, field, ',');
    const std::size_t dot = field.find('.');
    scan.start = std::stoll(field.substr(0, dot)) * kSecond + std::stoll(field.substr(dot + 1));
    std::getline(fields, field, ',');
    std::getline(fields, field, ',');
    scan.first_step = std::stoi(field);
    std::getline(fields, field, ',');
    scan.cluster = std::stoi(field);
    std::getline(fields, field, ',');
    scan.resolution = std::stod(field);
    std::getline(fields, scan.fault, ',');
    list(fields, scan.ranges);
    list(fields, scan.intensities);
    scans.push_back(scan);
  }
  return scans;
}

class LiveRoundTrip : public testing::Test {
 protected:
  LiveRoundTrip()
      : test_(testing::UnitTest::GetInstance()->current_test_info()->name()),
        name_("/" + test_ + "/driver"),
        node_("/" + test_) {
    subscriber_ = node_.subscribe<sensor_msgs::LaserScan>(
        "scan", 1000, [this](const sensor_msgs::LaserScan::ConstPtr& scan) { scans_.push_back(scan); });
  }

  /// Loads the nodelet and lets it run.
  void run(const std::string& type) {
    nodelet::Loader loader(false);
    ASSERT_TRUE(loader.load(name_, "hokuyo_sick_drivers/" + type, {}, {}));
    // What it takes a busy machine to start isn't measured.
    ASSERT_TRUE(waitFor([this] { return scans_.size() > 5; }, 60.0));
    const double cpu = cpuSeconds();
    const ros::WallTime start = ros::WallTime::now();
    while (ros::WallTime::now() - start < ros::WallDuration(kSeconds)) {
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.2));
    }
    const double seconds = (ros::WallTime::now() - start).toSec();
    cpu_ = (cpuSeconds() - cpu) / seconds;
    loader.unload(name_);
    ros::spinOnce();
    // By stamps, as it is the device's: scans may arrive late where a machine has other work.
    rate_ = static_cast<double>(scans_.size() - 1) /
            (scans_.back()->header.stamp - scans_.front()->header.stamp).toSec();
  }

  /// @param expected makes of a scan as the emulator knows it one as it is to be published
  template <class Expected>
  void compare(const std::string& truth, Nanoseconds period, Expected expected) {
    Comparison comparison(period);
    ASSERT_FALSE(scans_.empty());
    const auto first = static_cast<Nanoseconds>(scans_.front()->header.stamp.toNSec());
    const auto last = static_cast<Nanoseconds>(scans_.back()->header.stamp.toNSec());
    for (const auto& sent : readTruth(truth)) {
      const ExpectedScan scan = expected(sent);
      // What was on its way when the driver came or left doesn't count.
      if (scan.stamp > first - period / 2 && scan.stamp < last + period / 2) comparison.sent(scan);
    }
    for (const auto& scan : scans_)
      comparison.received(
          {static_cast<Nanoseconds>(scan->header.stamp.toNSec()), scan->ranges, scan->intensities});
    comparison.finish(last + 10 * period);
    EXPECT_EQ(0u, comparison.wrong);
    EXPECT_EQ(0u, comparison.invented);
    // A driver that sanitizers slow down can't take each scan that a device sends.
    if (mapping_common::kSlowness == 1.0) {
      EXPECT_EQ(0u, comparison.lost);
    }
    std::vector<double> errors = comparison.stamp_errors;
    for (double& e : errors) e = std::abs(e);
    std::sort(errors.begin(), errors.end());
    std::printf(
        "%s: %zu scans, %.2f Hz, %.1f %% of a core, stamps within %.3f ms (99 %%: %.3f, median %.3f)\n",
        test_.c_str(), scans_.size(), rate_, 100.0 * cpu_, errors.back(), errors[errors.size() * 99 / 100],
        errors[errors.size() / 2]);
    // A machine with other work may put a thread aside for longer than the jitter that there is.
    EXPECT_LT(errors[errors.size() / 2], 1.0);
  }

  template <class T>
  void setParam(const std::string& name, const T& value) {
    ros::param::set(name_ + "/" + name, value);
  }

  /// A Hokuyo over TCP that sees what is in a bag, or a room.
  void hokuyo(const std::vector<std::string>& source) {
    const int port = device_emulators::freePort();
    std::vector<std::string> arguments{HOKUYO_EMULATOR,
                                       "--tcp",
                                       std::to_string(port),
                                       "--model",
                                       "UTM-30LX-EW",
                                       "--truth",
                                       dir_.path("truth.csv"),
                                       "--jitter-ms",
                                       "5",
                                       "--drift-ppm",
                                       "100",
                                       "--start-ms",
                                       "16774000"};
    arguments.insert(arguments.end(), source.begin(), source.end());
    Program emulator(arguments);
    ASSERT_TRUE(emulator.isReady());
    setParam("ip_address", "127.0.0.1");
    setParam("ip_port", port);
    ASSERT_NO_FATAL_FAILURE(run("HokuyoNodelet"));
    emulator.stop();
    EXPECT_EQ(0, emulator.status());
    compare(dir_.path("truth.csv"), 25 * kMillisecond, expectedHokuyo);
    if (mapping_common::kSlowness == 1.0) {
      EXPECT_NEAR(40.0, rate_, 2.0);
    }
    for (const auto& scan : scans_) ASSERT_EQ(1081u, scan->ranges.size());
  }

  const std::string test_, name_;
  ros::NodeHandle node_;
  ros::Subscriber subscriber_;
  std::vector<sensor_msgs::LaserScan::ConstPtr> scans_;
  TempDir dir_;
  double cpu_ = 0.0, rate_ = 0.0;
};

TEST_F(LiveRoundTrip, Hokuyo) {
  const char *bag = std::getenv("LIVE_BAG"), *topic = std::getenv("LIVE_TOPIC");
  std::vector<std::string> source;
  if (bag != nullptr) source = {"--bag", bag, "--topic", topic != nullptr ? topic : "/scan"};
  hokuyo(source);
  EXPECT_EQ(1081u, scans_.front()->intensities.size());
}

TEST_F(LiveRoundTrip, HokuyoOfRecordedScans) {
  const std::string name = "rosbags_2d/hokuyo_721.bag", bag = findRecording(name);
  if (bag.empty()) GTEST_SKIP() << withoutRecording(name);
  hokuyo({"--bag", bag, "--topic", "/scan"});
}

TEST_F(LiveRoundTrip, HokuyoOfRecordedIntensities) {
  const std::string name = "sick_tim781s_rssi/tim781s_static_a.bag", bag = findRecording(name);
  if (bag.empty()) GTEST_SKIP() << withoutRecording(name);
  hokuyo({"--bag", bag, "--topic", "/scan"});
}

TEST_F(LiveRoundTrip, SickWithIntensities) {
  Program emulator({SICK_EMULATOR, "--pty", dir_.path("tty"), "--truth", dir_.path("truth.csv")});
  ASSERT_TRUE(emulator.isReady());
  setParam("port", dir_.path("tty"));
  setParam("baud", 500000);
  setParam("angle", 180);
  setParam("resolution", 1.0);
  setParam("intensity", std::string("normalised"));
  setParam("realtime_index", std::string("enabled"));
  ASSERT_NO_FATAL_FAILURE(run("SickNodelet"));
  emulator.stop();
  EXPECT_EQ(0, emulator.status());
  compare(dir_.path("truth.csv"), kSecond / 75,
          [](const device_emulators::SentScan& sent) { return expectedSick(sent, 0x1FFF); });
  for (const auto& scan : scans_) ASSERT_EQ(181u, scan->intensities.size());
}

}  // namespace
}  // namespace hokuyo_sick_drivers

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_live_round_trip");
  ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
