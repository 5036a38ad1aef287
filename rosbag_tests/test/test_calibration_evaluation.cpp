// SPDX-License-Identifier: BSD-3-Clause
//
// What models of intensity are judged by (thesis, Fig. 3.4): on data with a known answer, in the simulation,
// by the tool from end to end, and on recordings.
#include <gtest/gtest.h>
#include <laser_intensity_calib/calibration_file.h>
#include <laser_intensity_calib/statistics.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/tool_test.h>
#include <mapping_simulation/testing/worlds.h>
#include <rosbag/bag.h>
#include <rosbag_tests/evaluations/calibration_evaluation.h>
#include <sensor_msgs/LaserScan.h>

#include <cmath>
#include <random>
#include <sstream>

namespace rosbag_tests {

using mapping_simulation::configFile;
using mapping_simulation::loadSensor;
using mapping_simulation::loadTrajectory;
using mapping_simulation::loadWorld;
using mapping_simulation::PosedScan;
using mapping_simulation::SensorConfig;

namespace {

using laser_intensity_calib::Calibration;
using laser_intensity_calib::coefficientOfVariation;
using laser_intensity_calib::ModelType;
using laser_intensity_calib::overlap;
using laser_intensity_calib::Sample;
using mapping_common::mentions;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// f(r, alpha) = 100 from 1 to 3 m and up to 1 rad, for all models.
Calibration flat() {
  Calibration c;
  c.raw = 100.0;
  c.polynomial = laser_intensity_calib::RangePolynomial({1.0, 3.0}, {100.0});
  c.table = laser_intensity_calib::LookupTable({1.0, 1.0, 3}, {0.0, 0.5, 3},
                                               Eigen::ArrayXXf::Constant(3, 3, 100.0F));
  return c;
}

std::vector<Sample> surface(float mean, float deviation, int count = 5000, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> gauss(mean, deviation);
  std::vector<Sample> samples;
  for (int i = 0; i < count; ++i) samples.push_back({2.0F, 0.3F, gauss(random), i / 10});
  return samples;
}

std::vector<Sample> join(std::vector<Sample> a, const std::vector<Sample>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

double meanOf(const std::vector<float>& values) {
  double sum = 0.0;
  for (const float v : values) sum += v;
  return sum / values.size();
}

// The number that a row of the table has in a column.
double inTable(const std::string& table, const std::string& first, const std::string& second, int column) {
  std::istringstream lines(table);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string a, b, word;
    words >> a >> b;
    if (a != first || b != second) continue;
    for (int i = 0; i <= column; ++i)
      while (words >> word && word == "%") continue;
    return std::stod(word);
  }
  ADD_FAILURE() << "no row " << first << ' ' << second << " in\n" << table;
  return kNan;
}

TEST(Judgement, OfHistogramsThatAreKnown) {
  Surfaces surfaces;
  surfaces["bright"] = surface(80.0F, 2.0F);
  surfaces["bright_too"] = surface(80.0F, 2.0F, 5000, 2);
  surfaces["dark"] = surface(20.0F, 2.0F);
  surfaces["striped"] = join(surface(20.0F, 2.0F, 5000, 3), surface(80.0F, 2.0F, 5000, 4));
  std::ostringstream out;
  printJudgement(out, judge(flat(), surfaces));
  constexpr int kCovered = 1, kMean = 2, kDeviation = 3, kModes = 4, kLutOverlap = 2;
  for (const char* model : {"raw", "range", "lut"}) {
    EXPECT_NEAR(100.0, inTable(out.str(), "bright", model, kCovered), 1e-6);
    EXPECT_NEAR(0.8, inTable(out.str(), "bright", model, kMean), 2e-3);
    EXPECT_NEAR(2.5, inTable(out.str(), "bright", model, kDeviation), 0.15);
    EXPECT_EQ(1, inTable(out.str(), "bright", model, kModes));
    EXPECT_EQ(2, inTable(out.str(), "striped", model, kModes));
  }
  EXPECT_GT(inTable(out.str(), "bright", "bright_too", kLutOverlap), 90.0) << "the same";
  EXPECT_EQ(0.0, inTable(out.str(), "bright", "dark", kLutOverlap)) << "apart";
  EXPECT_NEAR(50.0, inTable(out.str(), "dark", "striped", kLutOverlap), 5.0) << "half of it";
}

TEST(Judgement, IsOfSamplesThatAllModelsCover) {
  Surfaces surfaces;
  surfaces["wall"] = {
      {2.0F, 0.3F, 50.0F, 0}, {9.0F, 0.3F, 50.0F, 0}, {2.0F, 1.5F, 50.0F, 0}, {2.0F, kNan, 50.0F, 0}};
  surfaces["far"] = {{9.0F, 0.3F, 50.0F, 0}};
  const JudgedSurfaces judged = judge(flat(), surfaces);
  for (const auto& [type, values] : judged.at("wall").reflectivities)
    EXPECT_EQ(std::vector<float>{0.5F}, values);
  EXPECT_EQ(3u, judged.at("wall").reflectivities.size());
  std::ostringstream out;
  printJudgement(out, judged);
  EXPECT_NEAR(25.0, inTable(out.str(), "wall", "lut", 1), 1e-6);
  EXPECT_TRUE(mentions(out.str(), {"far          not covered"}));
  EXPECT_THROW(judge(Calibration(), surfaces), std::invalid_argument) << "no table";
}

TEST(Judgement, RawIsWithoutOffsets) {
  Calibration c = flat();
  c.offsets = {10.0F, -10.0F};
  Surfaces surfaces;
  surfaces["wall"] = {{2.0F, 0.3F, 60.0F, 0, 0}, {2.0F, 0.3F, 40.0F, 0, 1}};
  const JudgedSurfaces judged = judge(c, surfaces);
  EXPECT_EQ((std::vector<float>{0.6F, 0.4F}), judged.at("wall").reflectivities.at(ModelType::kRaw));
  EXPECT_EQ((std::vector<float>{0.5F, 0.5F}), judged.at("wall").reflectivities.at(ModelType::kLut));
}

TEST(Training, KeepsTheFirstPartFromTheJudgement) {
  Surfaces surfaces;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> range(1.0F, 3.0F), incidence(0.0F, 1.0F);
  for (int i = 0; i < 20000; ++i) {
    // The later half of the reference is another surface, of which the models must not know.
    const float r = range(random), a = incidence(random), f = 100.0F * std::cos(a) / r;
    surfaces["reference"].push_back({r, a, i < 10000 ? f : 0.5F * f, i / 100});
    surfaces["other"].push_back({r, a, 0.25F * f, i / 100});
  }
  const Calibration c = trainOnFirstPart(surfaces, {"reference"}, 0.5, laser_intensity_calib::FitOptions());
  EXPECT_EQ(100u, c.scans);
  ASSERT_EQ(10000u, surfaces["reference"].size());
  ASSERT_EQ(10000u, surfaces["other"].size());
  for (const auto& [name, samples] : surfaces)
    for (const Sample& s : samples) ASSERT_GE(s.scan, 100) << name;
  const JudgedSurfaces judged = judge(c, surfaces);
  EXPECT_NEAR(0.5, meanOf(judged.at("reference").reflectivities.at(ModelType::kLut)), 0.01);
  EXPECT_NEAR(0.25, meanOf(judged.at("other").reflectivities.at(ModelType::kLut)), 0.005);
  EXPECT_THROW(trainOnFirstPart(surfaces, {"nothing"}, 0.5, laser_intensity_calib::FitOptions()),
               std::invalid_argument);
}

// The thesis's Fig. 3.4 with the calibrations that ship, of scanners that are not Lambertian: overlaps and
// spreads fall from raw to the table, and the table finds the ratios of the reflectivities.
TEST(Simulated, TheTableTellsThreeSurfacesApart) {
  for (const std::string scanner : {"hokuyo_utm30lx", "sick_lms291"}) {
    SensorConfig sensor = loadSensor(configFile("simulator/" + scanner + ".yaml"));
    sensor.rate = 10.0;  // fewer sweeps
    laser_intensity_calib::CloudIncidenceOptions normals;
    normals.leaf = 0.05;  // neighbours of several sweeps
    const std::string world = configFile("worlds/calibration_surfaces.yaml");
    const JudgedSurfaces judged =
        judge(laser_intensity_calib::loadCalibration(
                  PACKAGE_DIR "/../laser_intensity_calib/config/reflectivity_" + scanner + ".yaml"),
              simulateSurfaces(loadWorld(world), loadTrajectory(world), sensor, 7, normals));
    ASSERT_EQ(3u, judged.size());
    const auto values = [&](const char* name, ModelType type) {
      return judged.at(name).reflectivities.at(type);
    };
    const std::pair<const char*, double> truth[] = {
        {"surface_1", 1.0}, {"surface_2", 0.625}, {"surface_3", 0.4375}};
    for (const auto& [name, reflectivity] : truth) {
      EXPECT_GT(values(name, ModelType::kLut).size(), 0.5 * judged.at(name).samples)
          << scanner << ' ' << name;
      EXPECT_NEAR(reflectivity, meanOf(values(name, ModelType::kLut)), 0.03 * reflectivity)
          << scanner << ' ' << name;
      for (const ModelType other : {ModelType::kRaw, ModelType::kRange})
        EXPECT_LT(coefficientOfVariation(values(name, ModelType::kLut)),
                  0.5 * coefficientOfVariation(values(name, other)))
            << scanner << ' ' << name << ' ' << toString(other);
    }
    const auto shared = [&](ModelType type) {
      return overlap(values("surface_2", type), values("surface_3", type));
    };
    EXPECT_GT(shared(ModelType::kRaw), 0.15) << scanner;
    EXPECT_GT(shared(ModelType::kRange), 0.15) << scanner;
    EXPECT_LT(shared(ModelType::kLut), 0.05) << scanner;
  }
}

// Two lasers turn one after the other over a street's ground and facades.
class TwoLasers : public ScanSource {
 public:
  std::size_t size() const override { return 3; }
  void rewind() override { given_ = 0; }
  bool next(PosedScan& scan) override {
    if (given_++ == 3) return false;
    scan.cloud.clear();
    for (const float height : {-1.7F, 2.0F}) {
      for (int i = 0; i < 720; ++i) {
        const double azimuth = (i + 0.5) * M_PI / 360.0;
        pcl::PointXYZI point;
        point.getVector3fMap() << 6.0F * std::cos(azimuth), 6.0F * std::sin(azimuth), height;
        point.intensity = height < 0.0F ? 0.25F : 0.75F;
        scan.cloud.push_back(point);
      }
    }
    return true;
  }

 private:
  int given_ = 0;
};

TEST(Street, SurfacesAndLasers) {
  TwoLasers scans;
  std::vector<int> progress;
  const Surfaces surfaces = readStreet(scans, 2, {}, [&](int scan) { progress.push_back(scan); });
  EXPECT_EQ((std::vector<int>{0, 2}), progress);
  ASSERT_EQ(3u, surfaces.size());
  EXPECT_EQ(2u * 720, surfaces.at("facades").size());
  const auto within = [](double across) { return 2 * 4 * std::asin(across / 6.0) * 360.0 / M_PI; };
  EXPECT_NEAR(within(2.5), surfaces.at("road").size(), 8.0);
  EXPECT_NEAR(2.0 * 720 - within(4.5), surfaces.at("roadside").size(), 8.0);
  for (const auto& [name, samples] : surfaces) {
    for (const Sample& s : samples) {
      ASSERT_EQ(name == "facades" ? 1 : 0, s.laser) << name;
      ASSERT_EQ(name == "facades" ? 0.75F : 0.25F, s.intensity);
      ASSERT_TRUE(s.scan == 0 || s.scan == 2);
    }
  }
}

class Tool : public mapping_common::ToolTest {
 protected:
  Tool() : ToolTest(EVALUATE_CALIBRATION) {}

  // A wall ahead at many distances, its left half of half the reflectivity.
  std::string bagOfAWall() {
    const std::string file = dir_.path("wall.bag");
    rosbag::Bag bag(file, rosbag::bagmode::Write);
    std::mt19937 random(1);
    std::normal_distribution<double> gauss;
    for (int k = 0; k < 200; ++k) {
      sensor_msgs::LaserScan scan;
      scan.header.stamp = ros::Time(1.0 + 0.1 * k);
      scan.angle_min = -1.05F;
      scan.angle_increment = 0.01F;
      scan.range_min = 0.1F;
      scan.range_max = 20.0F;
      const double distance = 2.0 + 1.5 * std::sin(0.37 * k);
      for (int i = 0; i < 211; ++i) {
        const double angle = scan.angle_min + i * scan.angle_increment, range = distance / std::cos(angle);
        scan.ranges.push_back(static_cast<float>(range + 0.003 * gauss(random)));
        scan.intensities.push_back(static_cast<float>((i < 105 ? 1000.0 : 500.0) * std::cos(angle) /
                                                      std::sqrt(range) * (1.0 + 0.01 * gauss(random))));
      }
      bag.write("/scan", scan.header.stamp, scan);
    }
    return file;
  }
};

TEST_F(Tool, JudgesABag) {
  const std::string arguments =
      "--bag " + bagOfAWall() + " --surface right:0:99 left:111:210 --reference right";
  ASSERT_EQ(0, run(arguments + " --save " + dir_.path("c.yaml") + " --histograms " + dir_.path("h.csv")))
      << output();
  const Calibration c = laser_intensity_calib::loadCalibration(dir_.path("c.yaml"));
  EXPECT_EQ(100u, c.scans);
  constexpr int kMean = 2, kDeviation = 3;
  EXPECT_NEAR(1.0, inTable(output(), "right", "lut", kMean), 0.01);
  EXPECT_NEAR(0.5, inTable(output(), "left", "lut", kMean), 0.01);
  for (const char* name : {"left", "right"})
    EXPECT_LT(inTable(output(), name, "lut", kDeviation), 0.2 * inTable(output(), name, "raw", kDeviation))
        << name;
  EXPECT_GT(inTable(output(), "left", "right", 0), 10.0) << "raw overlap";
  EXPECT_EQ(0.0, inTable(output(), "left", "right", 2)) << "lut overlap";

  // The histograms are of the same values.
  std::map<std::string, double> sums, means;
  std::istringstream lines(mapping_common::readFile(dir_.path("h.csv")));
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ("surface,model,reflectivity,share", line);
  while (std::getline(lines, line)) {
    char name[32], model[32];
    double reflectivity, share;
    ASSERT_EQ(4, std::sscanf(line.c_str(), "%31[^,],%31[^,],%lf,%lf", name, model, &reflectivity, &share))
        << line;
    if (model != std::string("lut")) continue;
    sums[name] += share;
    means[name] += share * reflectivity;
  }
  ASSERT_EQ(2u, sums.size());
  for (const char* name : {"left", "right"}) {
    EXPECT_NEAR(1.0, sums[name], 1e-3) << name;
    EXPECT_NEAR(inTable(output(), name, "lut", kMean), means[name], 0.01) << name;
  }

  // The file is what was judged.
  const std::string first = output();
  ASSERT_EQ(0, run("--bag " + dir_.path("wall.bag") + " --surface right:0:99 left:111:210 --calibration " +
                   dir_.path("c.yaml")))
      << output();
  EXPECT_NEAR(inTable(first, "left", "lut", kMean), inTable(output(), "left", "lut", kMean), 0.005);
}

TEST_F(Tool, SaysWhatIsWrong) {
  EXPECT_EQ(0, run("--help"));
  EXPECT_EQ(2, run(""));
  EXPECT_TRUE(mentions(output(), {"one of --world, --bag and --scans"}));
  EXPECT_EQ(2, run("--world w.yaml"));
  EXPECT_EQ(2, run("--bag b.bag --surface a:1:2 --reference a --train 1"));
  EXPECT_TRUE(mentions(output(), {"--train"}));
  EXPECT_EQ(1, run("--bag /nowhere.bag --surface a:1:2 --reference a"));
  EXPECT_TRUE(mentions(output(), {"/nowhere.bag"}));
  const std::string bag = "--bag " + bagOfAWall();
  EXPECT_EQ(2, run(bag + " --surface a-1-2 --reference a"));
  EXPECT_TRUE(mentions(output(), {"--surface is a-1-2"}));
  EXPECT_EQ(1, run(bag + " --surface a:0:99 --reference b"));
  EXPECT_TRUE(mentions(output(), {"no surface b"}));
  EXPECT_EQ(1, run(bag + " --surface a:0:99 --reference a --offsets"));
  EXPECT_TRUE(mentions(output(), {"ring"}));
}

// Walls of one room, of scans that the table wasn't fitted to: raw, two of them have nothing in common.
TEST_F(Tool, RecordedWallsLookAlike) {
  const std::string bag = mapping_common::findRecording("sick_tim781s_rssi/tim781s_static_a.bag");
  if (bag.empty()) GTEST_SKIP() << mapping_common::withoutRecording("sick_tim781s_rssi/tim781s_static_a.bag");
  ASSERT_EQ(0, run("--bag " + bag +
                   " --surface a:112:185 b:200:262 c:272:338 --reference a b c --range-cell 0.05 "
                   "--normal-incidence 90"))
      << output();
  for (const auto& [first, second] : {std::pair{"a", "b"}, {"a", "c"}, {"b", "c"}}) {
    const double raw = inTable(output(), first, second, 0), lut = inTable(output(), first, second, 2);
    EXPECT_LT(raw, 40.0) << first << second;
    EXPECT_GT(lut, raw + 15.0) << first << second;
  }
}

// The lasers of a car's lidar differ by an offset each, without which there is nothing to be had.
TEST_F(Tool, RecordedRoadIsEvenerWithoutTheLasersOffsets) {
  const std::string scans = mapping_common::findRecording("scans3d_street154");
  if (scans.empty()) GTEST_SKIP() << mapping_common::withoutRecording("scans3d_street154");
  ASSERT_EQ(0, run("--scans " + scans +
                   " --step 19 --reference road --offsets --range-cell 1 --leaf 0.1 --radius 1 "
                   "--normal-incidence 90"))
      << output();
  for (const char* name : {"road", "roadside"})
    EXPECT_LT(inTable(output(), name, "lut", 3), 0.85 * inTable(output(), name, "raw", 3)) << output();
  EXPECT_LT(inTable(output(), "road", "roadside", 2), inTable(output(), "road", "roadside", 0) - 3.0);
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
