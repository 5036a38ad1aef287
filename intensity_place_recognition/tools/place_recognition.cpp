// SPDX-License-Identifier: BSD-3-Clause
//
// Places in recorded scans: which scan shows the place of which, and from where.
#include <ibuild_loop_closure/evaluation.h>
#include <mapping_common/files.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/converters/bag_scans.h>
#include <rosbag_tests/converters/scan_files.h>
#include <rosbag_tests/converters/terrestrial_scans.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/program_options.hpp>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "intensity_place_recognition/pictures.h"
#include "intensity_place_recognition/place_recognizer.h"

namespace po = boost::program_options;
namespace fs = std::filesystem;
using namespace intensity_place_recognition;
using ibuild_loop_closure::CurvePoint;

namespace {

const char kUsage[] =
    "Usage: place_recognition --scans DIR [DIR...] [--poses FILE] | --files FILE [FILE...] |\n"
    "                         --bag FILE [--cloud TOPIC]   [options]\n"
    "\n"
    "Compares each scan with those before it, in the order of the folders' and files' names, and writes "
    "which shows\n"
    "the place of which, the pose between them, similarities, times and, with poses, precision and recall.\n";

struct Arguments {
  std::vector<std::string> scans, files;
  std::string poses, bag, out = "out", config, save;
  rosbag_tests::BagScansOptions bag_options;
  double distance = 5.0, voxel = 0.05;
  int gap = 1, pictures = 50;
  PlaceRecognizerOptions recognizer;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("scans", po::value(&a.scans)->composing()->multitoken(),
      "folders of scans: NNNN.bin[.xz] (KITTI's, or a Livox scanner's as in HeLiPR), PCD or UOS");
  add("poses", po::value(&a.poses),
      "pose file of the .bin scans of one folder; by default its poses*.txt, if any");
  add("files", po::value(&a.files)->composing()->multitoken(),
      "files of a terrestrial scanner (E57, PTX, PTS, ASC), of one scan or several, or folders of them");
  add("voxel", po::value(&a.voxel)->default_value(a.voxel),
      "m, edge of voxels of which each becomes the mean of its points in --files; 0: all points");
  add("bag", po::value(&a.bag), "ROS 1 bag");
  add("cloud", po::value(&a.bag_options.topic), "its PointCloud2 topic; by default the only one");
  add("fixed-frame", po::value(&a.bag_options.fixed_frame)->default_value(""),
      "frame of its tf that poses are looked up in: the truth for precision and recall");
  add("out", po::value(&a.out)->default_value(a.out), "folder for the results");
  add("distance", po::value(&a.distance)->default_value(a.distance),
      "m, between the poses of scans that show the same place");
  add("gap", po::value(&a.gap)->default_value(a.gap),
      "scans between two that show the same place, at least: not to find again what was just left");
  add("pictures", po::value(&a.pictures)->default_value(a.pictures), "of accepted pairs, at most");
  add("config", po::value(&a.config), "parameters, a YAML file as the nodelet's");
  add("save", po::value(&a.save), "write the database of places to this file, for the nodelet");
  std::string type, image, views;
  add("description", po::value(&type),
      "type of description in place of the configured one, see parameters.md");
  add("image", po::value(&image), "intensity | range, that is described of a panorama");
  add("views", po::value(&views), "panorama | front | front_and_back");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (int(a.scans.empty()) + int(a.files.empty()) + int(a.bag.empty()) != 2)
    throw po::error("give either --scans, --files or --bag");
  if (!(a.voxel == 0.0 || (a.voxel >= 1e-3 && a.voxel < 10.0)))
    throw po::error("--voxel is 0, or 0.001 to 10 m");
  if (!a.poses.empty() && a.scans.size() != 1) throw po::error("--poses is for one folder of --scans");
  if (a.gap < 1) throw po::error("--gap is at least 1");
  mapping_common::OptionValues values;
  if (!a.config.empty()) {
    // The nodelet's own parameters are none of the method's.
    mapping_common::OptionList known = mapping_common::optionsOf(a.recognizer);
    for (const auto& [name, value] : mapping_common::loadYaml(a.config))
      if (known.find(name)) values[name] = value;
  }
  if (!type.empty()) values["description/type"] = type;
  if (!image.empty()) values["description/image"] = image;
  if (!views.empty()) values["description/views"] = views;
  mapping_common::assign(a.recognizer, values);
  a.recognizer.beta = a.gap - 1;
  return true;
}

struct Scan {
  std::string name;
  int folder = 0;
  bool has_pose = false;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  int place = -1;  // -1: it was refused
  std::string refused;
  cv::Mat1b picture;
};

struct Source {
  std::string name;
  std::unique_ptr<rosbag_tests::ScanSource> scans;
};

// The same whatever order they were given in.
std::vector<Source> openAll(const Arguments& a) {
  std::vector<Source> sources;
  if (!a.bag.empty()) {
    rosbag_tests::BagScansOptions options = a.bag_options;
    options.need_poses = !options.fixed_frame.empty();
    sources.push_back({a.bag, std::make_unique<rosbag_tests::BagScans>(a.bag, options)});
  }
  // Their names are whole paths, and their poses are in one frame, if any are known.
  if (!a.files.empty()) sources.push_back({"", rosbag_tests::openTerrestrialScans(a.files, a.voxel)});
  std::vector<std::string> folders;
  for (const std::string& folder : a.scans) {
    if (!fs::exists(folder)) throw std::runtime_error(folder + ": no such file or folder");
    folders.push_back(fs::canonical(folder).string());
  }
  std::sort(folders.begin(), folders.end());
  folders.erase(std::unique(folders.begin(), folders.end()), folders.end());
  for (const std::string& folder : folders)
    sources.push_back(
        {folder, rosbag_tests::openScans(folder, a.poses, rosbag_tests::PcdFrame::kMap, false)});
  return sources;
}

struct Times {
  double sum[kStages + 1] = {}, longest[kStages + 1] = {};
  int count = 0;
};

double processorTime() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

// Reads and recognises all. Recognitions' numbers are those of scans.
std::vector<Recognition> recognizeAll(std::vector<Source>& sources, const Arguments& a,
                                      PlaceRecognizer& recognizer, std::vector<Scan>& scans, Times& times) {
  std::vector<Recognition> found;
  std::vector<int> scan_of_place;
  mapping_simulation::PosedScan posed;
  for (std::size_t s = 0; s < sources.size(); ++s) {
    const std::size_t first = scans.size();
    bool moved = false;  // without poses, all are the identity
    for (std::size_t left = sources[s].scans->size(); left > 0; --left) {
      Scan scan;
      scan.folder = static_cast<int>(s);
      Recognition result;
      try {
        if (!sources[s].scans->next(posed)) break;
        scan.name = (fs::path(sources[s].name) / posed.name).string();
        scan.pose = posed.pose;
        scan.has_pose = true;
        moved = moved || !scan.pose.matrix().isIdentity(1e-9);
        const double start = processorTime();
        double last = start;
        double seconds[kStages + 1] = {};
        result = recognizer.process(posed.cloud, [&](Stage stage) {
          const double now = processorTime();
          seconds[static_cast<int>(stage)] = now - last;
          last = now;
        });
        seconds[kStages] = last - start;
        for (int i = 0; i <= kStages; ++i) {
          times.sum[i] += seconds[i];
          times.longest[i] = std::max(times.longest[i], seconds[i]);
        }
        ++times.count;
        scan.place = static_cast<int>(scan_of_place.size());
        scan_of_place.push_back(static_cast<int>(scans.size()));
        if (result.match >= 0) result.match = scan_of_place[result.match];
        scan.picture = toPicture(toPanorama(posed.cloud, a.recognizer.panorama, a.recognizer.largest_hole));
      } catch (const std::runtime_error& e) {
        scan.refused = e.what();
      } catch (const std::invalid_argument& e) {
        scan.refused = e.what();
      }
      if (!scan.refused.empty())
        std::cerr << "place_recognition: scan " << scans.size() << (scan.name.empty() ? "" : " ") << scan.name
                  << " is left out: " << scan.refused << '\n';
      result.query = static_cast<int>(scans.size());
      found.push_back(result);
      scans.push_back(std::move(scan));
    }
    for (std::size_t i = first; i < scans.size(); ++i) scans[i].has_pose = scans[i].has_pose && moved;
  }
  return found;
}

void writePlaces(const std::vector<Recognition>& found, const PlaceRecognizerOptions& options,
                 const std::string& path) {
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << "query,match,score,accepted,x,y,z,qx,qy,qz,qw,evidence,margin,pieces,refused\n"
        << std::fixed << std::setprecision(6);
    for (const Recognition& r : found) {
      const Eigen::Vector3d t = r.registration.pose.translation();
      Eigen::Quaterniond q(r.registration.pose.rotation());
      if (q.w() < 0.0) q.coeffs() *= -1.0;
      out << r.query << ',' << r.match << ',' << r.registration.score << ',' << r.registration.accepted;
      for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) out << ',' << value;
      out << ',' << r.registration.evidence << ',' << r.margin << ',' << r.registration.intensity.pieces
          << ',' << std::quoted(refusal(r, options), '"', '"') << '\n';
    }
  });
}

void writeSimilarities(const PlaceRecognizer& recognizer, const std::vector<Scan>& scans,
                       const std::string& out) {
  const int n = static_cast<int>(scans.size());
  cv::Mat1f matrix(n, n, 0.0f);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j) {
      if (scans[i].place < 0 || scans[j].place < 0) continue;
      matrix(i, j) = matrix(j, i) = recognizer.description().similarity(scans[i].place, scans[j].place);
    }
  }
  mapping_common::writeFile(out + "/similarity.csv", [&](std::ostream& file) {
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) file << matrix(i, j) << (j + 1 < n ? ',' : '\n');
  });
  if (n > 0) cv::imwrite(out + "/similarity.png", drawMatrix(matrix));
}

// By the poses, which those of one folder have in the same frame.
ibuild_loop_closure::GroundTruth truthOf(const std::vector<Scan>& scans, const Arguments& a) {
  ibuild_loop_closure::GroundTruth truth(static_cast<int>(scans.size()));
  for (int i = 0; i < static_cast<int>(scans.size()); ++i) {
    for (int j = 0; j <= i - a.gap; ++j) {
      const Scan &query = scans[i], &match = scans[j];
      if (query.has_pose && match.has_pose && query.folder == match.folder &&
          (query.pose.translation() - match.pose.translation()).norm() < a.distance)
        truth.add(i, {j, j});
    }
  }
  return truth;
}

void writePrecisionRecall(const std::vector<Recognition>& found, const std::vector<Scan>& scans,
                          const Arguments& a) {
  const ibuild_loop_closure::GroundTruth truth = truthOf(scans, a);
  if (truth.loops() == 0) {
    std::cout << "No poses of scans that show the same place: no precision and recall\n";
    return;
  }
  std::vector<ibuild_loop_closure::Proposal> proposals;
  std::vector<std::string> wrong;
  for (const Recognition& r : found) {
    if (!scans[r.query].has_pose || r.match < 0) continue;
    proposals.push_back({r.query, r.match, confidence(r, a.recognizer), r.registration.accepted});
    if (r.registration.accepted && !truth.isLoop(r.query, r.match))
      wrong.push_back(std::to_string(r.query) + " at " + std::to_string(r.match));
  }
  const std::vector<CurvePoint> curve = ibuild_loop_closure::precisionRecallCurve(proposals, truth);
  std::vector<cv::Point2d> points;
  mapping_common::writeFile(a.out + "/precision_recall.csv", [&](std::ostream& out) {
    out << "threshold,precision,recall\n";
    for (const CurvePoint& p : curve) {
      out << p.threshold << ',' << p.at.precision() << ',' << p.at.recall() << '\n';
      points.emplace_back(p.at.recall(), p.at.precision());
    }
  });
  cv::imwrite(a.out + "/precision_recall.png", drawPrecisionRecall(points));
  const auto best = ibuild_loop_closure::bestAtFullPrecision(curve);
  double full = 0.0;
  for (const CurvePoint& p : curve)
    if (p.at.correct == curve.back().at.correct) full = std::max(full, p.at.precision());
  const ibuild_loop_closure::PrecisionRecall at = ibuild_loop_closure::evaluate(proposals, truth);
  std::cout << std::fixed << std::setprecision(1) << "With poses: " << truth.loops()
            << " scans show an earlier place\n"
            << "  accepted: precision " << 100.0 * at.precision() << " %, recall " << 100.0 * at.recall()
            << " %\n"
            << "  greatest recall at full precision " << (best ? 100.0 * best->at.recall() : 0.0) << " %\n"
            << "  greatest precision at greatest recall (" << 100.0 * curve.back().at.recall() << " %) "
            << 100.0 * full << " %\n";
  for (const std::string& pair : wrong) std::cout << "  wrong by the poses: " << pair << '\n';
}

// Errors of accepted pairs by the poses of one folder, and how large they are by their covariances.
void writeErrors(const std::vector<Recognition>& found, const std::vector<Scan>& scans, const Arguments& a) {
  std::ostringstream rows;
  rows << "query,match,x,y,z,rx,ry,rz,sx,sy,sz,srx,sry,srz,squared\n" << std::setprecision(6);
  std::vector<double> distances, squares;
  Eigen::Matrix<double, 6, 1> sums = Eigen::Matrix<double, 6, 1>::Zero();
  for (const Recognition& r : found) {
    if (!r.registration.accepted) continue;
    const Scan &query = scans[r.query], &match = scans[r.match];
    if (!query.has_pose || !match.has_pose || query.folder != match.folder) continue;
    // About the axes of the match, as the covariance is.
    const Eigen::Isometry3d difference =
        r.registration.pose * (match.pose.inverse() * query.pose).inverse(Eigen::Isometry);
    const Eigen::AngleAxisd turn(difference.rotation());
    Eigen::Matrix<double, 6, 1> error;
    error << difference.translation(), turn.angle() * turn.axis();
    const Eigen::Matrix<double, 6, 1> deviation = r.registration.covariance.diagonal().cwiseSqrt();
    distances.push_back(
        (r.registration.pose.translation() - (match.pose.inverse() * query.pose).translation()).norm());
    squares.push_back(error.dot(r.registration.covariance.ldlt().solve(error)) / 6.0);
    sums += error.cwiseQuotient(deviation).cwiseAbs2();
    rows << r.query << ',' << r.match;
    for (const double value : error) rows << ',' << value;
    for (const double value : deviation) rows << ',' << value;
    rows << ',' << squares.back() << '\n';
  }
  mapping_common::writeFile(a.out + "/errors.csv", [&](std::ostream& out) { out << rows.str(); });
  if (squares.empty()) return;
  const auto count = static_cast<double>(squares.size());
  sums = (sums / count).cwiseSqrt();
  const auto median = [](std::vector<double> all) {
    std::nth_element(all.begin(), all.begin() + all.size() / 2, all.end());
    return all[all.size() / 2];
  };
  std::cout << std::setprecision(4) << "Errors of " << squares.size()
            << " accepted pairs by the poses: " << median(distances) << " m at the median, at most "
            << *std::max_element(distances.begin(), distances.end()) << " m\n"
            << std::setprecision(2)
            << "  in standard deviations of x y z and about them, r.m.s.: " << sums.transpose()
            << "\n  squared by the covariance, of each degree of freedom: "
            << std::accumulate(squares.begin(), squares.end(), 0.0) / count << ", " << median(squares)
            << " at the median, where 1 is right\n";
}

void writeTimes(const Times& times, const std::string& path) {
  mapping_common::writeFile(path, [&](std::ostream& out) {
    out << "stage,mean_ms,longest_ms\n";
    for (int i = 0; i <= kStages; ++i)
      out << (i < kStages ? stageName(static_cast<Stage>(i)) : "All") << ','
          << 1e3 * times.sum[i] / std::max(1, times.count) << ',' << 1e3 * times.longest[i] << '\n';
  });
  std::cout << std::fixed << std::setprecision(1)
            << "Processor time per scan: " << 1e3 * times.sum[kStages] / std::max(1, times.count)
            << " ms, at most " << 1e3 * times.longest[kStages] << " ms\n";
}

void run(const Arguments& a) {
  std::vector<Source> sources = openAll(a);
  fs::create_directories(a.out);
  PlaceRecognizer recognizer(a.recognizer);
  std::vector<Scan> scans;
  Times times;
  const std::vector<Recognition> found = recognizeAll(sources, a, recognizer, scans, times);
  if (recognizer.places() == 0) throw std::runtime_error("there is no scan that can be described");

  writePlaces(found, a.recognizer, a.out + "/places.csv");
  mapping_common::writeFile(a.out + "/scans.csv", [&](std::ostream& out) {
    out << "number,file,refused\n";
    for (std::size_t i = 0; i < scans.size(); ++i)
      out << i << ',' << std::quoted(scans[i].name, '"', '"') << ','
          << std::quoted(scans[i].refused, '"', '"') << '\n';
  });
  writeSimilarities(recognizer, scans, a.out);
  int accepted = 0;
  for (const Recognition& r : found) {
    if (!r.registration.accepted || accepted++ >= a.pictures) continue;
    fs::create_directories(a.out + "/pairs");
    std::ostringstream caption;
    caption << "scan " << r.match << " (above) and " << r.query << " (below), score " << std::setprecision(2)
            << r.registration.score;
    const Eigen::Matrix3d rotation = r.registration.pose.rotation();
    cv::imwrite(a.out + "/pairs/" + std::to_string(r.query) + '_' + std::to_string(r.match) + ".png",
                drawPlaces(scans[r.query].picture, scans[r.match].picture,
                           std::atan2(rotation(1, 0), rotation(0, 0)), caption.str()));
  }
  std::cout << recognizer.places() << " of " << scans.size() << " scans described, " << accepted
            << " recognised as earlier places\n";
  writePrecisionRecall(found, scans, a);
  writeErrors(found, scans, a);
  writeTimes(times, a.out + "/times.csv");
  if (!a.save.empty()) recognizer.save(a.save);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "place_recognition", kUsage, parse, run);
}
