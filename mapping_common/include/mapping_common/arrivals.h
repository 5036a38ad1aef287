// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <mapping_common/callback_guard.h>
#include <mapping_common/stamps.h>
#include <mapping_common/transform_queue.h>
#include <ros/ros.h>

#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace mapping_common {

/// Messages that were dropped: they are counted by reason, and a warning says why, for each reason only every
/// few seconds.
class Drops {
 public:
  struct Options {
    std::string name;                           ///< of the nodelet
    std::string warning = "Dropped a message";  ///< how warnings begin
    std::string key = "Dropped";                ///< how the keys of the diagnostics begin
    std::vector<std::string> reasons;           ///< in the order in which they are listed
  };
  explicit Drops(Options options);

  /// @param reason one of the options'
  /// @param why e.g. "its stamp is 4294967295 s, after 2038"; empty: nothing is said
  void add(const std::string& reason, const std::string& why, std::size_t count = 1);
  /// Since the last call of `endReport`.
  std::size_t recent() const { return recent_; }
  void endReport() { recent_ = 0; }
  /// e.g. "3 no transform, 0 malformed"
  std::string text() const;
  /// One value for each reason, named e.g. "Dropped: malformed".
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  Options options_;
  std::map<std::string, std::size_t> counts_;
  std::map<std::string, Throttle> throttles_;
  std::size_t recent_ = 0;
};

/// What arrives at a nodelet. Stamps are checked, jumps of time noticed, messages wait for their transforms,
/// and those that are dropped are counted.
class Arrivals {
 public:
  using Transforms = TransformQueue::Transforms;
  // Why messages are dropped here.
  static constexpr const char *kNoTransform = "no transform", *kMalformed = "malformed",
                              *kTimeJump = "time jump", *kLate = "out of order";
  struct Options {
    Drops::Options drops;  ///< its reasons are put after those of this class
    TransformQueue::Options transforms;
    bool in_order = false;  ///< messages earlier than the one before of their sensor are dropped
  };

  /// Callbacks come with those of the node.
  /// @param jumped_back called when time has jumped back, with the first stamp from then on; messages and
  ///   transforms of before are forgotten then
  Arrivals(const ros::NodeHandle& node, std::shared_ptr<CallbackGuard> guard, const Options& options,
           std::function<void(const ros::Time&)> jumped_back);

  /// @param label what the diagnostics call the messages, e.g. "Clouds"
  /// @param process gets each message with its transforms; where it throws std::invalid_argument, the message
  ///   is malformed
  /// @param with_other whether the second transform is asked for
  /// @param sweep_of when a message was measured, if that counts; where it throws std::invalid_argument, the
  ///   message is malformed
  template <class Message>
  ros::Subscriber subscribe(const std::string& topic, int queue_size, const std::string& label,
                            std::function<void(const Message&, const Transforms&)> process,
                            bool with_other = true,
                            std::function<SweepTimes(const Message&)> sweep_of = nullptr);
  /// A message that came in another way: counts it and checks its stamp.
  /// @param sensor what tells sensors apart, beside the frame
  /// @return false if it was dropped
  bool accept(const std::string& sensor, const std::string& label, const std_msgs::Header& header);
  /// One that was accepted waits for its transforms.
  void add(const std::string& sensor, const std_msgs::Header& header, TransformQueue::Ready process,
           bool with_other = true, const SweepTimes& sweep = {});

  Drops& drops() { return drops_; }
  const TransformQueue& queue() const { return queue_; }
  /// Messages of all kinds, from the start on.
  std::size_t received() const { return received_; }
  /// Since the last report.
  std::size_t recent() const { return received_ - reported_; }
  /// Rates, messages that wait and that were dropped. @param seconds since the last report
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, double seconds) const;
  void endReport();

 private:
  void jumpedBack(const ros::Time& to);

  ros::NodeHandle node_;
  std::shared_ptr<CallbackGuard> guard_;
  bool in_order_;
  std::function<void(const ros::Time&)> jumped_back_;
  std::string name_;
  Throttle jump_throttle_;
  Drops drops_;
  Stamps stamps_;
  std::map<std::string, std::size_t> recent_;  // received since the last report, by label
  std::size_t received_ = 0, reported_ = 0;
  TransformQueue queue_;
};

template <class Message>
ros::Subscriber Arrivals::subscribe(const std::string& topic, int queue_size, const std::string& label,
                                    std::function<void(const Message&, const Transforms&)> process,
                                    bool with_other, std::function<SweepTimes(const Message&)> sweep_of) {
  recent_[label] = 0;
  using Event = ros::MessageEvent<const Message>;
  const boost::function<void(const Event&)> arrived = [=](const Event& event) {
    const boost::shared_ptr<const Message> message = event.getConstMessage();
    const std::string sensor = topic + ' ' + event.getPublisherName();
    if (!accept(sensor, label, message->header)) return;
    SweepTimes sweep;
    try {
      if (sweep_of) sweep = sweep_of(*message);
    } catch (const std::invalid_argument& e) {
      return drops_.add(kMalformed, e.what());
    }
    add(
        sensor, message->header,
        [message, process](const Transforms& transforms) { process(*message, transforms); }, with_other,
        sweep);
  };
  return node_.subscribe<Message>(topic, queue_size, arrived);
}

}  // namespace mapping_common
