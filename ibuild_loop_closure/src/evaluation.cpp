// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/evaluation.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

namespace ibuild_loop_closure {
namespace {

// Calls visit(numbers of the line, number of the line).
template <class Visit>
void visitRows(const std::string& path, Visit&& visit) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path + " can't be opened");
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    line = line.substr(0, line.find('#'));
    std::istringstream words(line);
    std::vector<double> values;
    for (double value; words >> value;) values.push_back(value);
    const auto fail = [&](const std::string& what) {
      throw std::runtime_error(path + ", line " + std::to_string(number) + ": " + what);
    };
    if (!words.eof()) fail("there is something that is no number");
    if (values.empty()) continue;
    visit(values, fail);
  }
}

std::map<int, int> imagesByNumber(const std::vector<int>& ids) {
  std::map<int, int> images;
  for (std::size_t i = 0; i < ids.size(); ++i) images[ids[i]] = static_cast<int>(i);
  return images;
}

Eigen::Isometry3d poseOf(const std::vector<double>& row) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  if (row.size() == 8) {
    pose.translation() << row[1], row[2], row[3];
    pose.linear() = Eigen::Quaterniond(row[7], row[4], row[5], row[6]).normalized().toRotationMatrix();
    return pose;
  }
  const std::size_t first = row.size() == 13 ? 1 : 0;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) pose(r, c) = row[first + 4 * r + c];
  }
  return pose;
}

}  // namespace

void GroundTruth::add(int query, Interval interval) {
  intervals_.at(query).push_back(interval);
}

bool GroundTruth::isLoop(int query, int match) const {
  const auto& intervals = intervals_.at(query);
  return std::any_of(intervals.begin(), intervals.end(),
                     [match](const Interval& i) { return match >= i.first && match <= i.last; });
}

int GroundTruth::loops() const {
  return static_cast<int>(std::count_if(intervals_.begin(), intervals_.end(),
                                        [](const std::vector<Interval>& i) { return !i.empty(); }));
}

GroundTruth GroundTruth::fromIntervals(const std::string& path, const std::vector<int>& ids, int tolerance) {
  GroundTruth truth(static_cast<int>(ids.size()));
  const std::map<int, int> images = imagesByNumber(ids);
  visitRows(path, [&](const std::vector<double>& row, const auto& fail) {
    if (row.size() != 3) fail("a row has three numbers: query, first, last");
    const auto query = images.find(static_cast<int>(row[0]));
    if (query == images.end()) fail("there is no image " + std::to_string(static_cast<int>(row[0])));
    // An interval's ends need not be images themselves.
    const auto first = images.lower_bound(static_cast<int>(row[1]));
    const auto last = images.upper_bound(static_cast<int>(row[2]));
    if (first == last) return;
    truth.add(query->second, {first->second - tolerance, std::prev(last)->second + tolerance});
  });
  return truth;
}

GroundTruth GroundTruth::fromWalks(const std::vector<int>& lengths, int tolerance) {
  int images = 0;
  for (int length : lengths) images += length;
  GroundTruth truth(images);
  for (std::size_t walk = 1, start = lengths.empty() ? 0 : lengths[0]; walk < lengths.size(); ++walk) {
    for (int i = 0; i < lengths[walk]; ++i) {
      int earlier_start = 0;
      for (std::size_t earlier = 0; earlier < walk; ++earlier) {
        if (i < lengths[earlier]) {
          truth.add(static_cast<int>(start) + i,
                    {std::max(earlier_start, earlier_start + i - tolerance),
                     std::min(earlier_start + lengths[earlier] - 1, earlier_start + i + tolerance)});
        }
        earlier_start += lengths[earlier];
      }
    }
    start += lengths[walk];
  }
  return truth;
}

GroundTruth GroundTruth::fromPoses(const std::vector<Eigen::Isometry3d>& poses, double distance, double angle,
                                   int gap) {
  const int images = static_cast<int>(poses.size());
  GroundTruth truth(images);
  const double least_cosine = std::cos(angle);
  for (int query = 0; query < images; ++query) {
    int first = -1;
    for (int match = 0; match <= query - gap + 1; ++match) {
      const bool same = match <= query - gap &&
                        (poses[query].translation() - poses[match].translation()).norm() < distance &&
                        poses[query].linear().col(2).dot(poses[match].linear().col(2)) > least_cosine;
      if (same && first < 0) first = match;
      if (!same && first >= 0) {
        truth.add(query, {first, match - 1});
        first = -1;
      }
    }
  }
  return truth;
}

std::vector<Eigen::Isometry3d> loadPoses(const std::string& path, const std::vector<int>& ids) {
  std::vector<Eigen::Isometry3d> poses(ids.size());
  std::vector<char> known(ids.size(), 0);
  const std::map<int, int> images = imagesByNumber(ids);
  std::size_t rows = 0;
  visitRows(path, [&](const std::vector<double>& row, const auto& fail) {
    if (row.size() != 8 && row.size() != 12 && row.size() != 13 && row.size() != 16)
      fail("a pose has 8, 12, 13 or 16 numbers, here are " + std::to_string(row.size()));
    std::size_t image = rows++;
    if (row.size() == 13) {
      const auto found = images.find(static_cast<int>(row[0]));
      if (found == images.end()) return;
      image = found->second;
    }
    if (image >= poses.size()) return;
    poses[image] = poseOf(row);
    known[image] = 1;
  });
  const auto missing = std::find(known.begin(), known.end(), 0);
  if (missing != known.end())
    throw std::runtime_error(path + " has no pose of image " + std::to_string(ids[missing - known.begin()]));
  return poses;
}

PrecisionRecall evaluate(const std::vector<Proposal>& proposals, const GroundTruth& truth) {
  PrecisionRecall result;
  result.loops = truth.loops();
  for (const Proposal& p : proposals) {
    if (!p.accepted) continue;
    ++result.detected;
    result.correct += truth.isLoop(p.query, p.match);
  }
  return result;
}

std::vector<CurvePoint> precisionRecallCurve(std::vector<Proposal> proposals, const GroundTruth& truth) {
  std::sort(proposals.begin(), proposals.end(),
            [](const Proposal& a, const Proposal& b) { return a.similarity > b.similarity; });
  std::vector<CurvePoint> curve;
  PrecisionRecall so_far;
  so_far.loops = truth.loops();
  for (std::size_t i = 0; i < proposals.size(); ++i) {
    ++so_far.detected;
    so_far.correct += truth.isLoop(proposals[i].query, proposals[i].match);
    if (i + 1 < proposals.size() && proposals[i + 1].similarity == proposals[i].similarity) continue;
    curve.push_back({proposals[i].similarity, so_far});
  }
  return curve;
}

std::optional<CurvePoint> bestAtFullPrecision(const std::vector<CurvePoint>& curve) {
  std::optional<CurvePoint> best;
  for (const CurvePoint& point : curve) {
    if (point.at.correct == point.at.detected && (!best || point.at.correct > best->at.correct)) best = point;
  }
  return best;
}

}  // namespace ibuild_loop_closure
