// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/archive.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "intensity_place_recognition/global_description.h"
#include "intensity_place_recognition/place_recognizer.h"
#include "test_street.h"

namespace intensity_place_recognition {
namespace {

std::string whyRefused(const Cloud& cloud) {
  try {
    PlaceRecognizer().describe(cloud);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(PlaceRecognizer, FindsAPlaceInAnyDirectionWithItsPose) {
  PlaceRecognizer recognizer;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const Recognition first = recognizer.process(Street(seed).scan(Street::at(0.0, 0.0, 0.1 * seed)));
    EXPECT_FALSE(first.registration.accepted) << seed;
  }
  for (unsigned seed = 1; seed <= 6; ++seed) {
    Eigen::Isometry3d pose = Street::at(1.5, -1.0, 3.0 + 0.5 * seed);
    pose.rotate(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitX()));
    pose.translation().z() = 0.1;
    const Recognition again = recognizer.process(Street(seed).scan(pose));
    EXPECT_EQ(static_cast<int>(seed) - 1, again.match);
    EXPECT_TRUE(again.registration.accepted)
        << again.registration.score << ", evidence " << again.registration.evidence << ", margin "
        << again.margin << ", pieces " << again.registration.intensity.pieces;
    const Eigen::Isometry3d expected = Street::at(0.0, 0.0, 0.1 * seed).inverse() * pose;
    const Eigen::Isometry3d error = expected.inverse() * again.registration.pose;
    EXPECT_LT(error.translation().norm(), 0.1);
    EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.01);
    const Matrix6& covariance = again.registration.covariance;
    EXPECT_GT(covariance.ldlt().vectorD().minCoeff(), 0.0);
    EXPECT_LT(error.translation().norm(), 4.0 * std::sqrt(covariance.diagonal().head<3>().sum()));
  }
}

TEST(PlaceRecognizer, RegistersAScanToAsManyPlacesAsAsked) {
  const auto at = [](int i) { return Street::at(2.2 * i, 0.3 * i, 0.9 * i); };
  for (const int matches : {1, 3}) {
    PlaceRecognizerOptions options;
    options.matches = matches;
    options.registrations = 8;
    PlaceRecognizer recognizer(options);
    for (int i = 0; i < 4; ++i) recognizer.process(Street(2).scan(at(i)));
    Recognition last = recognizer.process(Street(2).scan(at(4)));
    ASSERT_TRUE(last.registration.accepted);
    ASSERT_GE(matches - 1, static_cast<int>(last.others.size()));
    EXPECT_EQ(matches > 1, !last.others.empty());
    std::set<int> places;
    last.others.push_back(last);
    for (const Recognition& one : last.others) {
      EXPECT_TRUE(places.insert(one.match).second);
      EXPECT_EQ(4, one.query);
      EXPECT_LT(((at(one.match).inverse() * at(4)).inverse() * one.registration.pose).translation().norm(),
                0.1);
    }
  }
}

// As of a recording that is played twice.
TEST(PlaceRecognizer, IsNotInfinitelySureOfTheSameScan) {
  PlaceRecognizer recognizer;
  const Cloud scan = Street(3).scan(Street::at(0.0, 0.0, 0.2));
  recognizer.process(scan);
  const Recognition again = recognizer.process(scan);
  ASSERT_TRUE(again.registration.accepted);
  EXPECT_LT(again.registration.pose.translation().norm(), 1e-3);
  const Matrix6 information = informationAtQuery(again.registration);
  ASSERT_TRUE(information.allFinite());
  EXPECT_GT(information.ldlt().vectorD().minCoeff(), 0.0);
  EXPECT_LT(information.diagonal().maxCoeff(), 1e12);
}

TEST(PlaceRecognizer, SavesAndLoads) {
  const mapping_common::TempDir dir;
  const std::string path = dir.path("places.db");
  PlaceRecognizerOptions options;
  options.description.type = "words";
  PlaceRecognizer recognizer(options);
  for (unsigned seed = 1; seed <= 3; ++seed) recognizer.process(Street(seed).scan(Street::at(0.0, 0.0, 0.0)));
  recognizer.save(path);

  PlaceRecognizer other;
  other.load(path);
  EXPECT_EQ(3, other.places());
  EXPECT_EQ("words", other.options().description.type);
  const Cloud again = Street(2).scan(Street::at(0.5, 0.0, 1.0));
  const Recognition a = recognizer.process(again), b = other.process(again);
  EXPECT_EQ(1, b.match);
  EXPECT_EQ(a.registration.score, b.registration.score);
  EXPECT_TRUE(a.registration.pose.isApprox(b.registration.pose, 0.0));

  // What is in memory stays where a file won't do.
  const std::string whole = mapping_common::readFile(path);
  for (std::string broken : {whole.substr(0, whole.size() / 2), std::string("PLACEDB2"),
                             std::string("nonsense"), whole.substr(0, 5000) + '!' + whole.substr(5001)}) {
    EXPECT_THROW(other.load(dir.write("broken.db", broken)), std::runtime_error);
    EXPECT_EQ(4, other.places());
  }
  EXPECT_THROW(other.load(dir.path("absent.db")), std::runtime_error);
}

// As version 1 wrote them, with whole shapes and descriptions.
TEST(PlaceRecognizer, ReadsOlderFiles) {
  const mapping_common::TempDir dir;
  PlaceRecognizerOptions options;
  const Cloud scan = Street(4).scan(Street::at(0.0, 0.0, 0.4));
  Place place = PlaceRecognizer(options).describe(scan);
  const int rows = 2 * options.description.rings, columns = options.description.directions;
  for (const float value : {0.01f, NAN}) {
    const std::string path = dir.path("old.db");
    mapping_common::writeArchive(
        path, {"PLACEDB2", "a database of places"}, [&](mapping_common::ArchiveWriter& out) {
          out(mapping_common::optionsOf(options));
          out(std::uint64_t(1));
          place.shape.transfer(out);
          out(std::uint64_t(1));
          for (const int size : {1, rows, columns}) out(size);
          std::vector<std::complex<float>> spectrum(rows * (columns / 2 + 1), {value, -value});
          spectrum[7] = {1.0f, 0.5f};
          out(spectrum);
          out(std::vector<float>(128, 0.1f));
        });
    PlaceRecognizer old;
    if (std::isnan(value)) {
      EXPECT_THROW(old.load(path), std::runtime_error);
      continue;
    }
    old.load(path);
    EXPECT_EQ(1, old.places());
    const std::string again = dir.path("new.db");
    old.save(again);
    for (const std::string& file : {path, again}) {
      PlaceRecognizer loaded;
      loaded.load(file);
      EXPECT_EQ(old.description().similarity(0, 0), loaded.description().similarity(0, 0));
      EXPECT_EQ(1, loaded.places());
    }
  }
}

TEST(PackedPlace, TakesLittleMemoryAndKeepsWhatCounts) {
  const Cloud scan = Street(1).scan(Street::at(0.0, 0.0, 0.1));
  const Place place = PlaceRecognizer().describe(scan);
  const PackedShape packed(place.shape);
  const Shape shape = packed.unpacked();
  ASSERT_TRUE(shape.isSound());
  const std::vector<Patch>& all = place.shape.patches();
  ASSERT_GT(all.size(), 2000u);
  ASSERT_EQ(all.size(), packed.size());
  // Each group is from everywhere, so that its patches aren't in the order of the shape's.
  std::vector<bool> known(all.size(), false);
  for (std::size_t i = 0; i < packed.size(); ++i) {
    std::size_t nearest = 0;
    float squared = INFINITY;
    for (std::size_t k = 0; k < all.size(); ++k) {
      const float distance = (all[k].point - packed.point(i)).squaredNorm();
      if (distance < squared) {
        squared = distance;
        nearest = k;
      }
    }
    known[nearest] = true;
    EXPECT_LT(squared, 0.007f * 0.007f);
    EXPECT_GT(std::abs(all[nearest].normal.dot(packed.normal(i))), std::cos(0.025f));
    EXPECT_NEAR(all[nearest].intensity, packed.intensity(i), 0.009f);
    EXPECT_NEAR(all[nearest].flatness, packed.flatness(i), 0.072f);
    EXPECT_EQ(all[nearest].isLevel(), packed.isLevel(i));
  }
  EXPECT_TRUE(std::all_of(known.begin(), known.end(), [](bool is) { return is; }));
  // Ranges are the same.
  int through = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3f point(std::cos(0.1f * i) * (1.0f + 0.003f * i),
                                std::sin(0.1f * i) * (1.0f + 0.003f * i), -1.5f + 0.1f * (i % 40));
    EXPECT_EQ(place.shape.seesThrough(point, 0.5f), shape.seesThrough(point, 0.5f));
    through += shape.seesThrough(point, 0.5f);
  }
  EXPECT_GT(through, 100);
  const PackedSignature signature(dynamic_cast<const GlobalSignature&>(*place.signature));
  const double most = 3500.0 / static_cast<double>(all.size());  // patches that there are at most
  EXPECT_LT(most * static_cast<double>(packed.bytes()) + PackedPlan(GroundPlan(shape, 0.0)).bytes() +
                signature.bytes() + sizeof(WallDirections) + 128 * sizeof(float),
            60e3);
}

TEST(PlaceRecognizer, SaysWhyACloudWontDo) {
  const Cloud good = Street(1).scan(Street::at(0.0, 0.0, 0.0));
  EXPECT_EQ("", whyRefused(good));
  EXPECT_EQ("the cloud is empty", whyRefused({}));
  Cloud bad = good;
  for (auto& p : bad) p.x = NAN;
  EXPECT_EQ("none of the cloud's " + std::to_string(good.size()) +
                " points was measured: they aren't finite, or at the origin",
            whyRefused(bad));
  bad = good;
  for (auto& p : bad) p.intensity = 0.0f;
  EXPECT_EQ("all intensities are 0: the sensor gives none, or the driver drops them", whyRefused(bad));
  bad = good;
  for (auto& p : bad) p.z = 0.0f;
  EXPECT_NE(std::string::npos, whyRefused(bad).find("in one ring")) << whyRefused(bad);
  bad = good;
  for (auto& p : bad) p.getVector3fMap() *= 1e-3f;
  EXPECT_NE(std::string::npos, whyRefused(bad).find("1 to 120 m from the sensor")) << whyRefused(bad);
  bad = good;
  for (auto& p : bad) p.getVector3fMap() += Eigen::Vector3f(60.0f, 40.0f, 0.0f);
  EXPECT_NE(std::string::npos, whyRefused(bad).find("sensor's own frame")) << whyRefused(bad);
  // A few that are no returns do no harm.
  bad = good;
  for (std::size_t i = 0; i < bad.size(); i += 10) bad[i].x = bad[i].y = bad[i].z = NAN;
  EXPECT_EQ("", whyRefused(bad));
}

// As drivers write points without a return, and as clouds come that were damaged.
TEST(PlaceRecognizer, LeavesOutWhatWasNotMeasured) {
  const Cloud good = Street(1).scan(Street::at(0.0, 0.0, 0.0));
  constexpr float kLargest = std::numeric_limits<float>::max();
  Cloud with = good;
  for (int i = 0; i < 3000; ++i) {
    pcl::PointXYZI p = good[7 * i];
    switch (i % 8) {
      case 0:
        p.intensity = NAN;
        break;
      case 1:
        p.intensity = i % 16 < 8 ? kLargest : -kLargest;
        break;
      case 2:
        p.intensity = -INFINITY;
        break;
      case 3:
        p.x = p.y = p.z = 0.0f;
        break;
      case 4:
        p.x = p.y = p.z = 1e-30f;
        break;
      case 5:
        p.z = NAN;
        break;
      case 6:
        p.x = kLargest;
        break;
      default:
        p.y = INFINITY;
    }
    with.push_back(p);
  }
  for (const std::string& type : namesOf(sceneDescriptions())) {
    PlaceRecognizerOptions options;
    options.description.type = type;
    options.panorama.min_range = 0.0;
    PlaceRecognizer recognizer(options);
    const Place expected = recognizer.describe(good), place = recognizer.describe(with);
    EXPECT_TRUE(place.shape.isSound()) << type;
    for (const Place& p : {expected, place, recognizer.describe(Street(2).scan(Street::at(0.0, 0.0, 0.0)))})
      recognizer.add(p);
    // As it is to itself.
    EXPECT_EQ(recognizer.description().similarity(0, 0), recognizer.description().similarity(0, 1)) << type;
    EXPECT_EQ(expected.shape.patches().size(), place.shape.patches().size()) << type;
  }
}

// An archive that reads a damaged file: one patch is elsewhere.
struct Damage {
  float x;
  void operator()(std::vector<Patch>& patches) const { patches.back().point.x() = x; }
  template <class Value>
  void operator()(Value&) const {}
};

TEST(Shape, IsNotSoundWithPatchesThatNoScannerSees) {
  const Place place = PlaceRecognizer().describe(Street(1).scan(Street::at(0.0, 0.0, 0.0)));
  ASSERT_TRUE(place.shape.isSound());
  for (const float x : {1e30f, -300.0f, NAN, -INFINITY}) {
    Shape damaged = place.shape;
    Damage damage{x};
    damaged.transfer(damage);
    EXPECT_FALSE(damaged.isSound()) << x;
  }
}

/// A small motion, translation first.
Eigen::Isometry3d motion(const Eigen::Matrix<double, 6, 1>& small) {
  const Eigen::Vector3d turn = small.tail<3>();
  return Eigen::Translation3d(small.head<3>()) * Eigen::AngleAxisd(turn.norm(), turn.normalized());
}

TEST(Information, IsOfTheSameErrorInTheAxesOfTheQuery) {
  Registration registration;
  registration.pose = Eigen::Translation3d(3.0, -2.0, 0.5) *
                      Eigen::AngleAxisd(2.1, Eigen::Vector3d(0.2, 0.1, 1.0).normalized());
  Matrix6 root = Matrix6::Random();
  registration.covariance = root * root.transpose() + Matrix6::Identity();
  for (int i = 0; i < 5; ++i) {
    const Eigen::Matrix<double, 6, 1> at_query = 1e-5 * Eigen::Matrix<double, 6, 1>::Random();
    // The same pose by an error in the axes of the match.
    const Eigen::Isometry3d error = registration.pose * motion(at_query) * registration.pose.inverse();
    const Eigen::AngleAxisd turn(error.rotation());
    Eigen::Matrix<double, 6, 1> at_match;
    at_match << error.translation(), turn.angle() * turn.axis();
    const double expected = at_match.dot(registration.covariance.inverse() * at_match);
    EXPECT_NEAR(at_query.dot(informationAtQuery(registration) * at_query), expected, 1e-3 * expected);
  }
}

}  // namespace
}  // namespace intensity_place_recognition
