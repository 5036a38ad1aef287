// SPDX-License-Identifier: BSD-3-Clause
//
// The street of a place runs along x from -60 to 60 m, its road between y = -3.5 and 3.5 m.
#include <mapping_simulation/city.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

namespace mapping_simulation {
namespace {

constexpr double kApart = 200.0, kHalfLength = 60.0;         // m, places and streets
constexpr double kHalfRoad = 3.5, kFront = 6.0;              // m from the middle of the road
constexpr double kHouseWidth = 10.0, kHouseHeight = 12.0;    // m
constexpr double kLotLength = 6.0, kLot = 2.6, kLamp = 5.0;  // m: along; from the middle; height
constexpr double kCurb = 0.12, kPaint = 0.004;               // m, heights
constexpr double kAlong = 0.1745;                            // rad

enum class Kind { kStreet, kCrossing, kGardens, kPark };
constexpr int kKinds = 4;

// What changes with the place and what with the visit have generators of their own.
class Random {
 public:
  Random(std::uint32_t seed, std::uint32_t stream, std::uint32_t number) {
    std::seed_seq sequence{seed, stream, number};
    engine_.seed(sequence);
  }
  double between(double low, double high) { return low + (high - low) * (engine_() / 4294967296.0); }
  bool chance(double p) { return between(0.0, 1.0) < p; }
  Color color(double low, double high) {
    const auto channel = [&] { return static_cast<float>(between(low, high)); };
    const float red = channel(), green = channel();
    return {red, green, channel()};
  }

 private:
  std::mt19937 engine_;
};

Eigen::Isometry3d placed(double x, double y, double z, double yaw = 0.0) {
  return Eigen::Translation3d(x, y, z) * Eigen::Isometry3d(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
}

Texture plain(double reflectivity) {
  Texture texture;
  texture.values = {reflectivity};
  return texture;
}

// Coloured; lasers see its red.
Texture painted(const Color& color) {
  Texture texture = plain(color[0]);
  texture.colors = {color};
  return texture;
}

Texture noise(double low, double high, double size, double detail) {
  Texture texture;
  texture.type = Texture::Type::kNoise;
  texture.values = {low, high};
  texture.size = size;
  texture.detail = detail;
  return texture;
}

Texture lawn(Random& random) {
  const double tone = random.between(0.35, 0.6);  // near infrared, where grass is light
  Texture texture = noise(tone, tone + 0.2, random.between(0.5, 2.0), 0.3);
  texture.colors = {Color(0.12f, 0.24f, 0.07f), Color(0.2f, 0.34f, 0.1f)};
  return texture;
}

class Street {
 public:
  Street(const CityOptions& options, const CityVisit& visit)
      : random_(options.seed, 1, static_cast<std::uint32_t>(visit.place)),
        change_(options.seed, 2, static_cast<std::uint32_t>(visit.place * options.visits + visit.visit)),
        seed_(65536u * (options.seed + 7919u * static_cast<std::uint32_t>(visit.place))),
        kind_(static_cast<Kind>(visit.place % kKinds)),
        occupancy_(options.occupancy) {
    ground();
    for (const double side : {1.0, -1.0}) houses(side);
    road();
    for (const double side : {1.0, -1.0}) furniture(side);
    carsAndPeople();
    light(visit.night);
  }

  World world(const Eigen::Isometry3d& pose) {
    for (Shape& shape : shapes_) shape.pose = pose * shape.pose;
    for (Light::Lamp& lamp : light_.lamps) lamp.position = pose * lamp.position;
    return World(std::move(shapes_), {}, std::move(light_));
  }

 private:
  void add(const char* name, Shape::Type type, const Eigen::Vector3d& size, const Eigen::Isometry3d& pose,
           Texture texture) {
    Shape shape;
    shape.name = name;
    shape.type = type;
    shape.size = size;
    shape.pose = pose;
    shape.texture = std::move(texture);
    shape.texture.span = std::max(1e-3, size.x());
    shape.texture.seed = seed_ + static_cast<std::uint32_t>(shapes_.size());
    shapes_.push_back(std::move(shape));
  }
  void box(const char* name, double x, double y, double z, const Eigen::Vector3d& size, Texture texture) {
    add(name, Shape::Type::kBox, size, placed(x, y, z), std::move(texture));
  }
  void pole(const char* name, double x, double y, double z, double diameter, double height, Texture texture) {
    add(name, Shape::Type::kCylinder, {diameter, diameter, height}, placed(x, y, z), std::move(texture));
  }
  void house(double x, double y, double yaw) {
    Texture front;
    front.type = Texture::Type::kFacade;
    front.size = 3.0;
    add("house", Shape::Type::kBox, {kHouseWidth, 8.0, kHouseHeight},
        placed(x, y, 0.0, yaw) * placed(0.0, 4.0, 0.0), front);
  }

  bool inSideStreet(double x) const { return kind_ == Kind::kCrossing && x > 10.0 && x < 20.0; }
  double frontOf(double side) const {
    return kind_ == Kind::kGardens || (kind_ == Kind::kPark && side < 0.0) ? kFront + 4.0 : kFront;
  }

  void ground() {
    const double tone = random_.between(0.12, 0.28);
    add("road", Shape::Type::kGround, {1.0, 1.0, 1.0}, placed(0.0, 0.0, 0.0),
        noise(tone, tone + 0.1, random_.between(0.6, 3.0), 0.25));
  }

  void houses(double side) {
    const double turn = side > 0.0 ? 0.0 : M_PI, front = side * frontOf(side);
    const bool park = kind_ == Kind::kPark && side < 0.0;
    for (double x = -kHalfLength + 0.5 * kHouseWidth; x < kHalfLength; x += kHouseWidth) {
      if (inSideStreet(x))
        for (int i = 0; i < 3; ++i)
          for (const double edge : {10.0, 20.0})
            house(edge, side * (kFront + (i + 1.5) * kHouseWidth), edge > 15.0 ? -M_PI / 2.0 : M_PI / 2.0);
      else if (!park)
        house(x, front, turn);
    }
    for (const double end : {-1.0, 1.0})  // the street beyond which it ends
      house(end * (kHalfLength + 2.0), side * 0.5 * kHouseWidth, end > 0.0 ? -M_PI / 2.0 : M_PI / 2.0);
    Texture paving;
    paving.type = Texture::Type::kBricks;
    paving.size = 0.6;
    paving.height = 0.4;
    paving.detail = 0.12;
    for (double x = -kHalfLength + 10.0; x < kHalfLength; x += 20.0) {
      const double tone = random_.between(0.25, 0.6);
      paving.values = {tone, tone + 0.15, 0.6 * tone};
      if (!(kind_ == Kind::kCrossing && x == 10.0)) {
        box("pavement", x, side * (kHalfRoad + 1.25), 0.0, {20.0, 2.5, kCurb}, paving);
      } else {
        box("pavement", 5.0, side * (kHalfRoad + 1.25), 0.0, {10.0, 2.5, kCurb}, paving);
      }
      if (kind_ == Kind::kGardens) garden(x, side);
    }
    if (park) {
      box("lawn", 0.0, -28.0, 0.0, {2.0 * kHalfLength, 44.0, kCurb}, lawn(random_));
      for (int i = 0; i < 24; ++i) {
        const double x = -57.5 + 5.0 * i, y = -9.0 - 6.0 * ((7 * i) % 5);
        const double tone = random_.between(0.1, 0.7);
        pole("trunk", x, y, 0.0, 0.4, 4.0, noise(0.5 * tone, tone, 0.3, 0.3));
        pole("crown", x, y, 4.0, 4.0, 4.0, noise(0.4, 0.7, 0.4, 0.4));
      }
    }
  }

  void garden(double x, double side) {
    if (random_.chance(0.6))
      box("lawn", x, side * (kFront + 2.0), 0.0, {20.0, 4.0, kCurb}, lawn(random_));
    else
      box("yard", x, side * (kFront + 2.0), 0.0, {20.0, 4.0, kCurb}, plain(random_.between(0.15, 0.8)));
    for (const double half : {-5.25, 5.25})
      box("wall", x + half, side * (kFront + 0.15), 0.0, {7.5, 0.3, 0.9},
          random_.chance(0.5) ? lawn(random_) : painted(random_.color(0.1, 0.9)));
  }

  void road() {
    const Texture paint = noise(0.5, 0.9, 0.3, 0.2);  // worn
    const double phase = random_.between(0.0, 6.0);
    const bool dashed = random_.chance(0.7);
    for (double x = -kHalfLength + phase; dashed && x < kHalfLength - 3.0; x += 6.0)
      box("mark", x + 1.5, 0.0, 0.0, {3.0, 0.15, kPaint}, paint);
    for (int crossings = 0; crossings < 2; ++crossings) {
      const double x = random_.between(-40.0, 40.0);
      if (!random_.chance(0.6)) continue;
      for (double y = -3.0; y < 3.3; y += 1.0) box("zebra", x, y, 0.0, {4.0, 0.5, kPaint}, paint);
    }
    for (int i = 0; i < 14; ++i) {  // repairs
      const Eigen::Vector3d size(random_.between(0.8, 6.0), random_.between(0.6, 2.5), 0.5 * kPaint);
      const double x = random_.between(-45.0, 45.0), y = random_.between(-2.4, 2.4);
      box("patch", x, y, 0.0, size, plain(random_.between(0.05, 0.4)));
    }
    for (int i = 0; i < 8; ++i) {
      const double x = random_.between(-45.0, 45.0), y = random_.between(-2.5, 2.5);
      pole("manhole", x, y, 0.0, 0.7, kPaint, plain(random_.between(0.1, 0.6)));
    }
  }

  // What stands on the pavements is the same in all streets of a kind but for its paint.
  void furniture(double side) {
    const double y = side * (kHalfRoad + 0.5);
    for (double x = -50.0; x < 55.0; x += 20.0) {
      if (inSideStreet(x)) continue;
      pole("lamp", x, y, 0.0, 0.16, kLamp + 0.2, plain(0.3));
      light_.lamps.push_back({{x, y - side * 0.6, kLamp}, Color::Zero()});
    }
    for (const double x : {-41.0, -24.0, 3.0, 27.0, 44.0})
      box("cabinet", x, side * (kFront - 0.4), kCurb, {1.4, 0.4, 1.3}, painted(random_.color(0.05, 0.95)));
    for (const double x : {-33.0, -8.0, 24.0}) {
      pole("post", x, y, kCurb, 0.08, 2.2, plain(0.5));
      add("sign", Shape::Type::kBox, {0.6, 0.02, 0.6}, placed(x, y, 2.2, M_PI / 2.0),
          painted(random_.color(0.1, 1.0)));
    }
  }

  void carsAndPeople() {
    for (const double side : {1.0, -1.0}) {
      for (double x = -kHalfLength + 3.0; x < kHalfLength; x += kLotLength) {
        if (!change_.chance(occupancy_) || inSideStreet(x)) continue;
        const double at = x + change_.between(-0.5, 0.5), y = side * (kLot + change_.between(-0.1, 0.1));
        const double length = change_.between(3.8, 4.8), height = change_.between(0.5, 0.8);
        const Texture paint = painted(change_.color(0.03, 0.9));
        box("body", at, y, 0.25, {length, 1.7, height}, paint);
        box("cabin", at - 0.2, y, 0.25 + height, {0.55 * length, 1.5, 0.55}, plain(0.1));
        for (const double axle : {-0.3, 0.3})
          add("wheels", Shape::Type::kCylinder, {0.62, 0.62, 1.72},
              placed(at + axle * length, y + 0.86, 0.31) *
                  Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitX()),
              plain(0.06));
      }
    }
    for (int i = 0; i < 8; ++i) {
      const double side = change_.chance(0.5) ? 1.0 : -1.0;
      const double x = change_.between(-40.0, 40.0), y = side * change_.between(4.6, 5.2);
      pole("legs", x, y, kCurb, 0.28, 0.85, plain(change_.between(0.1, 0.7)));
      pole("trunk", x, y, kCurb + 0.85, 0.42, 0.6, painted(change_.color(0.05, 0.9)));
      pole("head", x, y, kCurb + 1.45, 0.22, 0.27, plain(0.5));
    }
  }

  void light(bool night) {
    if (!night) light_.lamps.clear();
    for (Light::Lamp& lamp : light_.lamps) lamp.color = Color(12.0f, 9.5f, 5.5f);
    light_.ambient = night ? 0.02 : 0.6;
    if (night) return;
    const double azimuth = change_.between(0.0, 2.0 * M_PI),
                 elevation = change_.between(0.2, 1.1);  // seasons
    light_.sun = Color(1.0f, 0.95f, 0.85f) * 0.8f;
    light_.to_sun << std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
        std::sin(elevation);
  }

  Random random_, change_;
  std::uint32_t seed_;  // of the first shape's texture
  Kind kind_;
  double occupancy_;
  std::vector<Shape> shapes_;
  Light light_;
};

}  // namespace

Eigen::Isometry3d poseOfPlace(const CityOptions& options, int place) {
  const int columns = static_cast<int>(std::ceil(std::sqrt(options.places)));
  const double yaw = Random(options.seed, 3, static_cast<std::uint32_t>(place)).between(-M_PI, M_PI);
  return placed(kApart * (place % columns), kApart * (place / columns), 0.0, yaw);
}

std::vector<CityVisit> cityVisits(const CityOptions& options) {
  if (options.places < 1 || options.visits < 1 || static_cast<double>(options.places) * options.visits > 1e6)
    throw std::invalid_argument("a city has 1 to a million visits of places");
  if (!(options.shift >= 0.0 && options.shift <= 5.0))
    throw std::invalid_argument("visits are 0 to 5 m from the middle of their place");
  if (!(options.occupancy >= 0.0 && options.occupancy <= 1.0))
    throw std::invalid_argument("0 to 1 of the parking lots can be occupied");
  std::vector<CityVisit> visits;
  for (int visit = 0; visit < options.visits; ++visit) {
    for (int place = 0; place < options.places; ++place) {
      Random random(options.seed, 4, static_cast<std::uint32_t>(place * options.visits + visit));
      const double direction = random.between(-M_PI, M_PI),
                   distance = options.shift * random.between(0.0, 1.0);
      // Cars are parked on both sides.
      const double y = std::clamp(distance * std::sin(direction), -1.0, 1.0);
      CityVisit v;
      v.place = place;
      v.visit = visit;
      v.night = !options.by_day && visit % 2 == 1;
      double yaw = random.between(-M_PI, M_PI);
      if (options.along) yaw = (yaw < 0.0 ? M_PI : 0.0) + random.between(-kAlong, kAlong);
      v.pose = poseOfPlace(options, place) * placed(distance * std::cos(direction), y, 0.0, yaw);
      visits.push_back(v);
    }
  }
  // std::shuffle isn't the same in all libraries.
  Random order(options.seed, 5, 0);
  for (std::size_t i = visits.size(); options.random_order && i > 1; --i)
    std::swap(visits[i - 1], visits[static_cast<std::size_t>(order.between(0.0, static_cast<double>(i)))]);
  return visits;
}

World cityAt(const CityOptions& options, const CityVisit& visit) {
  return Street(options, visit).world(poseOfPlace(options, visit.place));
}

}  // namespace mapping_simulation
