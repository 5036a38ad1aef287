// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/ros/parameters.h"

#include <stdexcept>

namespace ibuild_loop_closure {

LoopClosureParameters readLoopClosureParameters(mapping_common::Parameters& p) {
  LoopClosureParameters m;
  m.image_transport = p.choice("image_transport", m.image_transport, {"raw", "compressed"});
  m.use_depth = p.get("use_depth", m.use_depth);
  m.use_stereo = p.get("use_stereo", m.use_stereo);
  if (m.use_depth && m.use_stereo)
    throw std::invalid_argument("~use_depth and ~use_stereo are both true, allowed is one of them");
  m.queue_size = p.get("queue_size", m.queue_size, 1, 1000);
  m.debug_image = p.get("debug_image", m.debug_image);
  m.vocabulary_file = p.get("vocabulary_file", m.vocabulary_file);
  m.save_on_shutdown = p.get("save_on_shutdown", m.save_on_shutdown);
  m.fixed_frame = p.get("fixed_frame", m.fixed_frame);
  m.transform_timeout = p.get("transform_timeout", m.transform_timeout, 0.0, 10.0);

  KeyFrameOptions& k = m.key_frames;
  k.min_interval = p.get("key_frames/min_interval", k.min_interval, 0.0, 1e6);
  k.min_distance = p.get("key_frames/min_distance", k.min_distance, 0.0, 1e6);
  k.min_angle = p.get("key_frames/min_angle", k.min_angle, 0.0, 3.15);
  k.min_difference = p.get("key_frames/min_difference", k.min_difference, 0.0, 255.0);

  const bool thesis = p.choice("method", "full", {"full", "thesis"}) == "thesis";
  LoopDetectorOptions& d = m.detector;
  if (thesis) d = LoopDetectorOptions::thesis();
  FeatureOptions& f = d.features;
  const std::string detector =
      p.choice("features/detector", f.detector == Detector::kFast ? "fast" : "brisk", {"fast", "brisk"});
  f.detector = detector == "fast" ? Detector::kFast : Detector::kBrisk;
  f.threshold = p.get("features/threshold", f.threshold, 1, 255);
  f.octaves = p.get("features/octaves", f.octaves, 0, 8);
  f.size = static_cast<float>(p.get("features/size", static_cast<double>(f.size), 1.0, 100.0));
  f.pattern_scale = p.get("features/pattern_scale", f.pattern_scale, 0.1, 10.0);
  f.max_features = p.get("features/max_features", f.max_features, 0, 100000);
  f.spread = p.get("features/spread", f.spread);
  f.columns = p.get("features/columns", f.columns, 1, 1000);
  f.rows = p.get("features/rows", f.rows, 1, 1000);
  f.equalize = p.get("features/equalize", f.equalize);
  f.min_width = p.get("features/min_width", f.min_width, 0, 10000);
  f.max_width = p.get("features/max_width", f.max_width, 0, 100000);

  d.tracking_delta = p.get("tracking_delta", d.tracking_delta, 1, Descriptor::kBits);
  d.delta = p.get("delta", d.delta, 1, Descriptor::kBits);
  IndexOptions& i = d.index;
  const std::string index =
      p.choice("index/type", i.type == IndexType::kGraph ? "graph" : "linear", {"graph", "linear"});
  i.type = index == "graph" ? IndexType::kGraph : IndexType::kLinear;
  i.nearest = p.get("index/nearest", i.nearest);
  i.links = p.get("index/links", i.links, 2, 64);
  i.insert_breadth = p.get("index/insert_breadth", i.insert_breadth, 1, 10000);
  i.search_breadth = p.get("index/search_breadth", i.search_breadth, 1, 10000);

  d.beta = p.get("beta", d.beta, 1, 1000000);
  d.min_similarity = p.get("min_similarity", d.min_similarity, 0.0, 1.0);
  d.grouping = p.get("grouping", d.grouping);
  d.geometric_check = p.get("geometric_check", d.geometric_check);
  d.step = p.get("step", d.step, 0.0, 1.0);
  d.leave_first = p.get("leave_first", d.leave_first);
  d.max_remaining = p.get("max_remaining", d.max_remaining, 0.0, 1.0);
  d.candidates = p.get("candidates", d.candidates, 1, 10000);
  d.verified = p.get("verified", d.verified, 1, 10000);
  GeometryOptions& g = d.geometry;
  g.max_features = p.get("geometry/max_features", g.max_features, 8, 100000);
  g.delta = p.get("geometry/delta", g.delta, 1, Descriptor::kBits);
  g.ratio = p.get("geometry/ratio", g.ratio, 0.1, 1.0);
  g.layout_tolerance = p.get("geometry/layout_tolerance", g.layout_tolerance, 0.001, 0.5);
  g.epipolar_tolerance = p.get("geometry/epipolar_tolerance", g.epipolar_tolerance, 0.0001, 0.1);
  g.spot = p.get("geometry/spot", g.spot, 0.0, 0.5);
  g.min_overlap = p.get("geometry/min_overlap", g.min_overlap, 0.0, 1.0);
  g.max_scale = p.get("geometry/max_scale", g.max_scale, 1.0, 100.0);
  g.iterations = p.get("geometry/iterations", g.iterations, 1, 100000);
  g.min_inliers = p.get("geometry/min_inliers", g.min_inliers, 8, 10000);
  StereoOptions& s = d.stereo;
  s.window = p.get("stereo/window", s.window, 5, 63);
  s.min_disparity = p.get("stereo/min_disparity", s.min_disparity, 0.1, 1000.0);
  s.max_disparity = p.get("stereo/max_disparity", s.max_disparity, 0.001, 1.0);
  s.uniqueness = p.get("stereo/uniqueness", s.uniqueness, 0.0, 1.0);
  s.max_difference = p.get("stereo/max_difference", s.max_difference, 0.0, 255.0);
  TrackOptions& t = d.tracks;
  t.min_significance = p.get("tracks/min_significance", t.min_significance, 0.0, 1e6);
  t.open_significance = p.get("tracks/open_significance", t.open_significance, 0.0, 1e6);
  t.min_verified = p.get("tracks/min_verified", t.min_verified, 0, 1000);
  t.memory = p.get("tracks/memory", t.memory, 0.0, 1.0);
  t.backward = p.get("tracks/backward", t.backward, 0, 1000);
  t.ahead = p.get("tracks/ahead", t.ahead, 0, 1000);
  d.validate();
  return m;
}

}  // namespace ibuild_loop_closure
