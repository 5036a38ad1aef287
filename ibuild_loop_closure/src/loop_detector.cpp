// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/loop_detector.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <tuple>

#include "ibuild_loop_closure/vocabulary_file.h"

namespace ibuild_loop_closure {
namespace {

constexpr double kRounding = 1e-9;  // of sums of images

// Depth (m) at the features, 0 where it is unknown.
std::vector<float> depthsAt(const cv::Mat& depth, const std::vector<cv::Point2f>& points) {
  std::vector<float> depths;
  if (depth.empty()) return depths;
  depths.reserve(points.size());
  for (const cv::Point2f& p : points) {
    const int x = std::min(depth.cols - 1, std::max(0, cvRound(p.x)));
    const int y = std::min(depth.rows - 1, std::max(0, cvRound(p.y)));
    const float z = depth.type() == CV_16UC1 ? 1e-3f * depth.at<std::uint16_t>(y, x) : depth.at<float>(y, x);
    depths.push_back(std::isfinite(z) && z > 0.0f ? z : 0.0f);
  }
  return depths;
}

// Of two ascending lists.
std::size_t commonCount(const std::vector<int>& a, const std::vector<int>& b) {
  std::size_t count = 0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    count += *i == *j;
    if (*i < *j) {
      ++i;
    } else {
      i += *i == *j;
      ++j;
    }
  }
  return count;
}

std::vector<float> depthsByStereo(const cv::Mat& left, const RightImage& right, const Camera& camera,
                                  const std::vector<cv::Point2f>& points, const StereoOptions& options) {
  std::vector<float> depths = disparitiesAt(toGrey(left), toGrey(right.image), points, options);
  for (float& value : depths) {
    const double disparity = value - (camera.cx - right.cx);
    value =
        value > 0.0f && disparity > 0.0 ? static_cast<float>(camera.fx * right.baseline / disparity) : 0.0f;
  }
  return depths;
}

void checkFrame(const Frame& frame) {
  if (frame.right) {
    if (!frame.depth.empty())
      throw std::invalid_argument("there are both a depth image and a right image, allowed is one of them");
    if (frame.right->image.size() != frame.image.size())
      throw std::invalid_argument("the right image and the left one differ in size");
    toGrey(frame.right->image);
    double baseline = frame.right->baseline;
    mapping_common::Option("the baseline", baseline, "m", "").within(1e-6, 1e6).check();
  }
  if (frame.depth.empty()) return;
  if (frame.depth.size() != frame.image.size())
    throw std::invalid_argument("the depth image and the image differ in size");
  if (frame.depth.type() != CV_16UC1 && frame.depth.type() != CV_32FC1)
    throw std::invalid_argument("the depth image has neither 16 bits (mm) nor 32 bits (m)");
}

}  // namespace

LoopDetectorOptions LoopDetectorOptions::thesis() {
  LoopDetectorOptions o;
  o.features.detector = Detector::kBrisk;
  o.features.threshold = 30;
  o.features.octaves = 3;
  o.features.max_features = o.features.min_width = o.features.max_width = 0;
  o.tracking_delta = o.delta = 70;
  o.index.type = IndexType::kLinear;
  o.index.nearest = false;
  o.grouping = o.leave_first = o.geometric_check = false;
  o.step = 0.0;
  return o;
}

const char* stageName(Stage stage) {
  switch (stage) {
    case Stage::kDetection:
      return "Keypoint detection";
    case Stage::kDescription:
      return "Descriptor extraction";
    case Stage::kTracking:
      return "Matching with the last image";
    case Stage::kMerging:
      return "Clustering";
    case Stage::kAssignment:
      return "Assignment to BOW";
    case Stage::kHypotheses:
      return "Loop closure hypotheses";
    case Stage::kGeometry:
      return "Evaluation";
    case Stage::kUpdate:
      return "Vocabulary update";
  }
  return "";
}

LoopDetector::LoopDetector(const LoopDetectorOptions& options)
    : options_(mapping_common::validate(options)),
      extractor_(options.features),
      vocabulary_(options.delta, options.index),
      consistency_(options.beta),
      tracks_(options.tracks, options.beta) {
  const auto check = [this](const char* name, int& delta) {
    mapping_common::Option(name, delta, "bits", "").within(1, extractor_.bits()).check();
  };
  check("delta", options_.delta);
  check("tracking_delta", options_.tracking_delta);
  check("geometry/delta", options_.geometry.delta);
}

Detection LoopDetector::process(const Frame& frame, const StageDone& done) {
  const auto finish = [&done](Stage stage) {
    if (done) done(stage);
  };
  const cv::Mat prepared = extractor_.prepare(frame.image);
  checkFrame(frame);
  auto key_points = extractor_.detect(prepared);
  finish(Stage::kDetection);
  View view;
  view.size = frame.image.size();
  view.features =
      extractor_.describe(prepared, std::move(key_points),
                          static_cast<float>(frame.image.cols) / static_cast<float>(prepared.cols));
  finish(Stage::kDescription);

  // Fig. 4.7: what is seen in two consecutive images is likely to be seen again.
  const std::vector<Descriptor>& descriptors = view.features.descriptors;
  std::vector<Descriptor> tracked;
  const std::vector<Match> matches =
      matchDescriptors(descriptors, last_.descriptors, options_.tracking_delta);
  for (const Match& m : matches) {
    tracked.push_back(centroid(descriptors[m.a], last_.descriptors[m.b]));
  }
  finish(Stage::kTracking);
  Detection detection;
  detection.features = static_cast<int>(view.features.size());
  detection.tracked = static_cast<int>(tracked.size());
  const std::vector<Descriptor> words = mergeDescriptors(std::move(tracked), vocabulary_.delta());
  finish(Stage::kMerging);
  const Assignment assignment = vocabulary_.assign(words);
  finish(Stage::kAssignment);

  detection.image = images();
  detection.old_words = static_cast<int>(assignment.old_words.size());
  detection.new_words = static_cast<int>(assignment.new_words.size());
  detection.similarities = options_.geometric_check ? vocabulary_.idfSimilarities(assignment)
                                                    : vocabulary_.similarities(assignment);
  const double now = detection.image == 0 ? 0.0 : clock_.back() + progressOf(view, matches);
  const auto end = static_cast<int>(
      std::upper_bound(clock_.begin(), clock_.end(), now - options_.beta + kRounding) - clock_.begin());
  if (!options_.geometric_check) decideBySimilarity(end, detection);
  finish(Stage::kHypotheses);
  Features last_features = view.features;
  if (options_.geometric_check) {
    if (options_.leave_first) straight_run_.add(motionSince(last_, view, matches, options_.geometry));
    view = firstFeatures(view, options_.geometry.max_features);
    view.depths = frame.right && frame.camera ? depthsByStereo(frame.image, *frame.right, *frame.camera,
                                                               view.features.points, options_.stereo)
                                              : depthsAt(frame.depth, view.features.points);
    const int candidates_end = endOfCandidates(view, end);
    decideByGeometry(view, frame.camera, candidates_end, detection);
    past_.push_back({candidates_end, detection.accepted});
    for (const Loop& loop : detection.earlier) past_[loop.query].accepted = true;
  }
  finish(Stage::kGeometry);

  vocabulary_.update(assignment);
  clock_.push_back(now);
  last_ = std::move(last_features);
  if (options_.geometric_check) views_.push_back(std::move(view));
  finish(Stage::kUpdate);
  return detection;
}

// What the image counts for in beta, 0 to 1: the median motion of features since the last one, in steps.
double LoopDetector::progressOf(const View& view, const std::vector<Match>& tracked) const {
  constexpr double kFew = 0.2;  // of the features: most of the view is new then
  if (options_.step <= 0.0 || tracked.empty() ||
      static_cast<double>(tracked.size()) < kFew * static_cast<double>(view.features.size()))
    return 1.0;
  std::vector<double> motions;
  for (const Match& m : tracked) motions.push_back(cv::norm(view.features.points[m.a] - last_.points[m.b]));
  const auto median = motions.begin() + static_cast<std::ptrdiff_t>(motions.size() / 2);
  std::nth_element(motions.begin(), median, motions.end());
  return std::min(1.0, *median / (options_.step * view.size.width));
}

// Candidates are the images before that one: t_L = t - beta and earlier. If so wanted none of those either
// that the camera has gone straight ahead since, or that show what has been in view since then: a slow camera
// closes no loop.
int LoopDetector::endOfCandidates(const View& view, int end) {
  if (!options_.leave_first) return end;
  const int step = std::max(1, options_.beta / 2);
  const auto shows_the_same = [&](int image) {
    return checkLayout(view, views_[image], options_.geometry).significance >=
           options_.tracks.min_significance;
  };
  while (in_view_ < end && !shows_the_same(in_view_)) in_view_ += step;
  in_view_ = std::min(in_view_, end);
  return std::min(in_view_, straight_run_.start());
}

// Whether the camera has lost sight of an image since then, until another one, for beta / 2 images at least.
// Common words tell where that is most likely, and the layout whether it is so.
bool LoopDetector::hasLeft(int image, int until, double significance) const {
  const int window = std::max(1, options_.beta / 2);
  constexpr int kWindows = 64;
  const int step = std::max(window, (until - image) / kWindows);
  const std::vector<int>& words = vocabulary_.wordsOf(image);
  std::size_t least = std::numeric_limits<std::size_t>::max();
  int closest_of_least = -1, least_from_middle = std::numeric_limits<int>::max();
  for (int first = image + 1; first < until; first += step) {
    const auto last = static_cast<int>(
        std::lower_bound(clock_.begin(), clock_.end(), clock_[first] + window - 1 - kRounding) -
        clock_.begin());
    if (last >= until) break;
    std::size_t most = 0;
    int closest = first;
    for (int i = first; i <= last; i += 1 + (last - first) / window) {
      const std::size_t common = commonCount(words, vocabulary_.wordsOf(i));
      if (common <= most) continue;
      most = common;
      closest = i;
    }
    // Of those with as few words the one that is farthest from both images.
    const int from_middle = std::abs(2 * first - image - until);
    if (std::tie(most, from_middle) >= std::tie(least, least_from_middle)) continue;
    least = most;
    least_from_middle = from_middle;
    closest_of_least = closest;
  }
  if (closest_of_least < 0) return false;
  const GeometryResult between = checkLayout(views_[closest_of_least], views_[image], options_.geometry);
  return between.significance < options_.max_remaining * significance;
}

// The arg max of 4.4.3. Normalizing doesn't change it, and would make the similarity depend on the sequence's
// length.
void LoopDetector::decideBySimilarity(int end, Detection& detection) {
  const std::vector<double>& s = detection.similarities;
  int hypotheses = 0;
  Loop best;
  double most = 0.0;
  for (int i = 0; i < end; ++i) {
    if (s[i] <= 0.0) continue;
    ++hypotheses;
    double sum = s[i];
    if (options_.grouping) sum += (i > 0 ? s[i - 1] : 0.0) + (i + 1 < end ? s[i + 1] : 0.0);
    if (sum > most) {
      most = sum;
      best.match = i;
      best.similarity = s[i];
    }
  }
  if (hypotheses <= 1) return;  // |L| > 1
  best.query = detection.image;
  detection.accepted =
      best.similarity >= options_.min_similarity && consistency_.allows(best.query, best.match);
  if (detection.accepted) consistency_.accept(best.query, best.match);
  detection.best = best;
}

std::vector<int> LoopDetector::candidatesOf(const std::vector<double>& similarities, int end) const {
  std::vector<double> grouped(similarities.begin(), similarities.begin() + end);
  if (options_.grouping) {
    for (int i = 0; i < end; ++i) {
      grouped[i] += (i > 0 ? similarities[i - 1] : 0.0) + (i + 1 < end ? similarities[i + 1] : 0.0);
    }
  }
  std::vector<int> order(end);
  std::iota(order.begin(), order.end(), 0);
  const auto count = std::min(end, options_.candidates);
  std::partial_sort(order.begin(), order.begin() + count, order.end(),
                    [&](int a, int b) { return grouped[a] != grouped[b] ? grouped[a] > grouped[b] : a < b; });
  order.resize(count);
  order.erase(std::remove_if(order.begin(), order.end(), [&](int i) { return grouped[i] <= 0.0; }),
              order.end());
  // As many again where open tracks go on, whatever their similarity.
  const std::size_t most = 2 * static_cast<std::size_t>(options_.candidates);
  for (int image : tracks_.expected(images())) {
    if (order.size() >= most) break;
    if (image < end && std::find(order.begin(), order.end(), image) == order.end()) order.push_back(image);
  }
  return order;
}

void LoopDetector::decideByGeometry(const View& view, const std::optional<Camera>& camera, int end,
                                    Detection& detection) {
  std::vector<Checked> checked;
  for (int candidate : candidatesOf(detection.similarities, end)) {
    GeometryResult result = checkLayout(view, views_[candidate], options_.geometry);
    if (isLikely(candidate, detection.image, result)) checked.push_back({candidate, std::move(result)});
  }
  // Where a trusted track would end.
  const auto link = tracks_.lastVerified(detection.image);
  if (link && link->query >= first_ && std::none_of(checked.begin(), checked.end(), [&](const Checked& c) {
        return tracks_.goesOn(detection.image, c.image);
      })) {
    for (Checked& like : checkLike(*link, detection.image, view, end)) checked.push_back(std::move(like));
  }
  std::stable_sort(checked.begin(), checked.end(), [](const Checked& a, const Checked& b) {
    return a.result.significance > b.result.significance;
  });
  std::vector<LoopTracks::Hypothesis> hypotheses;
  for (std::size_t i = 0; i < checked.size(); ++i) {
    GeometryResult& result = checked[i].result;
    if (i < static_cast<std::size_t>(options_.verified_candidates))
      verify(view, views_[checked[i].image], camera, options_.geometry, result);
    hypotheses.push_back(hypothesisOf(checked[i]));
  }
  const LoopTracks::Decision decision = tracks_.decide(detection.image, hypotheses);
  if (decision.hypothesis < 0) return;
  Loop best;
  best.query = detection.image;
  best.match = hypotheses[decision.hypothesis].match;
  best.similarity = decision.evidence / (decision.evidence + options_.tracks.open_significance);
  best.geometry = std::move(checked[decision.hypothesis].result);
  detection.best = std::move(best);
  detection.accepted = decision.accepted;
  if (decision.look_back) detection.earlier = lookBack(*decision.look_back, camera);
}

bool LoopDetector::isLikely(int candidate, int image, const GeometryResult& result) const {
  return result.significance >= options_.tracks.min_significance &&
         (!options_.leave_first || hasLeft(candidate, image, result.significance));
}

LoopTracks::Hypothesis LoopDetector::hypothesisOf(const Checked& checked) {
  const GeometryResult& result = checked.result;
  return {checked.image, result.significance, result.verified,
          std::min(result.placement.scale, 1.0 / result.placement.scale), result.placement};
}

// Likely candidates of an image before or after a track's loop: about as far on, their layouts like that
// loop's.
std::vector<LoopDetector::Checked> LoopDetector::checkLike(const LoopTracks::Link& link, int image,
                                                           const View& view, int end) const {
  std::vector<Checked> likely;
  const int middle = link.match + image - link.query;
  for (int candidate = std::max(0, middle - options_.tracks.backward);
       candidate <= std::min(end - 1, middle + options_.tracks.backward); ++candidate) {
    GeometryResult result = checkLayout(view, views_[candidate], options_.geometry, link.placement);
    if (isLikely(candidate, image, result) &&
        standsOut(candidate, image, view, link.placement, result.significance))
      likely.push_back({candidate, std::move(result)});
  }
  return likely;
}

// Whether images of other places don't have a layout like that, too, as in corridors, all of which vanish in
// the middle.
bool LoopDetector::standsOut(int candidate, int image, const View& view, const Placement& like,
                             double significance) const {
  constexpr int kOthers = 8;
  for (int i = 1; i <= kOthers; ++i) {
    const int other = candidate + i * (image - candidate) / (kOthers + 1);
    if (std::min(other - candidate, image - other) <= options_.beta / 2) continue;
    if (checkLayout(view, views_[other], options_.geometry, like).significance >=
        options_.max_remaining * significance)
      return false;
  }
  return true;
}

// The loops before the one that opened a track: as the track would have gone on backwards from it.
std::vector<Loop> LoopDetector::lookBack(LoopTracks::Link link, const std::optional<Camera>& camera) const {
  std::vector<Loop> loops;
  const int opened = link.query, last = std::max(first_, opened - options_.tracks.look_back);
  for (int image = opened - 1; image >= last && !past_[image].accepted &&
                               tracks_.left(link, image) >= options_.tracks.min_significance;
       --image) {
    std::vector<Checked> likely = checkLike(link, image, views_[image], past_[image].end);
    const auto weight = [&](const Checked& c) { return tracks_.weightOf(hypothesisOf(c), image, link); };
    const auto best = std::max_element(likely.begin(), likely.end(), [&](const Checked& a, const Checked& b) {
      return weight(a) < weight(b);
    });
    if (best == likely.end()) continue;
    verify(views_[image], views_[best->image], camera, options_.geometry, best->result);
    link = {image, best->image, tracks_.left(link, image), best->result.placement};
    loops.push_back({image, best->image, link.evidence / (link.evidence + options_.tracks.open_significance),
                     std::move(best->result)});
  }
  std::reverse(loops.begin(), loops.end());
  return loops;
}

void LoopDetector::breakSequence() {
  last_ = {};
  first_ = images();
}

void LoopDetector::save(const std::string& path) const {
  saveVocabulary(path, {options_.features.descriptor, vocabulary_.content(), views_});
}

void LoopDetector::load(const std::string& path) {
  VocabularyFile file = loadVocabulary(path);
  try {
    if (file.descriptor != options_.features.descriptor)
      throw std::runtime_error("its descriptors are '" + file.descriptor + "', those of images '" +
                               options_.features.descriptor + "': features/descriptor has to be the file's");
    if (options_.geometric_check && file.views.size() != file.content.image_words.size())
      throw std::runtime_error("it was made without the geometric check, whose features it lacks");
    LoopDetectorOptions options = options_;
    options.delta = file.content.delta;
    options.index = file.content.index;
    LoopDetector loaded(options);
    loaded.vocabulary_ = Vocabulary::restore(std::move(file.content));
    if (options.geometric_check) loaded.views_ = std::move(file.views);
    loaded.straight_run_ = StraightRun(loaded.images());
    loaded.past_.resize(loaded.images());
    loaded.first_ = loaded.images();
    loaded.clock_.resize(loaded.images());
    std::iota(loaded.clock_.begin(), loaded.clock_.end(), 0.0);
    *this = std::move(loaded);
  } catch (const std::exception& e) {
    throw std::runtime_error(path + " was not loaded: " + e.what());
  }
}

}  // namespace ibuild_loop_closure
