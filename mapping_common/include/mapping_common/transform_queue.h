// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <std_msgs/Header.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapping_common {

/// tf2 knows no leading slashes, older drivers and launch files do.
std::string withoutSlash(const std::string& frame);

/// When measurements were made, s from the stamp of their message on.
struct SweepTimes {
  double first = 0.0, last = 0.0;
};

/// Messages wait here until tf tells where their frame was. Those of one sensor stay in order, those of
/// another don't hold them up. Time is that of the stamps, so that a recording that is replayed faster, or is
/// paused, gives the same.
class TransformQueue {
 public:
  struct Options {
    std::string target_frame;  ///< that the message's frame is asked for in; empty: it isn't asked for
    /// A second transform at the same stamp, of other_source in other_target; empty: it isn't asked for.
    std::string other_target, other_source;
    bool needs_other = false;  ///< whether messages fail without it
    double timeout = 0.5;      ///< s, by the stamps of later messages of its sensor, that one waits at most
    double tolerance = 0.0;    ///< s, transforms must be known for this much later, too: a sweep takes time
    std::size_t most = 1000;   ///< messages that wait, where stamps don't go on; the oldest is given up
    bool needsTransforms() const { return !target_frame.empty() || !other_target.empty(); }
  };
  /// What tf says about a message.
  struct Transforms {
    Eigen::Isometry3d message = Eigen::Isometry3d::Identity();  ///< its frame in target_frame
    std::optional<Eigen::Isometry3d> other;                     ///< other_source in other_target
  };
  using Ready = std::function<void(const Transforms&)>;
  using Failed = std::function<void(const std::string& why)>;

  /// Callbacks come with those of the node. @param failed gets those that can't be transformed, and why
  TransformQueue(const ros::NodeHandle& node, const Options& options, Failed failed);
  ~TransformQueue();

  /// @param sensor what tells sensors apart
  /// @param header its stamp is one that Stamps has accepted
  /// @param with_other whether the second transform is asked for
  /// @param ready is called with the transforms, at once if they are there; it throws nothing
  /// @param sweep transforms must be known from its first to its last moment, too
  /// @throws std::invalid_argument if the message has no frame_id and needs one, or a sweep and no stamp
  void add(const std::string& sensor, const std_msgs::Header& header, bool with_other, Ready ready,
           const SweepTimes& sweep = {});
  std::size_t waiting() const { return waiting_; }
  /// Time has jumped: forgets the messages that wait, and transforms. @return how many messages
  std::size_t restart();

  const tf2_ros::Buffer& buffer() const { return buffer_; }
  /// Whether the second transform was ever there.
  bool otherExists() const { return other_exists_; }
  /// Why it wasn't for the last message.
  const std::string& whyNoOther() const { return why_no_other_; }

 private:
  struct Item {
    std_msgs::Header header;
    ros::Time first, last;  // the sweep
    bool with_other;
    std::uint64_t number;  // of its arrival
    Ready ready;
  };
  struct Sequence {
    std::deque<Item> items;
    ros::Time newest;
    std::vector<tf2::TransformableRequestHandle> requests;
  };

  void hear(const tf2_msgs::TFMessage& message, bool is_static);
  void advance();
  void advance(Sequence& sequence, bool give_up = false);
  void forgetEmpty();
  Sequence& oldest();
  bool isKnown(const std::string& target, const std::string& source, const Item& item,
               std::string* why) const;
  bool knowsFrame(const Item& item, std::string* why = nullptr) const;
  bool knowsOther(const Item& item, std::string* why = nullptr) const;
  Transforms lookup(const Item& item, bool other) const;
  bool isOvertaken(const Sequence& sequence,
                   bool (TransformQueue::*knows)(const Item&, std::string*) const) const;
  bool expectsOther(const ros::Time& stamp) const;
  void wakeUpWith(Sequence& sequence, const std::string& target, const std::string& source);

  Options options_;
  Failed failed_;
  tf2_ros::Buffer buffer_;
  tf2::TransformableCallbackHandle callback_;
  std::map<std::string, Sequence> sequences_;
  std::size_t waiting_ = 0;
  std::uint64_t arrivals_ = 0;
  // Whether the second transform may just not have come yet, as at the start.
  bool other_may_come_ = true;
  bool other_exists_ = false;
  std::string why_no_other_;
  ros::Time last_heard_;
  std::vector<ros::Subscriber> listeners_;  // gone before the buffer that they feed
};

}  // namespace mapping_common
