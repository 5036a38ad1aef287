// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/worker.h>
#include <mapping_msgs/CorrectedMap.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "pose_graph/graph_keeper.h"
#include "pose_graph/ros/parameters.h"

namespace pose_graph {

/// Makes maps anew once loops have moved the poses that they are made along, in a thread of its own, and
/// publishes them (mapping_msgs/CorrectedMap): the 2D map on `corrected_map`, the R-tree map on
/// `corrected_cloud_map`. The latter waits until the front end is seen to have gone over to the corrected 2D
/// map, and tells from when on its poses are those (CorrectedMap::corrected_from).
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
      std::int64_t stamp;
      std::vector<std::uint8_t> data;
    };
    std::optional<Map> grid, cells;
    std::int64_t begun = 0;  // ns, latest stamp of the front end then
    std::string error;
    double seconds = 0.0;
  };
  void begin(const OnlineGraph& graph, const std::shared_ptr<GraphKeeper>& keeper);
  std::optional<mapping_msgs::CorrectedMap> message(const OnlineGraph& graph, const Made& made,
                                                    const Made::Map& map) const;
  void publish(const OnlineGraph& graph, const Made& made);
  void publishWaiting(const OnlineGraph& graph);

  ros::NodeHandle node_;
  const PoseGraphParameters& parameters_;
  ros::Publisher grid_, cells_;
  std::vector<Pose> poses_;  // by node: those that the maps there are were made along
  std::size_t inside_ = 0;   // key poses that they are made of
  ros::WallTime begun_;
  std::size_t generation_ = 0;
  std::unique_ptr<Made> made_;
  struct Waiting {
    mapping_msgs::CorrectedMap cells;
    Pose correction, front_end;  // as it was seen last
    ros::WallTime until;
  };
  std::optional<Waiting> waiting_;
  std::string last_ = "none";
  std::unique_ptr<mapping_common::Worker> worker_;
};

}  // namespace pose_graph
