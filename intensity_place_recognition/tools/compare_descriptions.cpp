// SPDX-License-Identifier: BSD-3-Clause
//
// The comparison of section 4.6.2: how well places are told apart by each description alone, of intensities,
// of ranges and of camera images. All similarities are thresholded as in 4.5.3; nothing is verified.
#include <mapping_common/files.h>
#include <mapping_common/markdown_table.h>
#include <mapping_common/progress.h>
#include <mapping_common/tool.h>
#include <rosbag_tests/converters/scan_files.h>

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <limits>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "intensity_place_recognition/pictures.h"
#include "intensity_place_recognition/place_recognizer.h"
#include "intensity_place_recognition/scan_check.h"
#include "intensity_place_recognition/similarity_matrix.h"

namespace po = boost::program_options;
namespace fs = std::filesystem;
using namespace intensity_place_recognition;

namespace {

const char kUsage[] =
    "Usage: compare_descriptions --scans DIR [--poses FILE] [--front DIR] [--back DIR] --out DIR   "
    "[options]\n"
    "\n"
    "Describes all scans (and images) in each way, compares all with all, and writes for each way the "
    "greatest "
    "recall\n"
    "at full precision and the greatest precision at full recall, by the poses, and which of the thesis's "
    "claims hold.\n";

struct Arguments {
  std::string scans, poses, front, back, out = "out", config;
  std::vector<std::string> ways;
  double distance = 5.0, field_of_view = 90.0;
  int first = 10;
  PlaceRecognizerOptions recognizer;
};

bool parse(int argc, char** argv, Arguments& a) {
  po::options_description all("Options");
  auto add = all.add_options();
  add("help,h", "print this");
  add("scans", po::value(&a.scans)->required(), "folder of scans, as place_recognition reads them");
  add("poses", po::value(&a.poses), "their pose file; by default its poses*.txt");
  add("front", po::value(&a.front), "folder of a camera's images that look ahead, a PNG file a scan");
  add("back", po::value(&a.back), "of images that look back");
  add("field-of-view", po::value(&a.field_of_view)->default_value(a.field_of_view), "deg, of the cameras");
  add("out", po::value(&a.out)->default_value(a.out), "folder for the results");
  add("distance", po::value(&a.distance)->default_value(a.distance),
      "m, between the poses of scans that show the same place");
  add("way", po::value(&a.ways)->composing(),
      "a way to describe, as type=words,image=range,delta=0.4 (options of the group description; "
      "image=camera; "
      "or verified, the whole recognizer), or several: A+B fuses their similarities, of A:B the first says "
      "which scans the second compares. Any number of them; by default those of the thesis");
  add("first", po::value(&a.first)->default_value(a.first),
      "scans that look the most like each by A, which B compares, in A:B");
  add("config", po::value(&a.config), "parameters, a YAML file as the nodelet's");
  if (!mapping_common::parseArguments(argc, argv, kUsage, all)) return false;
  if (a.first < 1) throw po::error("--first is at least 1");
  if (!a.back.empty() && a.front.empty()) throw po::error("--back is beside --front");
  if (!a.config.empty()) {
    mapping_common::OptionValues values;
    mapping_common::OptionList known = mapping_common::optionsOf(a.recognizer);
    for (const auto& [name, value] : mapping_common::loadYaml(a.config))
      if (known.find(name)) values[name] = value;
    mapping_common::assign(a.recognizer, values);
  }
  if (a.ways.empty()) {
    a.ways = {"type=polar"};
    for (const std::string type : {"hog", "gist", "words", "binary"}) {
      for (const char* image : {"range", "intensity"}) a.ways.push_back("type=" + type + ",image=" + image);
      for (const std::string views : {"front", "front_and_back"}) {
        const std::string way = "type=" + type + ",views=" + views;
        a.ways.push_back(way + ",image=intensity");
        if (!(views == "front" ? a.front : a.back).empty()) a.ways.push_back(way + ",image=camera");
      }
    }
    for (const char* psi : {"0.1", "0.2", "0.4"})
      for (const std::string type : {"shot", "shot_colour"}) a.ways.push_back("type=" + type + ",psi=" + psi);
    for (const std::string type : {"polar", "gist,image=intensity"})
      for (const char* local : {"words", "binary"})
        a.ways.push_back("type=" + type + ":type=" + local + ",image=intensity");
    a.ways.emplace_back("verified");
    for (const std::string type : {"hog", "gist", "words", "binary"})
      if (!a.back.empty())
        a.ways.push_back("type=" + type + ",image=intensity+type=" + type +
                         ",views=front_and_back,image=camera");
  }
  return true;
}

/// A way to compare scenes, and what came of it.
struct Way {
  std::string name;
  bool camera = false;
  DescriptionOptions options;
  std::unique_ptr<SceneDescription> description;
  std::vector<int> scan;                        // of each place
  std::unique_ptr<PlaceRecognizer> recognizer;  // of the way that verifies
  std::vector<Recognition> recognitions;
  std::vector<std::size_t> parts;  // ways that are combined
  SimilarityMatrix similarities;
  double seconds = 0.0;
  double recall = 0.0, precision = 0.0;  // greatest, where the other is 1
};

Way wayOf(const std::string& text, const Arguments& a) {
  Way way;
  way.name = text;
  if (text == "verified") {
    way.recognizer = std::make_unique<PlaceRecognizer>(a.recognizer);
    return way;
  }
  way.options = a.recognizer.description;
  mapping_common::OptionList list = mapping_common::optionsOf(way.options);
  std::vector<std::string> parts;
  for (const std::string& part : boost::split(parts, text, boost::is_any_of(","))) {
    const std::size_t equals = part.find('=');
    const std::string name = part.substr(0, equals),
                      value = equals == std::string::npos ? "" : part.substr(equals + 1);
    if (name == "image" && value == "camera") {
      way.camera = true;
      continue;
    }
    mapping_common::Option* option = list.find(name);
    if (!option) throw std::runtime_error("--way " + text + ": a description has no option " + name);
    option->parse(value);
  }
  if (way.camera && (way.options.views == Views::kPanorama || a.front.empty() ||
                     (way.options.views == Views::kFrontAndBack && a.back.empty())))
    throw std::runtime_error("--way " + text +
                             ": cameras have views=front, of --front, or front_and_back, with --back");
  way.description = makeDescription(way.options);
  return way;
}

// The number of a way, which is put behind the parts that it has, where it isn't there yet.
std::size_t addWay(const std::string& text, const Arguments& a, std::vector<Way>& ways) {
  const auto known = std::find_if(ways.begin(), ways.end(), [&](const Way& w) { return w.name == text; });
  if (known != ways.end()) return known - ways.begin();
  std::vector<std::string> parts;
  boost::split(parts, text, boost::is_any_of("+:"));
  Way way;
  if (parts.size() == 1) {
    way = wayOf(text, a);
  } else {
    way.name = text;
    if (text.find(':') != std::string::npos && parts.size() > 2)
      throw std::runtime_error("--way " + text +
                               ": two ways are in turn, as A:B, or any number fused, as A+B+C");
    for (const std::string& part : parts) way.parts.push_back(addWay(part, a, ways));
  }
  ways.push_back(std::move(way));
  return ways.size() - 1;
}

View imageView(const std::string& folder, std::size_t number, double yaw, double field_of_view) {
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".png") files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  if (number >= files.size()) throw std::runtime_error(folder + " has fewer images than there are scans");
  const cv::Mat1b image = cv::imread(files[number], cv::IMREAD_GRAYSCALE);
  if (image.empty()) throw std::runtime_error(files[number] + " is no image");
  return viewOf(image, yaw, field_of_view * M_PI / 180.0);
}

// Of all scans with all. Parts are in front of those that they are combined to.
void compareAll(std::vector<Way>& ways, std::size_t scans, const Arguments& a) {
  const auto size = static_cast<Eigen::Index>(scans);
  for (Way& way : ways) {
    SimilarityMatrix& all = way.similarities;
    if (!way.parts.empty()) {
      std::vector<SimilarityMatrix> parts;
      for (const std::size_t part : way.parts) {
        parts.push_back(ways[part].similarities);
        way.seconds += ways[part].seconds;
      }
      const bool in_turn = way.name.find(':') != std::string::npos;
      all = in_turn ? confirmed(parts[0], parts[1], a.first) : fused(parts);
      continue;
    }
    all.setConstant(size, size, std::numeric_limits<float>::quiet_NaN());
    for (std::size_t i = 0; i < way.scan.size(); ++i) {
      const auto set = [&](std::size_t j, double value) {
        all(way.scan[i], way.scan[j]) = all(way.scan[j], way.scan[i]) = static_cast<float>(value);
      };
      if (!way.recognizer) {
        for (std::size_t j = 0; j < i; ++j)
          set(j, way.description->similarity(static_cast<int>(i), static_cast<int>(j)));
      } else if (way.recognitions[i].match >= 0) {
        set(way.recognitions[i].match, confidence(way.recognitions[i], a.recognizer));
      }
    }
  }
}

// 4.5.3, over all pairs of scans. Those that a way doesn't compare are never found.
void evaluate(Way& way, const std::vector<Eigen::Vector3d>& positions, const Arguments& a, int number) {
  struct Pair {
    float similarity;
    bool same;
  };
  std::vector<Pair> pairs;
  std::size_t all = 0, described = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const bool same = (positions[i] - positions[j]).norm() < a.distance;
      all += same;
      const float similarity = way.similarities(static_cast<int>(i), static_cast<int>(j));
      if (std::isnan(similarity)) continue;
      described += same;
      pairs.push_back({similarity, same});
    }
  }
  std::sort(pairs.begin(), pairs.end(),
            [](const Pair& a, const Pair& b) { return a.similarity > b.similarity; });
  std::vector<cv::Point2d> curve;
  std::ostringstream rows;
  rows << "similarity,precision,recall\n";
  std::size_t right = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    right += pairs[i].same;
    if (i + 1 < pairs.size() && pairs[i + 1].similarity == pairs[i].similarity) continue;
    const double precision = static_cast<double>(right) / static_cast<double>(i + 1),
                 recall = static_cast<double>(right) / static_cast<double>(std::max<std::size_t>(1, all));
    if (right == i + 1) way.recall = recall;
    if (right == all && way.precision == 0.0) way.precision = precision;
    curve.emplace_back(recall, precision);
    rows << pairs[i].similarity << ',' << precision << ',' << recall << '\n';
    if (right == described) break;
  }
  std::ostringstream path;
  path << a.out << "/curve_" << std::setw(2) << std::setfill('0') << number;
  mapping_common::writeFile(path.str() + ".csv", [&](std::ostream& out) {
    out << "# " << way.name << '\n' << rows.str();
  });
  cv::imwrite(path.str() + ".png", drawPrecisionRecall(curve));
  mapping_common::writeFile(path.str() + "_similarities.csv", [&](std::ostream& out) {
    out << way.similarities.format({Eigen::StreamPrecision, Eigen::DontAlignCols, ",", "\n"}) << '\n';
  });
}

std::string percent(double part) {
  char text[16];
  std::snprintf(text, sizeof(text), "%.1f", 100.0 * part);
  return text;
}

// Whether one is above the other, by both criteria of 4.6.2. Less than a hundredth is no difference.
void compare(const std::string& claim, const Way& above, const Way& below, std::ostream& out) {
  constexpr double kDifference = 0.01;
  const double recall = above.recall - below.recall, precision = above.precision - below.precision;
  const bool better = std::max(recall, precision) >= kDifference,
             worse = std::min(recall, precision) <= -kDifference;
  out << "- " << claim << ": "
      << (better ? (worse ? "holds in part" : "holds") : (worse ? "doesn't hold" : "no difference")) << " ("
      << percent(above.recall) << " / " << percent(above.precision) << " % against " << percent(below.recall)
      << " / " << percent(below.precision) << " %)\n";
}

// Those that the ways tell.
void writeClaims(const std::vector<Way>& ways, std::ostream& out) {
  std::map<std::string, const Way*> by;
  for (const Way& w : ways) {
    by[w.name] = &w;
    for (const std::size_t part : w.parts)
      compare(w.name + " above " + ways[part].name + " alone", w, ways[part], out);
  }
  const auto check = [&](const std::string& claim, const std::string& above, const std::string& below) {
    if (by.count(above) && by.count(below)) compare(claim, *by[above], *by[below], out);
  };
  for (const std::string type : {"hog", "gist", "words", "binary"}) {
    const std::string way = "type=" + type;
    check(type + ": intensity above range", way + ",image=intensity", way + ",image=range");
    check(type + ": front and back above front", way + ",views=front_and_back,image=intensity",
          way + ",views=front,image=intensity");
    for (const std::string views : {"front", "front_and_back"})
      check(type + ", " + views + ": intensity above cameras", way + ",views=" + views + ",image=intensity",
            way + ",views=" + views + ",image=camera");
  }
  for (const std::string psi : {"0.1", "0.2", "0.4"})
    check("shot, psi " + psi + " m: with texture above without", "type=shot_colour,psi=" + psi,
          "type=shot,psi=" + psi);
}

void run(const Arguments& a) {
  std::vector<Way> ways;
  for (const std::string& text : a.ways) addWay(text, a, ways);
  auto scans = rosbag_tests::openScans(a.scans, a.poses, rosbag_tests::PcdFrame::kMap, false);
  fs::create_directories(a.out);
  std::vector<Eigen::Vector3d> positions;
  mapping_simulation::PosedScan scan;
  mapping_common::Progress progress("compare_descriptions");
  for (std::size_t number = 0; scans->next(scan); ++number) {
    progress.show("scan ", number + 1, " of ", scans->size());
    positions.push_back(scan.pose.translation());
    const PanoramaOptions& panorama_options = a.recognizer.panorama;
    checkScan(scan.cloud, panorama_options);
    const Panorama panorama = toPanorama(scan.cloud, panorama_options, a.recognizer.largest_hole);
    for (Way& way : ways) {
      const std::clock_t start = std::clock();
      const Scene scene{scan.cloud, panorama_options.min_range, [&] {
                          if (!way.camera) return viewsOf(panorama, way.options);
                          std::vector<View> views{imageView(a.front, number, 0.0, a.field_of_view)};
                          if (way.options.views == Views::kFrontAndBack)
                            views.push_back(imageView(a.back, number, M_PI, a.field_of_view));
                          return views;
                        }};
      try {
        if (way.recognizer)
          way.recognitions.push_back(way.recognizer->process(scan.cloud));
        else if (way.description)
          way.description->add(way.description->describe(scene));
        way.scan.push_back(static_cast<int>(number));
      } catch (const std::invalid_argument& e) {
        progress.say(way.name, ", ", scan.name, ": ", e.what());
      }
      way.seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    }
  }
  progress.say(positions.size(), " scans");
  compareAll(ways, positions.size(), a);
  std::vector<std::vector<std::string>> table = {
      {"description", "recall at full precision, %", "precision at full recall, %", "ms a scan"}};
  for (std::size_t i = 0; i < ways.size(); ++i) {
    evaluate(ways[i], positions, a, static_cast<int>(i));
    std::ostringstream ms;
    ms << std::fixed << std::setprecision(1) << 1e3 * ways[i].seconds / static_cast<double>(positions.size());
    table.push_back({ways[i].name, percent(ways[i].recall), percent(ways[i].precision), ms.str()});
  }
  std::ostringstream report;
  report << mapping_common::markdownTable(table) << '\n';
  writeClaims(ways, report);
  std::cout << report.str();
  mapping_common::writeFile(a.out + "/comparison.md", [&](std::ostream& out) { out << report.str(); });
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "compare_descriptions", kUsage, parse, run);
}
