// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <mapping_common/callback_guard.h>
#include <mapping_msgs/CorrectedMap.h>
#include <ros/ros.h>

#include <Eigen/Geometry>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <string>

namespace mapping_common {

/// Takes maps that were made anew (mapping_msgs/CorrectedMap), one after the other. Their work is done in
/// another thread, and only its end in that of the callbacks. One that won't do is refused: that is said and
/// counted.
class CorrectedMaps {
 public:
  struct Map {
    double stamp = 0.0;           ///< s, of the last scan or cloud that is in it
    double corrected_from = 0.0;  ///< s, from here on poses of others are in it already; infinite: none are
    Eigen::Isometry3d correction = Eigen::Isometry3d::Identity();  ///< moves what came after the stamp
    const char *begin = nullptr, *end = nullptr;                   ///< what is in a map's file
  };
  /// Puts the map in the place of the old one, in the thread of the callbacks. @return what to say of it
  using Take = std::function<std::string()>;
  /// What takes time, in another thread. It may use the Map. Where it throws, the map is refused.
  using Prepare = std::function<Take()>;
  /// Begins with a map, in the thread of the callbacks, when those before it are done.
  using Begin = std::function<Prepare(const Map&)>;

  /// @param name of the nodelet
  /// @param frame that maps have to be in
  CorrectedMaps(ros::NodeHandle& node, const std::string& topic, std::shared_ptr<CallbackGuard> guard,
                const std::string& name, const std::string& frame, Begin begin);

  /// Whether anybody is there who may send one: else there is no need to keep anything for it.
  bool isPublished() const { return subscriber_.getNumPublishers() > 0; }
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  void arrived(const mapping_msgs::CorrectedMapConstPtr& message);
  void poll();
  void startNext();
  void refuse(const std::string& why);
  Map read(const mapping_msgs::CorrectedMap& message) const;

  std::string name_, frame_;
  Begin begin_;
  ros::Subscriber subscriber_;
  ros::WallTimer timer_;
  std::deque<mapping_msgs::CorrectedMapConstPtr> waiting_;
  std::future<Take> running_;
  std::size_t taken_ = 0, refused_ = 0;
};

}  // namespace mapping_common
