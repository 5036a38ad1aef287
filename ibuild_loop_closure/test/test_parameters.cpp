// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/testing/parameters.h>
#include <mapping_common/testing/temp_dir.h>

#include "ibuild_loop_closure/ros/parameters.h"

namespace ibuild_loop_closure {
namespace {

std::string rejection(const std::string& yaml) {
  const mapping_common::TempDir dir;
  return mapping_common::rejection<LoopClosureParameters>(dir.write("a.yaml", yaml));
}

TEST(Parameters, AreSoundAndDocumented) {
  mapping_common::expectSound<LoopClosureParameters>();
  mapping_common::expectDocumented<LoopClosureParameters>("ibuild_loop_closure/LoopClosureNodelet",
                                                          PACKAGE_DIR "/config/loop_closure.yaml",
                                                          PACKAGE_DIR "/docs/parameters.md");
}

TEST(Parameters, MethodSetsTheDefaults) {
  XmlRpc::XmlRpcValue values;
  values["method"] = "thesis";
  values["features"]["threshold"] = 40;
  const LoopClosureParameters p = readLoopClosureParameters(mapping_common::Parameters(values));
  EXPECT_FALSE(p.detector.geometric_check);
  EXPECT_EQ(IndexType::kLinear, p.detector.index.type);
  EXPECT_EQ(Detector::kBrisk, p.detector.features.detector);
  EXPECT_EQ(40, p.detector.features.threshold);
}

TEST(Parameters, AreRejectedByName) {
  EXPECT_EQ("~use_stereo is true, allowed is false with use_depth",
            rejection("{use_depth: true, use_stereo: true}"));
  EXPECT_EQ("~geometry/ratio is 2, allowed is 0.1 to 1", rejection("geometry: {ratio: 2.0}"));
  EXPECT_EQ("~stereo/window is 12, allowed is an odd number", rejection("stereo: {window: 12}"));
  EXPECT_EQ("~delta is 513, allowed is 1 to 512 bits", rejection("delta: 513"));
  EXPECT_EQ("~index/type is 'tree', allowed is linear | graph", rejection("index: {type: tree}"));
}

}  // namespace
}  // namespace ibuild_loop_closure
