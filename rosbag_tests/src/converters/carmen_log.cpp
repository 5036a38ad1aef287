// SPDX-License-Identifier: BSD-3-Clause
#include <rosbag_tests/converters/carmen_log.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "file_utils.h"

namespace rosbag_tests {

using mapping_simulation::PlanarScan;

namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr std::size_t kMaxReadings = 100000;

Eigen::Isometry3d planarPose(double x, double y, double theta) {
  return Eigen::Translation3d(x, y, 0.0) *
         Eigen::Isometry3d(Eigen::AngleAxisd(theta, Eigen::Vector3d::UnitZ()));
}

/// Takes a line apart, word by word; throws what is wrong with it.
class Words {
 public:
  explicit Words(const std::string& line) {
    std::istringstream stream(line);
    for (std::string word; stream >> word;) words_.push_back(word);
  }

  std::size_t size() const { return words_.size(); }
  std::size_t left() const { return words_.size() - next_; }
  void skip(std::size_t count) {
    while (count-- > 0) word();
  }

  std::string word() {
    if (left() == 0) throw std::runtime_error("ends too early");
    return words_[next_++];
  }
  double number() {
    const std::string text = word();
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    if (*end != '\0' || !std::isfinite(value)) throw std::runtime_error("'" + text + "' is no number");
    return value;
  }
  std::size_t count() {
    const double value = number();
    if (!(value >= 0.0 && value <= kMaxReadings && value == std::floor(value)))
      throw std::runtime_error(words_[next_ - 1] + " can't be a number of readings");
    return static_cast<std::size_t>(value);
  }
  std::vector<float> numbers(std::size_t count) {
    if (count > left())
      throw std::runtime_error("has " + std::to_string(left()) + " values after saying " +
                               std::to_string(count) + " readings");
    std::vector<float> values(count);
    for (float& value : values) value = static_cast<float>(number());
    return values;
  }
  Eigen::Isometry3d pose() {
    const double x = number(), y = number();
    return planarPose(x, y, number());
  }

 private:
  std::vector<std::string> words_;
  std::size_t next_ = 0;
};

void readStamps(Words& words, CarmenRecord& record) {
  record.ipc_stamp = words.number();
  words.word();  // host
  record.logger_stamp = words.number();
  if (words.left() != 0) throw std::runtime_error("has " + std::to_string(words.left()) + " values too many");
}

// x y theta tv rv accel | ipc_stamp host logger_stamp
void readOdometry(Words& words, CarmenRecord& record) {
  record.robot = words.pose();
  record.linear_velocity = words.number();
  record.angular_velocity = words.number();
  words.number();
  readStamps(words, record);
}

void setFieldOfView(PlanarScan& scan, const CarmenOptions& options) {
  const std::size_t readings = scan.ranges.size();
  scan.angle_min = (readings > 361 ? -135.0 : -90.0) * kDegree;
  scan.angle_increment = (readings > 181 ? 0.5 : 1.0) * kDegree;
  if (options.angle_increment != 0.0) {
    scan.angle_min = options.angle_min;
    scan.angle_increment = options.angle_increment;
  }
}

// n readings, laser x y theta, robot x y theta | ipc_stamp host logger_stamp
void readOldScan(Words& words, const CarmenOptions& options, CarmenRecord& record) {
  record.scan.ranges = words.numbers(words.count());
  setFieldOfView(record.scan, options);
  record.scan.pose = words.pose();
  record.robot = words.pose();
  readStamps(words, record);
}

// type, start angle, field of view, resolution, maximum range, accuracy, remission mode, n readings,
// m remissions, laser x y theta, robot x y theta, tv, rv, forward and side safety distance, turn axis |
// ipc_stamp host logger_stamp
void readNewScan(Words& words, const CarmenOptions& options, CarmenRecord& record) {
  words.number();
  record.scan.angle_min = words.number();
  words.number();
  record.scan.angle_increment = words.number();
  record.scan.range_max = words.number();
  words.skip(2);
  record.scan.ranges = words.numbers(words.count());
  record.scan.intensities = words.numbers(words.count());
  if (!record.scan.intensities.empty() && record.scan.intensities.size() != record.scan.ranges.size())
    throw std::runtime_error("has another number of remissions than of readings");
  if (options.angle_increment != 0.0 || !(record.scan.angle_increment > 0.0))
    setFieldOfView(record.scan, options);
  record.scan.pose = words.pose();
  record.robot = words.pose();
  record.linear_velocity = words.number();
  record.angular_velocity = words.number();
  words.skip(3);
  readStamps(words, record);
}

// The newer form has at least 19 values beside its readings, the older exactly 10.
bool isOldForm(const std::string& line) {
  Words words(line);
  words.skip(1);
  const double readings = words.number();
  return words.size() == 2.0 + readings + 9.0;
}

void finishScan(const CarmenOptions& options, CarmenRecord& record) {
  PlanarScan& scan = record.scan;
  if (scan.ranges.empty()) throw std::runtime_error("has no readings");
  scan.stamp = record.ipc_stamp;
  scan.angle_max = scan.angle_min + (scan.ranges.size() - 1) * scan.angle_increment;
  scan.range_max = scan.range_max > 0.0 ? std::min(scan.range_max, options.range_max) : options.range_max;
  for (float& range : scan.ranges) {
    if (range >= scan.range_max) range = std::numeric_limits<float>::infinity();
    if (range <= 0.0f) range = std::numeric_limits<float>::quiet_NaN();
  }
}

/// False for a line of another kind.
bool readRecord(const std::string& line, const std::string& name, const CarmenOptions& options,
                CarmenRecord& record) {
  const bool front = name == "FLASER" || name == "ROBOTLASER1",
             rear = name == "RLASER" || name == "ROBOTLASER2";
  if (!front && !rear && name != "ODOM") return false;
  Words words(line);
  words.skip(1);
  if (name == "ODOM") {
    readOdometry(words, record);
    return true;
  }
  record.kind = front ? CarmenRecord::Kind::kFrontScan : CarmenRecord::Kind::kRearScan;
  if (name == "FLASER" || name == "RLASER" || isOldForm(line))
    readOldScan(words, options, record);
  else
    readNewScan(words, options, record);
  finishScan(options, record);
  return true;
}

}  // namespace

Eigen::Isometry3d CarmenLog::mount(CarmenRecord::Kind scanner) const {
  Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();
  bool first = true, constant = true;
  for (const CarmenRecord& record : records) {
    if (record.kind != scanner) continue;
    const Eigen::Isometry3d relative = record.robot.inverse() * record.scan.pose;
    if (first) mount = relative;
    first = false;
    constant = constant && relative.isApprox(mount, 1e-3) &&
               (relative.translation() - mount.translation()).norm() < 1e-3;
  }
  if (constant) return mount;
  const bool rear = scanner == CarmenRecord::Kind::kRearScan;
  const auto offset = parameters.find(rear ? "robot_rearlaser_offset" : "robot_frontlaser_offset");
  return planarPose(offset == parameters.end() ? 0.0 : std::atof(offset->second.c_str()), 0.0,
                    rear ? M_PI : 0.0);
}

CarmenLog readCarmenLog(const std::string& file, const CarmenOptions& options) {
  CarmenLog log;
  bool scans = false;
  forEachLine(readFileBytes(file), file, [&](const std::string& line, const std::string& where) {
    std::istringstream stream(line);
    std::string name, key, value;
    stream >> name;
    if (name == "PARAM" && stream >> key >> value) log.parameters[key] = value;
    try {
      CarmenRecord record;
      if (!readRecord(line, name, options, record)) return;
      scans = scans || record.isScan();
      log.records.push_back(std::move(record));
    } catch (const std::runtime_error& e) {
      log.malformed.push_back(where + ": " + name + " " + e.what());
    }
  });
  if (!scans)
    fail(file, "no scan: no line FLASER, RLASER, ROBOTLASER1 or ROBOTLASER2 that can be read" +
                   (log.malformed.empty() ? "" : "; the first fault is in " + log.malformed.front()));
  return log;
}

std::vector<double> risingStamps(const std::vector<double>& stamps, std::size_t& repaired) {
  constexpr double kStep = 1e-6;
  // Longest subsequence that rises by kStep from index to index, so that there is room between any two:
  // patience sorting of what exceeds that rise.
  std::vector<std::size_t> piles, before(stamps.size(), stamps.size());
  const auto excess = [&](std::size_t i) { return stamps[i] - kStep * i; };
  std::size_t given = 0;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    if (std::isnan(stamps[i])) continue;
    ++given;
    const auto pile = std::upper_bound(piles.begin(), piles.end(), excess(i),
                                       [&](double value, std::size_t j) { return value < excess(j); });
    if (pile != piles.begin()) before[i] = *std::prev(pile);
    if (pile == piles.end())
      piles.push_back(i);
    else
      *pile = i;
  }
  repaired = given - piles.size();
  if (2 * repaired > given)
    throw std::runtime_error("the stamps don't increase: " + std::to_string(repaired) + " of " +
                             std::to_string(given) +
                             " would have to be made up; --clock none --rate HZ makes all of them");

  std::vector<double> rising = stamps;
  std::size_t kept = stamps.size();  // the next record that keeps its stamp; none yet
  for (std::size_t i = piles.empty() ? stamps.size() : piles.back(); i < stamps.size(); i = before[i]) {
    for (std::size_t k = i + 1; k < std::min(kept, stamps.size()); ++k)
      rising[k] = kept == stamps.size() ? stamps[i] + kStep * (k - i)
                                        : stamps[i] + (stamps[kept] - stamps[i]) * (k - i) / (kept - i);
    kept = i;
  }
  for (std::size_t k = 0; k < kept && kept < stamps.size(); ++k)
    rising[k] = stamps[kept] - kStep * (kept - k);
  return rising;
}

}  // namespace rosbag_tests
