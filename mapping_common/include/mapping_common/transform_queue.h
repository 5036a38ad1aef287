// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tf2_ros/buffer.h>
#include <tf2_ros/message_filter.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace mapping_common {

/// Messages that wait until they can be transformed. The buffer must be filled from the thread that adds
/// messages (TransformListener with the node handle and spin_thread = false): tf2_ros::MessageFilter forgets
/// a message whose transform comes from another thread in the very moment in which it is added.
template <class Message>
class TransformQueue {
 public:
  using Pointer = boost::shared_ptr<const Message>;

  /// @param frames that a message is to be transformed to; without any it is ready at once
  /// @param size messages that wait; the oldest is given up for another
  /// @param tolerance s, transforms must be known for this much later than a message's stamp, too
  /// @param ready gets each message
  /// @param failed gets those that can't be transformed, and why
  TransformQueue(tf2_ros::Buffer& buffer, const std::vector<std::string>& frames, int size, double tolerance,
                 const ros::NodeHandle& node, std::function<void(const Message&)> ready,
                 std::function<void(const Message&, const std::string& why)> failed)
      : ready_(std::move(ready)) {
    if (frames.empty()) return;
    filter_ = std::make_unique<tf2_ros::MessageFilter<Message>>(buffer, "", size, node);
    filter_->setTargetFrames(frames);
    filter_->setTolerance(ros::Duration(tolerance));
    filter_->registerCallback([this](const Pointer& message) {
      --waiting_;
      ready_(*message);
    });
    filter_->registerFailureCallback(
        [this, frames, failed, &buffer](const Pointer& message, tf2_ros::FilterFailureReason) {
          --waiting_;
          const std_msgs::Header& header = message->header;
          std::string why = header.frame_id.empty() ? "it has no frame_id" : "it waited for too long";
          for (const std::string& frame : frames) {
            if (header.frame_id.empty() || !buffer.canTransform(frame, header.frame_id, header.stamp, &why))
              break;
          }
          failed(*message, why);
        });
  }

  void add(const Pointer& message) {
    if (!filter_) return ready_(*message);
    ++waiting_;
    filter_->add(message);
  }
  std::size_t waiting() const { return waiting_; }
  /// Forgets what waits.
  /// @return how many
  std::size_t clear() {
    if (filter_) filter_->clear();
    return std::exchange(waiting_, 0);
  }

 private:
  std::function<void(const Message&)> ready_;
  std::size_t waiting_ = 0;
  std::unique_ptr<tf2_ros::MessageFilter<Message>> filter_;
};

}  // namespace mapping_common
