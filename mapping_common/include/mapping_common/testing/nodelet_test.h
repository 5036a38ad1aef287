// SPDX-License-Identifier: BSD-3-Clause
//
// For tests of nodelets: a nodelet in the manager /manager, a namespace for each test, and what it takes to
// watch it.
#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/slowness.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Log.h>

#include <functional>
#include <string>
#include <vector>

namespace mapping_common {

/// Lets callbacks run until the condition holds. @param seconds, under sanitizers kSlowness times as many
/// @return false if it didn't in time
inline bool waitFor(const std::function<bool()>& condition, double seconds = 60.0) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds * kSlowness);
  while (ros::ok()) {
    ros::spinOnce();
    if (condition()) return true;
    if (ros::WallTime::now() > end) return false;
    ros::WallDuration(0.01).sleep();
  }
  return false;
}

inline void spinFor(double seconds) {
  waitFor([] { return false; }, seconds / kSlowness);
}

/// All messages of a topic.
template <class Message>
class Recorder {
 public:
  Recorder(ros::NodeHandle& node, const std::string& topic)
      : subscriber_(node.subscribe<Message>(
            topic, 1000,
            [this](const boost::shared_ptr<const Message>& message) { messages.push_back(*message); })) {}
  bool waitForOne(double seconds = 60.0) {
    const std::size_t before = messages.size();
    return waitFor([&] { return messages.size() > before; }, seconds);
  }
  std::vector<Message> messages;

 private:
  ros::Subscriber subscriber_;
};

/// Its nodelet is /<name of the test>/<nodelet_name>; topics are in /<name of the test>.
class NodeletTest : public ::testing::Test {
 protected:
  NodeletTest(const std::string& type, const std::string& nodelet_name)
      : test_(::testing::UnitTest::GetInstance()->current_test_info()->name()),
        node_("/" + test_),
        name_("/" + test_ + "/" + nodelet_name),
        type_(type),
        diagnostics_(node_, "/diagnostics") {}
  ~NodeletTest() override { unload(); }

  template <class T>
  void setParam(const std::string& parameter, const T& value) {
    ros::param::set(name_ + "/" + parameter, value);
  }

  bool load(const std::vector<std::string>& remap_from = {}, const std::vector<std::string>& remap_to = {}) {
    nodelet::NodeletLoad load;
    load.request.name = name_;
    load.request.type = type_;
    load.request.remap_source_args = remap_from;
    load.request.remap_target_args = remap_to;
    EXPECT_TRUE(ros::service::waitForService("/manager/load_nodelet", ros::Duration(60.0)));
    loaded_ = ros::service::call("/manager/load_nodelet", load) && load.response.success;
    return loaded_;
  }
  void unload() {
    nodelet::NodeletUnload unload;
    unload.request.name = name_;
    if (loaded_) ros::service::call("/manager/unload_nodelet", unload);
    loaded_ = false;
  }

  /// Loads the nodelet, which has to fail. @return what the manager's last fatal message said
  std::string whyNotLoaded() {
    Recorder<rosgraph_msgs::Log> log(node_, "/rosout");
    spinFor(0.5);  // to be connected, and past what was said before
    log.messages.clear();
    EXPECT_FALSE(load());
    std::string text;
    EXPECT_TRUE(waitFor([&] {
      for (const rosgraph_msgs::Log& message : log.messages) {
        if (message.level == rosgraph_msgs::Log::FATAL && message.name == "/manager") text = message.msg;
      }
      return !text.empty();
    }));
    return text;
  }

  /// The latest value of the nodelet's diagnostics, empty before there is any.
  /// @param status_name the end of the status's name, after "<nodelet>: "
  std::string diagnostic(const std::string& status_name, const std::string& key) const {
    std::string value;
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.name.find(name_.substr(1) + ": " + status_name) == std::string::npos) continue;
        for (const auto& pair : status.values) {
          if (pair.key == key) value = pair.value;
        }
      }
    }
    return value;
  }
  void expectDiagnostic(const std::string& status, const std::string& key, const std::string& value) {
    EXPECT_TRUE(waitFor([&] { return diagnostic(status, key) == value; }))
        << key << " is " << diagnostic(status, key) << ", expected " << value;
  }

  const std::string test_;
  ros::NodeHandle node_;
  const std::string name_, type_;
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics_;
  bool loaded_ = false;
};

}  // namespace mapping_common
