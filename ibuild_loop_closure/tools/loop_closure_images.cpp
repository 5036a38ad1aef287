// SPDX-License-Identifier: BSD-3-Clause
//
// Detects the loop closures of a sequence of images and writes what was found: loops, similarities, precision
// and recall, times, pictures.
#include <mapping_common/figures.h>
#include <mapping_common/files.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>

#include "ibuild_loop_closure/evaluation.h"
#include "ibuild_loop_closure/loop_detector.h"
#include "ibuild_loop_closure/pictures.h"
#include "ibuild_loop_closure/ros/parameters.h"
#include "image_source.h"

namespace ibuild_loop_closure {
namespace {

namespace po = boost::program_options;
using Clock = std::chrono::steady_clock;

struct Arguments {
  std::vector<std::string> images, right, deltas;
  std::vector<double> camera;
  double baseline = 0.0;
  std::string bag, topic, ground_truth, ids, poses, out, config, method, delta, save, load;
  int tolerance = 0, walks = -1, beta = 0, gap = 0, pairs = 0, threads = 1;
  double max_distance = 0.0, max_angle = 0.0, min_similarity = -1.0;
};

// Mean and standard deviation of times, ms.
class Times {
 public:
  void add(double ms) {
    ++count_;
    sum_ += ms;
    squares_ += ms * ms;
  }
  double mean() const { return count_ > 0 ? sum_ / count_ : 0.0; }
  double deviation() const {
    return count_ > 0 ? std::sqrt(std::max(0.0, squares_ / count_ - mean() * mean())) : 0.0;
  }

 private:
  double count_ = 0, sum_ = 0, squares_ = 0;
};

struct Run {
  std::vector<Proposal> proposals;
  std::vector<std::vector<double>> similarities;
  std::vector<GeometryResult> geometry;  // of each proposal
  std::vector<Times> stages = std::vector<Times>(kStages);
  Times total;
  std::size_t words = 0;
  int unreadable = 0;
};

LoopDetectorOptions optionsOf(const Arguments& a) {
  LoopDetectorOptions options;
  if (a.method == "thesis" || a.method == "thesis+grouping") options = LoopDetectorOptions::thesis();
  if (a.method == "thesis+grouping") options.grouping = true;
  if (a.method == "thesis+geometry") {
    options = LoopDetectorOptions::thesis();
    options.geometric_check = true;
    options.features.max_features = 0;
    options.geometry.max_features = 100000;
  }
  if (!a.config.empty()) {
    LoopClosureParameters parameters;
    parameters.detector = options;
    mapping_common::assign(parameters, mapping_common::loadYaml(a.config), {"debug_image/"}, "~");
    options = parameters.detector;
  }
  if (a.beta > 0) options.beta = a.beta;
  if (a.min_similarity >= 0.0) options.min_similarity = a.min_similarity;
  return options;
}

// delta for a sequence, from ten pairs of consecutive images all over it.
int estimateDeltaOf(const ImageSource& source, const LoopDetectorOptions& options) {
  const FeatureExtractor extractor(options.features);
  std::vector<std::pair<Features, Features>> pairs;
  constexpr std::size_t kPairs = 10;
  for (std::size_t i = 0; i < kPairs && source.size() > 1; ++i) {
    const std::size_t first = i * (source.size() - 1) / kPairs;
    pairs.emplace_back(extractor.extract(source.image(first)), extractor.extract(source.image(first + 1)));
  }
  return estimateDelta(pairs);
}

Run detect(const ImageSource& source, LoopDetector& detector, const Arguments& a, const std::string& what) {
  Run run;
  mapping_common::Progress progress(what);
  std::vector<int> index_of;  // image of the detector -> of the source; they differ where one can't be read
  for (std::size_t i = 0; i < source.size(); ++i) {
    Frame frame;
    try {
      frame.image = source.image(i);
      if (!a.camera.empty()) frame.camera = Camera{a.camera[0], a.camera[1], a.camera[2], a.camera[3]};
      if (!a.right.empty()) {
        frame.right = {source.right(i), a.baseline, a.camera[2]};
        if (frame.right->image.empty()) frame.right.reset();  // none of that time
      }
    } catch (const std::exception& e) {
      progress.say("left out: ", e.what());
      ++run.unreadable;
      run.similarities.emplace_back(i, 0.0);
      continue;
    }
    const auto start = Clock::now();
    auto last = start;
    const auto ms = [](Clock::duration d) { return std::chrono::duration<double, std::milli>(d).count(); };
    Detection detection = detector.process(frame, [&](Stage stage) {
      const auto now = Clock::now();
      run.stages[static_cast<int>(stage)].add(ms(now - last));
      last = now;
    });
    run.total.add(ms(last - start));
    const int before = detection.image - static_cast<int>(index_of.size());  // images of a loaded vocabulary
    index_of.push_back(static_cast<int>(i));
    std::vector<double> row(i, 0.0);
    for (std::size_t j = 0; j + 1 < index_of.size(); ++j)
      row[index_of[j]] = detection.similarities[before + j];
    run.similarities.push_back(std::move(row));
    const auto propose = [&](const Loop& loop, bool accepted) {
      if (loop.match < before) return;
      const Proposal proposal{index_of[loop.query - before], index_of[loop.match - before], loop.similarity,
                              accepted};
      const auto at = std::lower_bound(run.proposals.begin(), run.proposals.end(), proposal.query,
                                       [](const Proposal& p, int query) { return p.query < query; });
      const auto geometry = run.geometry.begin() + (at - run.proposals.begin());
      if (at != run.proposals.end() && at->query == proposal.query) {
        *at = proposal;
        *geometry = loop.geometry;
      } else {
        run.proposals.insert(at, proposal);
        run.geometry.insert(geometry, loop.geometry);
      }
    };
    if (detection.best) propose(*detection.best, detection.accepted);
    for (const Loop& loop : detection.earlier) propose(loop, true);
    progress.show("image ", i + 1, " of ", source.size());
  }
  progress.say(source.size(), " images");
  run.words = detector.vocabulary().size();
  return run;
}

// ------------------------------------------------------------------------------------------------------
// output

void writeText(const std::string& path, const std::string& text) {
  mapping_common::writeFile(path, [&text](std::ostream& out) { out << text; });
}

void writePicture(const std::string& path, const cv::Mat& picture) {
  if (!picture.empty() && !cv::imwrite(path, picture)) throw std::runtime_error(path + " can't be written");
}

// Whether a loop is right stays empty where there is no ground truth.
std::string loopsCsv(const Run& run, const std::optional<GroundTruth>& truth) {
  std::ostringstream out;
  out << "query,match,similarity,correct\n";
  for (const Proposal& p : run.proposals) {
    if (!p.accepted) continue;
    out << p.query << ',' << p.match << ',' << p.similarity << ',';
    if (truth) out << truth->isLoop(p.query, p.match);
    out << '\n';
  }
  return out.str();
}

// The greatest similarity of blocks of images, so that there are at most kRows of them.
std::string similaritiesCsv(const std::vector<std::vector<double>>& similarities) {
  constexpr std::size_t kRows = 1000;
  const std::size_t block = std::max<std::size_t>(1, (similarities.size() + kRows - 1) / kRows);
  std::ostringstream out;
  out << "query,match,similarity\n" << std::setprecision(3);
  for (std::size_t query = 0; query < similarities.size(); query += block) {
    const std::size_t end = std::min(query + block, similarities.size());
    std::vector<double> greatest(query / block + 1, 0.0);
    for (std::size_t i = query; i < end; ++i) {
      for (std::size_t j = 0; j < similarities[i].size(); ++j)
        greatest[j / block] = std::max(greatest[j / block], similarities[i][j]);
    }
    for (std::size_t j = 0; j < greatest.size(); ++j)
      out << query << ',' << j * block << ',' << greatest[j] << '\n';
  }
  return out.str();
}

std::string trajectoryCsv(const std::vector<Eigen::Isometry3d>& poses, const std::vector<int>& lengths) {
  std::ostringstream out;
  out << "image,sequence,x,y,z\n";
  int image = 0;
  for (std::size_t sequence = 0; sequence < lengths.size(); ++sequence) {
    for (const int end = image + lengths[sequence]; image < end; ++image) {
      const Eigen::Vector3d at = poses[image].translation();
      out << image << ',' << sequence << ',' << at.x() << ',' << at.y() << ',' << at.z() << '\n';
    }
  }
  return out.str();
}

// Poses of the query's camera seen from the match's.
std::string transformsCsv(const Run& run) {
  std::ostringstream out;
  out << "query,match,x,y,z,qx,qy,qz,qw,inliers\n";
  for (std::size_t i = 0; i < run.proposals.size(); ++i) {
    const Proposal& p = run.proposals[i];
    if (!p.accepted || !run.geometry[i].pose) continue;
    const RelativePose& pose = *run.geometry[i].pose;
    const Eigen::Vector3d t = pose.transform.translation();
    const Eigen::Quaterniond q(pose.transform.linear());
    out << p.query << ',' << p.match << ',' << t.x() << ',' << t.y() << ',' << t.z() << ',' << q.x() << ','
        << q.y() << ',' << q.z() << ',' << q.w() << ',' << pose.inliers << '\n';
  }
  return out.str();
}

// Precision (0 to 1) over recall (Fig. 4.17).
struct NamedCurve {
  std::string name;
  std::vector<CurvePoint> points;
};

// At the end the loops that were accepted, without a threshold.
std::string curveCsv(const std::vector<NamedCurve>& curves, const PrecisionRecall& accepted) {
  std::ostringstream out;
  out << "curve,threshold,detected,correct,precision,recall\n";
  const auto write = [&out](const PrecisionRecall& at) {
    out << at.detected << ',' << at.correct << ',' << at.precision() << ',' << at.recall() << '\n';
  };
  for (const NamedCurve& curve : curves) {
    for (const CurvePoint& p : curve.points) {
      out << curve.name << ',' << p.threshold << ',';
      write(p.at);
    }
  }
  out << "accepted,,";
  write(accepted);
  return out.str();
}

std::string timingTable(const Run& run) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(3) << "| Property |";
  for (int s = 0; s < kStages; ++s) out << ' ' << stageName(static_cast<Stage>(s)) << " |";
  out << " Total |\n|---|";
  for (int s = 0; s <= kStages; ++s) out << "---|";
  out << "\n| Mean (ms) |";
  for (const Times& t : run.stages) out << ' ' << t.mean() << " |";
  out << ' ' << run.total.mean() << " |\n| Standard deviation (ms) |";
  for (const Times& t : run.stages) out << ' ' << t.deviation() << " |";
  out << ' ' << run.total.deviation() << " |\n";
  return out.str();
}

std::string timingJson(const Run& run) {
  std::ostringstream out;
  out << "{\n  \"words\": " << run.words << ",\n  \"total_ms\": {\"mean\": " << run.total.mean()
      << ", \"standard_deviation\": " << run.total.deviation() << "},\n  \"stages_ms\": {";
  for (int s = 0; s < kStages; ++s) {
    out << (s > 0 ? "," : "") << "\n    \"" << stageName(static_cast<Stage>(s))
        << "\": {\"mean\": " << run.stages[s].mean()
        << ", \"standard_deviation\": " << run.stages[s].deviation() << '}';
  }
  out << "\n  }\n}\n";
  return out.str();
}

// Fig. 4.19, pairs spread over all accepted loops.
cv::Mat pictureOfPairs(const ImageSource& source, const Run& run, const LoopDetector& detector, int count) {
  std::vector<std::size_t> accepted;
  for (std::size_t i = 0; i < run.proposals.size(); ++i) {
    if (run.proposals[i].accepted) accepted.push_back(i);
  }
  std::vector<cv::Mat> pictures;
  const std::size_t pairs = std::min<std::size_t>(count, accepted.size());
  for (std::size_t k = 0; k < pairs; ++k) {
    const std::size_t i = accepted[k * accepted.size() / pairs];
    const Proposal& p = run.proposals[i];
    const cv::Mat query = source.image(p.query), match = source.image(p.match);
    std::vector<std::pair<cv::Point2f, cv::Point2f>> points;
    if (run.unreadable == 0 && detector.images() == static_cast<int>(source.size())) {
      const View &q = detector.view(p.query), &m = detector.view(p.match);  // of images that were scaled down
      for (const Match& pair : run.geometry[i].pairs) {
        points.emplace_back(q.features.points[pair.a] * (static_cast<float>(query.cols) / q.size.width),
                            m.features.points[pair.b] * (static_cast<float>(match.cols) / m.size.width));
      }
    }
    std::ostringstream caption;
    caption << "image " << p.match << " (left) and " << p.query << " (right), similarity "
            << std::setprecision(2) << p.similarity << ", " << run.geometry[i].inliers << " inliers";
    pictures.push_back(drawPair(query, match, points, caption.str()));
  }
  return stack(pictures);
}

void report(const std::string& name, const PrecisionRecall& r) {
  std::cout << name << ": " << r.detected << " loops, " << r.correct << " of them correct; " << r.loops
            << " images have a loop. Precision " << std::fixed << std::setprecision(2)
            << 100.0 * r.precision() << " %, recall " << 100.0 * r.recall() << " %\n"
            << std::defaultfloat;
}

std::optional<GroundTruth> groundTruthOf(const Arguments& a, const ImageSource& source,
                                         const std::vector<Eigen::Isometry3d>& poses) {
  if (!a.ground_truth.empty())
    return GroundTruth::fromIntervals(a.ground_truth, source.ids(a.ids == "names"), a.tolerance);
  if (a.walks >= 0) return GroundTruth::fromWalks(source.lengths(), a.walks);
  if (!poses.empty())
    return GroundTruth::fromPoses(poses, a.max_distance, a.max_angle * CV_PI / 180.0, a.gap);
  return {};
}

const char kUsage[] =
    "Usage: loop_closure_images --images DIR [--images DIR2 ...] --out DIR\n"
    "       loop_closure_images --bag FILE --image TOPIC --out DIR\n"
    "\nLoop closures of a sequence of images.\n";

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description options("Options");
  // clang-format off
  options.add_options()
      ("help,h", "this text")
      ("images", po::value(&a.images), "folder of images; several are one sequence, one after the other")
      ("bag", po::value(&a.bag), "recording, instead of folders")
      ("image", po::value(&a.topic), "the recording's topic of images, raw or compressed")
      ("right", po::value(&a.right), "folder of the right images of a stereo camera, for each of --images, or the recording's topic of them; needs --camera and --baseline")
      ("camera", po::value(&a.camera)->multitoken(), "fx fy cx cy of the rectified images, pixels: the essential matrix in place of the fundamental one")
      ("baseline", po::value(&a.baseline)->default_value(0.0), "of the stereo camera, m")
      ("out", po::value(&a.out)->required(), "folder for what comes out; made if it isn't there")
      ("ground-truth", po::value(&a.ground_truth), "intervals: rows \"query first last\"")
      ("ids", po::value(&a.ids)->default_value("index"), "what the numbers in ground truth and poses are: index (from 0) | names (those in the files' names)")
      ("tolerance", po::value(&a.tolerance)->default_value(0), "images that the intervals are widened by")
      ("walks", po::value(&a.walks), "ground truth for folders that are walks of one route: image i of each is the same place, to within this many images")
      ("poses", po::value(&a.poses), "camera poses, one a row: 3x4, number and 3x4, 4x4, or time, position, quaternion; for the picture of the trajectory and as ground truth")
      ("max-distance", po::value(&a.max_distance)->default_value(2.0), "poses as ground truth: m")
      ("max-angle", po::value(&a.max_angle)->default_value(45.0), "poses as ground truth: degrees between the optical axes")
      ("gap", po::value(&a.gap)->default_value(50), "poses as ground truth: images that a loop's two are apart at least")
      ("config", po::value(&a.config), "YAML file with the nodelet's parameters, of which those of the detector are taken")
      ("method", po::value(&a.method)->default_value("full"), "full | thesis | thesis+grouping | thesis+geometry")
      ("delta", po::value(&a.delta), "Hamming threshold in bits, or auto: estimated from consecutive images")
      ("deltas", po::value(&a.deltas)->multitoken(), "more values of delta for the precision-recall curves")
      ("beta", po::value(&a.beta), "temporal constraint, images")
      ("min-similarity", po::value(&a.min_similarity), "of an accepted loop, without the geometric check")
      ("pairs", po::value(&a.pairs)->default_value(6), "pairs in the picture of matched pairs")
      ("load", po::value(&a.load), "vocabulary to start with")
      ("save", po::value(&a.save), "where the vocabulary goes to")
      ("threads", po::value(&a.threads)->default_value(1), "that OpenCV may use");
  // clang-format on
  if (!mapping_common::parseArguments(argc, argv, kUsage, options)) return false;
  const std::vector<std::string> methods = {"full", "thesis", "thesis+grouping", "thesis+geometry"};
  if (std::find(methods.begin(), methods.end(), a.method) == methods.end())
    throw std::invalid_argument("--method is " + a.method +
                                ", allowed is full, thesis, thesis+grouping, thesis+geometry");
  if (a.ids != "index" && a.ids != "names")
    throw std::invalid_argument("--ids is " + a.ids + ", allowed is index, names");
  if (a.images.empty() == a.bag.empty()) throw std::invalid_argument("either --images or --bag is needed");
  if (!a.bag.empty() && a.topic.empty()) throw std::invalid_argument("--bag needs --image TOPIC");
  if (!a.camera.empty() && a.camera.size() != 4)
    throw std::invalid_argument("--camera has " + std::to_string(a.camera.size()) +
                                " numbers, expected are four: fx fy cx cy");
  if (!a.right.empty() && (a.camera.empty() || !(a.baseline > 0.0)))
    throw std::invalid_argument("--right needs --camera, and --baseline greater than 0");
  return true;
}

void setDelta(LoopDetectorOptions& options, int delta) {
  if (options.tracking_delta == options.delta) options.tracking_delta = delta;  // the thesis has one
  options.delta = delta;
}

// Precision and recall, with other values of delta, too.
std::string measure(const Arguments& a, const ImageSource& source, const LoopDetectorOptions& options,
                    const Run& run, const GroundTruth& truth) {
  const PrecisionRecall accepted = evaluate(run.proposals, truth);
  report("Operating point", accepted);
  std::vector<NamedCurve> curves = {
      {"delta " + std::to_string(options.delta), precisionRecallCurve(run.proposals, truth)}};
  for (const std::string& delta : a.deltas) {
    LoopDetectorOptions other = options;
    setDelta(other, std::stoi(delta));
    LoopDetector another(other);
    curves.push_back({"delta " + delta,
                      precisionRecallCurve(detect(source, another, a, "delta " + delta).proposals, truth)});
  }
  for (const NamedCurve& curve : curves) {
    const auto best = bestAtFullPrecision(curve.points);
    report(curve.name + ", best threshold at full precision",
           best ? best->at : PrecisionRecall{0, 0, truth.loops()});
  }
  return curveCsv(curves, accepted);
}

void run(const Arguments& a) {
  cv::setNumThreads(a.threads);
  const auto source = a.bag.empty() ? openFolders(a.images, a.right)
                                    : openBag(a.bag, a.topic, a.right.empty() ? "" : a.right[0]);
  std::filesystem::create_directories(a.out);
  std::vector<Eigen::Isometry3d> poses;
  if (!a.poses.empty()) poses = loadPoses(a.poses, source->ids(a.ids == "names"));
  const std::optional<GroundTruth> truth = groundTruthOf(a, *source, poses);

  LoopDetectorOptions options = optionsOf(a);
  if (a.delta == "auto") {
    const int delta = estimateDeltaOf(*source, options);
    if (delta == 0) throw std::runtime_error("delta can't be estimated: consecutive images hardly match");
    std::cout << "delta estimated from consecutive images: " << delta << '\n';
    setDelta(options, delta);
  } else if (!a.delta.empty()) {
    setDelta(options, std::stoi(a.delta));
  }
  LoopDetector detector(options);
  if (!a.load.empty()) detector.load(a.load);
  const Run result = detect(*source, detector, a, "loop_closure_images");

  writeText(a.out + "/loops.csv", loopsCsv(result, truth));
  if (!a.right.empty()) writeText(a.out + "/transforms.csv", transformsCsv(result));
  writeText(a.out + "/timing.md", timingTable(result));
  writeText(a.out + "/timing.json", timingJson(result));
  writeText(a.out + "/similarity.csv", similaritiesCsv(result.similarities));
  if (!poses.empty()) writeText(a.out + "/trajectory.csv", trajectoryCsv(poses, source->lengths()));
  writePicture(a.out + "/pairs.png", pictureOfPairs(*source, result, detector, a.pairs));
  if (!a.save.empty()) detector.save(a.save);

  const auto accepted = std::count_if(result.proposals.begin(), result.proposals.end(),
                                      [](const Proposal& p) { return p.accepted; });
  std::cout << source->size() << " images, " << result.words << " words, " << accepted << " loops accepted, "
            << std::setprecision(3) << result.total.mean() << " ms per image\n";
  if (result.unreadable > 0) std::cout << result.unreadable << " images could not be read\n";
  if (truth) writeText(a.out + "/precision_recall.csv", measure(a, *source, options, result, *truth));
  mapping_common::drawFigures("loop_closure_images", "plot_loops.py", {a.out});
}

}  // namespace
}  // namespace ibuild_loop_closure

int main(int argc, char** argv) {
  using namespace ibuild_loop_closure;
  return mapping_common::runTool(argc, argv, "loop_closure_images", kUsage, parse, run);
}
