// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <memory>
#include <string>
#include <vector>

#include "pose_graph/graph_keeper.h"
#include "pose_graph/ros/parameters.h"

namespace pose_graph {

class Worker;

/// Makes maps anew once loops have moved the poses that they are made along, in a thread of its own, and
/// publishes them (mapping_msgs/CorrectedMap): the 2D map on `corrected_map`, the R-tree map on
/// `corrected_cloud_map`.
class CorrectedMaps {
 public:
  /// @param parameters may change meanwhile, and live as long as this
  CorrectedMaps(ros::NodeHandle& node, const PoseGraphParameters& parameters);
  ~CorrectedMaps();

  /// To be called often: publishes what is done, and begins where there is need.
  /// @param keeper of the graph
  /// @return what there is to be said; "" is nothing
  std::string update(const OnlineGraph& graph, const std::shared_ptr<GraphKeeper>& keeper);
  /// The next update has another graph.
  void restart();
  /// What was made at last.
  const std::string& last() const { return last_; }

 private:
  struct Made {
    std::vector<Pose> poses;
    struct Map {
      ros::Publisher publisher;
      std::int64_t stamp;
      std::vector<std::uint8_t> data;
    };
    std::vector<Map> maps;
    std::string error;
    double seconds = 0.0;
  };
  void begin(const OnlineGraph& graph, const std::shared_ptr<GraphKeeper>& keeper);
  void publish(const OnlineGraph& graph, const Made& made, const Made::Map& map) const;

  ros::NodeHandle node_;
  const PoseGraphParameters& parameters_;
  ros::Publisher grid_, cells_;
  std::vector<Pose> poses_;  // by node: those that the maps there are were made along
  ros::WallTime begun_;
  std::size_t generation_ = 0;
  std::unique_ptr<Made> made_;
  std::string last_ = "none";
  std::unique_ptr<Worker> worker_;
};

}  // namespace pose_graph
