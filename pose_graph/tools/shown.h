// SPDX-License-Identifier: BSD-3-Clause
//
// Callbacks that show how far a call is. The line is theirs: as temporaries of the call they leave a
// terminal's line empty when it is over, or has thrown.
#pragma once

#include <mapping_common/progress.h>

#include <memory>

#include "pose_graph/maps.h"
#include "pose_graph/optimisation.h"

namespace pose_graph {

inline MapProgress shareShown() {
  return [line = std::make_shared<mapping_common::Progress>("pose_graph")](double share) {
    line->show(static_cast<int>(100.0 * share), " %");
    return true;
  };
}

inline Progress iterationsShown() {
  return [line = std::make_shared<mapping_common::Progress>("pose_graph")](int iteration, double chi2) {
    line->show("iteration ", iteration, ", chi2 ", chi2);
    return true;
  };
}

}  // namespace pose_graph
