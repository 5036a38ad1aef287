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
#include <ros/master.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <rosgraph_msgs/Log.h>
#include <xmlrpcpp/XmlRpc.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
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

/// Which side of a topic the manager is.
enum class Link { kPublishes, kSubscribes };

/// Whether the manager is linked with this process by a topic, as it sees it itself: it learns of a
/// subscriber or of a publisher later than that learns of it.
inline bool isLinked(const std::string& topic, Link link) {
  XmlRpc::XmlRpcValue request, response, uri, name, reply;
  request[0] = name[0] = ros::this_node::getName();
  request[1] = "/manager";
  std::string host;
  std::uint32_t port = 0;
  if (!ros::master::execute("lookupNode", request, response, uri, false) ||
      !ros::network::splitURI(uri, host, port))
    return false;
  XmlRpc::XmlRpcClient manager(host.c_str(), static_cast<int>(port));
  if (!manager.execute("getBusInfo", name, reply) || reply.size() < 3) return false;
  XmlRpc::XmlRpcValue& links = reply[2];
  for (int i = 0; i < links.size(); ++i) {
    const bool publishes = static_cast<std::string&>(links[i][2]) == "o";
    if (publishes != (link == Link::kPublishes) || static_cast<std::string&>(links[i][4]) != topic) continue;
    const std::string& other = links[i][1];
    if (other == (publishes ? ros::this_node::getName() : ros::XMLRPCManager::instance()->getServerURI()))
      return true;
  }
  return false;
}
/// Waits for that.
template <class PublisherOrSubscriber>
bool waitForLink(const PublisherOrSubscriber& of) {
  constexpr Link kLink =
      std::is_same_v<PublisherOrSubscriber, ros::Publisher> ? Link::kSubscribes : Link::kPublishes;
  return waitFor([&] { return isLinked(of.getTopic(), kLink); });
}

/// All messages of a topic.
template <class Message>
class Recorder {
 public:
  Recorder(ros::NodeHandle& node, const std::string& topic)
      : subscriber_(node.subscribe<Message>(
            topic, 1000,
            [this](const boost::shared_ptr<const Message>& message) { messages.push_back(*message); })) {}
  /// Until the manager publishes to it.
  bool waitForLink() const { return mapping_common::waitForLink(subscriber_); }
  bool waitForOne(double seconds = 60.0) {
    const std::size_t before = messages.size();
    return waitFor([&] { return messages.size() > before; }, seconds);
  }
  std::vector<Message> messages;

 private:
  ros::Subscriber subscriber_;
};

/// What the manager and other nodes say.
class LogRecorder : public Recorder<rosgraph_msgs::Log> {
 public:
  explicit LogRecorder(ros::NodeHandle& node) : Recorder(node, "/rosout") {
    // All of a process share a connection as long as there is one. The manager learns late that the last is
    // gone, and would seem to be linked with the next when it isn't yet.
    static const ros::Subscriber stays = node.subscribe<rosgraph_msgs::Log>(
        "/rosout", 1, +[](const rosgraph_msgs::Log::ConstPtr&) {});
  }
  /// How often something with these words was said.
  std::size_t count(const std::string& words) const {
    return static_cast<std::size_t>(
        std::count_if(messages.begin(), messages.end(), [&words](const rosgraph_msgs::Log& message) {
          return message.msg.find(words) != std::string::npos;
        }));
  }
  bool waitFor(const std::string& words) const {
    return mapping_common::waitFor([&] { return count(words) > 0; });
  }
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
    LogRecorder log(node_);
    EXPECT_TRUE(log.waitForLink());
    const ros::Time start = ros::Time::now();  // what was said before may still be on its way
    EXPECT_FALSE(load());
    std::string text;
    EXPECT_TRUE(waitFor([&] {
      for (const rosgraph_msgs::Log& message : log.messages) {
        if (message.level == rosgraph_msgs::Log::FATAL && message.name == "/manager" &&
            message.header.stamp >= start)
          text = message.msg;
      }
      return !text.empty();
    }));
    return text;
  }

  /// All values of the nodelet's diagnostics.
  /// @param status_name the end of the status's name, after "<nodelet>: "
  std::vector<std::string> diagnostics(const std::string& status_name, const std::string& key) const {
    std::vector<std::string> values;
    for (const auto& message : diagnostics_.messages) {
      for (const auto& status : message.status) {
        if (status.name.find(name_.substr(1) + ": " + status_name) == std::string::npos) continue;
        for (const auto& pair : status.values) {
          if (pair.key == key) values.push_back(pair.value);
        }
      }
    }
    return values;
  }
  /// The latest of them, empty before there is any.
  std::string diagnostic(const std::string& status_name, const std::string& key) const {
    const std::vector<std::string> values = diagnostics(status_name, key);
    return values.empty() ? "" : values.back();
  }
  void expectDiagnostic(const std::string& status, const std::string& key, const std::string& value) {
    EXPECT_TRUE(waitFor([&] { return diagnostic(status, key) == value; }))
        << key << " is " << diagnostic(status, key) << ", expected " << value;
  }
  /// Waits until what was published has come to its end: from now on a frequency is 0.0 three times in a row.
  void expectQuiet(const std::string& status, const std::string& frequency) {
    diagnostics_.messages.clear();
    EXPECT_TRUE(waitFor([&] {
      const std::vector<std::string> values = diagnostics(status, frequency);
      return values.size() >= 3 &&
             std::all_of(values.end() - 3, values.end(), [](const auto& value) { return value == "0.0"; });
    })) << frequency
        << " is " << diagnostic(status, frequency);
  }

  const std::string test_;
  ros::NodeHandle node_;
  const std::string name_, type_;
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics_;
  bool loaded_ = false;
};

}  // namespace mapping_common
