// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/trajectory_file.h"

#include <mapping_common/files.h>

#include <iomanip>

namespace pose_graph {

void writeTum(const std::string& path, const Graph& graph) {
  mapping_common::writeFile(path, [&](std::ostream& out) {
    for (const Node& node : graph.nodes()) {
      if (node.stamp == 0)
        out << node.id;
      else
        out << node.stamp / 1000000000 << '.' << std::setfill('0') << std::setw(9) << node.stamp % 1000000000;
      out << std::setprecision(12);
      const auto& t = node.pose.translation;
      const auto& q = node.pose.rotation;
      out << ' ' << t.x() << ' ' << t.y() << ' ' << t.z() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z()
          << ' ' << q.w() << '\n';
    }
  });
}

}  // namespace pose_graph
