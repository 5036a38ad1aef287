// SPDX-License-Identifier: BSD-3-Clause
//
// Renders a camera that goes along a street twice, with known poses: material for loop_closure_images where
// there is no recording.
#include <mapping_common/files.h>

#include <boost/program_options.hpp>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <limits>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>

#include "street.h"

namespace ibuild_loop_closure {
namespace {

namespace po = boost::program_options;

struct Arguments {
  std::string out;
  int images = 0, width = 0, height = 0, people = 0;
  unsigned seed = 0;
  double baseline = 0.0, step = 0.0, offset = 0.0, sway = 0.0, exposure = 0.0, noise = 0.0;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  po::options_description options(
      "Renders a camera that goes along a street twice.\n"
      "Usage: simulate_walks --out DIR\n"
      "leaves images in DIR/first and DIR/second and the camera's poses in DIR/poses.txt, for\n"
      "  loop_closure_images --images DIR/first --images DIR/second --poses DIR/poses.txt --out "
      "OUT\nOptions");
  // clang-format off
  options.add_options()
      ("help,h", "this text")
      ("out", po::value(&a.out)->required(), "folder for images and poses; made if it isn't there")
      ("seed", po::value(&a.seed)->default_value(1), "of houses, people, motion and noise")
      ("images", po::value(&a.images)->default_value(80), "of each walk, 1 to 1000")
      ("width", po::value(&a.width)->default_value(640), "of an image, pixels, 32 to 4096")
      ("height", po::value(&a.height)->default_value(360), "of an image, pixels, 32 to 4096")
      ("step", po::value(&a.step)->default_value(0.75), "m between two images, 0.01 to 10; images * step: at most 1000")
      ("offset", po::value(&a.offset)->default_value(1.0), "of the second walk to the left, m, -2 to 2")
      ("sway", po::value(&a.sway)->default_value(2.0), "standard deviation of yaw, degrees, 0 to 10; pitch and roll have half of it")
      ("exposure", po::value(&a.exposure)->default_value(0.7), "of the second walk, the first has 1; 0.05 to 5")
      ("noise", po::value(&a.noise)->default_value(3.0), "standard deviation of a pixel, 0 to 100")
      ("baseline", po::value(&a.baseline)->default_value(0.0), "of a stereo camera, m, 0 to 5: right images go to DIR/first_right and DIR/second_right; 0: one camera")
      ("people", po::value(&a.people)->default_value(10), "on the street in each walk, 0 to 1000");
  // clang-format on
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, options), values);
  if (values.count("help") > 0) {
    std::cout << options;
    std::exit(0);
  }
  po::notify(values);
  const auto check = [](const char* name, double value, double low, double high) {
    if (!(value >= low && value <= high)) {
      throw std::invalid_argument(cv::format("--%s is %g, allowed is %g to %g", name, value, low, high));
    }
  };
  check("images", a.images, 1, 1000);
  check("width", a.width, 32, 4096);
  check("height", a.height, 32, 4096);
  check("step", a.step, 0.01, 10);
  check("images * --step", a.images * a.step, 0, 1000);
  check("offset", a.offset, -2, 2);
  check("sway", a.sway, 0, 10);
  check("exposure", a.exposure, 0.05, 5);
  check("noise", a.noise, 0, 100);
  check("baseline", a.baseline, 0, 5);
  check("people", a.people, 0, 1000);
  return a;
}

Pinhole cameraOf(const Arguments& a) {
  return {{a.width, a.height}, 0.62 * a.width, 0.5 * (a.width - 1), 0.5 * (a.height - 1)};
}

// Of a camera that looks along the street; yaw to the left, pitch downwards, rad.
Eigen::Isometry3d poseOf(const Eigen::Vector3d& position, double yaw, double pitch, double roll) {
  Eigen::Matrix3d optical;  // x right, y down, z forward, in a frame with x forward, y left, z up
  optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = position;
  pose.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                  Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                  Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) * optical;
  return pose;
}

// Steps vary, and the camera sways around the line y = offset.
std::vector<Eigen::Isometry3d> walkAlong(const Arguments& a, double offset, cv::RNG& random) {
  constexpr double kEyeHeight = 1.6, kKeep = 0.8;  // m; share of a sway that the next image still has
  const double change = a.sway * CV_PI / 180.0 * std::sqrt(1 - kKeep * kKeep);
  std::vector<Eigen::Isometry3d> poses;
  double x = random.uniform(0.0, a.step), side = 0.0, yaw = 0.0, pitch = 0.0, roll = 0.0;
  for (int i = 0; i < a.images; ++i) {
    side = kKeep * side + random.gaussian(0.05);
    yaw = kKeep * yaw + random.gaussian(change);
    pitch = kKeep * pitch + random.gaussian(0.5 * change);
    roll = kKeep * roll + random.gaussian(0.5 * change);
    poses.push_back(poseOf({x, offset + side, kEyeHeight + random.gaussian(0.02)}, yaw, pitch, roll));
    x += a.step * random.uniform(0.85, 1.15);
  }
  return poses;
}

struct Person {
  Surface surface;
  double speed;  // along x, m per image
};

std::vector<Person> makePeople(const Arguments& a, double length, cv::RNG& random) {
  constexpr double kClear = 2.6;  // m, nobody is nearer to the middle of the street: the camera goes there
  std::vector<Person> people;
  for (int i = 0; i < a.people; ++i) {
    const double x = random.uniform(0.0, length);
    const double y = random.uniform(0, 2) ? random.uniform(kClear, kStreetLeft - 0.5)
                                          : random.uniform(kStreetRight + 0.5, -kClear);
    const double speed = a.step * random.uniform(-0.9, 0.9);
    people.push_back({makePerson(x, y, random), speed});
  }
  return people;
}

cv::Mat exposed(const cv::Mat& image, double exposure, double noise, cv::RNG& random) {
  cv::Mat light, grain(image.size(), CV_32FC3), result;
  random.fill(grain, cv::RNG::NORMAL, 0.0, noise);
  image.convertTo(light, CV_32F, exposure);
  light += grain;
  light.convertTo(result, CV_8U);
  return result;
}

void run(const Arguments& a) {
  cv::RNG random(a.seed);
  constexpr double kAhead = 20.0;  // m of street behind the last image
  const double length = 1.2 * a.images * a.step + kAhead;
  const std::vector<Surface> street = makeStreet(length, random);
  const Pinhole camera = cameraOf(a);
  std::vector<Eigen::Isometry3d> poses;
  for (const bool second : {false, true}) {
    const std::string folder = a.out + (second ? "/second" : "/first");
    std::filesystem::create_directories(folder);
    if (a.baseline > 0.0) std::filesystem::create_directories(folder + "_right");
    const std::vector<Eigen::Isometry3d> walk = walkAlong(a, second ? a.offset : 0.0, random);
    std::vector<Person> people = makePeople(a, length, random);
    for (int i = 0; i < a.images; ++i) {
      std::vector<Surface> visible = street;
      for (Person& person : people) {
        visible.push_back(person.surface);
        person.surface.corner.x() += person.speed;
      }
      const auto write = [&](const std::string& to, const Eigen::Isometry3d& pose) {
        const cv::Mat image =
            exposed(render(visible, camera, pose), second ? a.exposure : 1.0, a.noise, random);
        const std::string path = to + cv::format("/%04d.jpg", i);
        if (!cv::imwrite(path, image)) throw std::runtime_error(path + " can't be written");
      };
      write(folder, walk[i]);
      if (a.baseline > 0.0) write(folder + "_right", walk[i] * Eigen::Translation3d(a.baseline, 0, 0));
      std::cerr << "\rimage " << poses.size() + i + 1 << " of " << 2 * a.images << std::flush;
    }
    poses.insert(poses.end(), walk.begin(), walk.end());
  }
  std::cerr << '\n';
  mapping_common::writeFile(a.out + "/poses.txt", [&](std::ostream& out) {
    out << "# poses of the camera, 3x4, x right, y down, z forward; first walk, then second\n# focal length "
        << camera.focal_length << ", principal point " << camera.cx << ' ' << camera.cy << '\n'
        << std::setprecision(std::numeric_limits<double>::max_digits10);
    for (const Eigen::Isometry3d& pose : poses) {
      for (int i = 0; i < 12; ++i) out << pose(i / 4, i % 4) << (i < 11 ? ' ' : '\n');
    }
  });
}

}  // namespace
}  // namespace ibuild_loop_closure

int main(int argc, char** argv) {
  try {
    ibuild_loop_closure::run(ibuild_loop_closure::parse(argc, argv));
    return 0;
  } catch (const boost::program_options::error& e) {
    std::cerr << "simulate_walks: " << e.what() << ". See simulate_walks --help\n";
    return 2;
  } catch (const std::exception& e) {
    std::cerr << "simulate_walks: " << e.what() << '\n';
    return 1;
  }
}
