// SPDX-License-Identifier: BSD-3-Clause
//
// What the program pose_graph does with sessions.
#pragma once

#include <string>
#include <vector>

#include "pose_graph/loop_check.h"

namespace pose_graph {

struct SessionArguments {
  std::string in, out;
  LoopCheckOptions check;
  double resolution = 0.0;  // m, of maps; 0: the session's, or the default
  double voxel = 0.0;       // m, of clouds
  bool without_loops = false;
};

/// Endings of files that export writes, with what they are, for messages.
extern const char kExports[];
bool isExport(const std::string& path);

void printSession(const std::string& path);
void optimiseSession(const SessionArguments& a);
void exportSession(const SessionArguments& a);
void mergeSessionFiles(const std::vector<std::string>& paths, const SessionArguments& a);

}  // namespace pose_graph
