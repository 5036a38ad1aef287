// SPDX-License-Identifier: BSD-3-Clause
//
// The Python module rtree_occupancy_map.core: the map and its queries on numpy arrays.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "rtree_occupancy_map/map_transform.h"
#include "rtree_occupancy_map/occupancy_map.h"
#include "rtree_occupancy_map/octomap_file.h"
#include "rtree_occupancy_map/pcd_file.h"
#include "rtree_occupancy_map/window.h"

namespace py = pybind11;

namespace rtree_occupancy_map {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// Rows of the structured arrays. No padding, so that all of their bytes are defined.
struct CellRow {
  double min[3], max[3];
  float log_odds, reflectivity;
  std::uint32_t hits;
  std::uint32_t occupied;
  std::uint8_t color[4];  // RGBA
  std::uint32_t padding;  // no field
};
struct RayRow {
  double point[3], distance;
  float log_odds;
  std::int32_t result;
};

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Bytes = py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>;
using Floats = py::array_t<float, py::array::c_style | py::array::forcecast>;

[[noreturn]] void rejectShape(const std::string& name, const py::array& array, const std::string& expected) {
  throw std::invalid_argument(name + " has the shape " + py::str(array.attr("shape")).cast<std::string>() +
                              ", expected is " + expected);
}

Eigen::Vector3d toVector(const std::string& name, const Doubles& array) {
  if (array.ndim() != 1 || array.shape(0) != 3) rejectShape(name, array, "(3,)");
  return {array.at(0), array.at(1), array.at(2)};
}

// (N, 3), or (3,) for one.
template <class Array>
std::size_t rowsOf(const std::string& name, const Array& array) {
  if (array.ndim() == 1 && array.shape(0) == 3) return 1;
  if (array.ndim() != 2 || array.shape(1) != 3) rejectShape(name, array, "(N, 3)");
  return static_cast<std::size_t>(array.shape(0));
}

Eigen::Vector3d rowOf(const Doubles& array, std::size_t row) {
  const double* p = array.data() + 3 * row;
  return {p[0], p[1], p[2]};
}

std::vector<Eigen::Vector3f> toPoints(const std::string& name, const Floats& array) {
  if (array.size() == 0) return {};
  if (array.ndim() != 2 || array.shape(1) != 3) rejectShape(name, array, "(N, 3)");
  std::vector<Eigen::Vector3f> points;
  points.reserve(static_cast<std::size_t>(array.shape(0)));
  const float* end = array.data() + array.size();
  for (const float* p = array.data(); p != end; p += 3) points.emplace_back(p[0], p[1], p[2]);
  return points;
}

std::vector<Color> toColors(const std::string& name, const Bytes& array) {
  if (array.size() == 0) return {};
  if (array.ndim() != 2 || array.shape(1) != 3) rejectShape(name, array, "(N, 3)");
  std::vector<Color> colors;
  colors.reserve(static_cast<std::size_t>(array.shape(0)));
  const std::uint8_t* end = array.data() + array.size();
  for (const std::uint8_t* c = array.data(); c != end; c += 3) colors.push_back({c[0], c[1], c[2]});
  return colors;
}

template <class T>
py::array_t<T> toArray(const std::vector<T>& values) {
  return py::array_t<T>(values.size(), values.data());
}

py::array_t<double> toArray(const Eigen::Vector3d& v) {
  return py::array_t<double>(3, v.data());
}

void setColor(const Color& color, std::uint8_t* rgba) {
  std::copy(color.begin(), color.end(), rgba);
  rgba[3] = 255;
}

CellRow toRow(const OccupancyMap& map, const Cell& cell) {
  CellRow row{};
  const Eigen::Vector3d min = map.minCorner(cell.box), max = map.maxCorner(cell.box);
  for (int i = 0; i < 3; ++i) {
    row.min[i] = min[i];
    row.max[i] = max[i];
  }
  row.log_odds = cell.log_odds;
  row.reflectivity = cell.reflectivity.mean;
  row.hits = cell.reflectivity.hits;
  row.occupied = map.isOccupied(cell);
  if (const std::optional<Color> color = map.colorOf(cell)) setColor(*color, row.color);
  return row;
}

// Of a value for each point: an array of as many, or one value for one point.
template <class T, class ValueOf>
py::object forEachPoint(const Doubles& points, ValueOf&& valueOf) {
  const std::size_t count = rowsOf("points", points);
  if (points.ndim() == 1) return py::cast(valueOf(rowOf(points, 0)));
  py::array_t<T> values(count);
  for (std::size_t i = 0; i < count; ++i)
    values.mutable_data()[i] = static_cast<T>(valueOf(rowOf(points, i)));
  return py::object(values);
}

// @param options those that aren't given
Options toOptions(const py::kwargs& given, Options options = {}) {
  mapping_common::OptionValues values;
  for (const auto& [name, value] : given) {
    mapping_common::OptionValue& option = values[name.cast<std::string>()];
    if (py::isinstance<py::bool_>(value)) {
      option = value.cast<bool>();
    } else if (py::isinstance<py::int_>(value)) {
      option = value.cast<int>();
    } else if (py::isinstance<py::float_>(value)) {
      option = value.cast<double>();
    } else if (py::isinstance<py::str>(value)) {
      option = value.cast<std::string>();
    } else {
      option = std::monostate();
    }
  }
  mapping_common::assign(options, values);
  return options;
}

py::dict optionsOf(const OccupancyMap& map) {
  Options options = map.options();
  py::dict values;
  for (const auto& [option, section] : mapping_common::optionsOf(options)) {
    std::visit(
        [&values, &name = option.name()](const auto& value) {
          if constexpr (!std::is_same_v<std::decay_t<decltype(value)>, std::monostate>)
            values[py::str(name)] = value;
        },
        option.get());
  }
  return values;
}

bool endsIn(const std::string& path, const std::string& ending) {
  return path.size() >= ending.size() &&
         path.compare(path.size() - ending.size(), ending.size(), ending) == 0;
}

OccupancyMap load(const std::string& path) {
  return endsIn(path, ".bt") || endsIn(path, ".ot") ? readOctomap(path) : OccupancyMap::load(path);
}

void save(const OccupancyMap& map, const std::string& path) {
  if (endsIn(path, ".bt")) {
    writeOctomap(map, path, OctomapFormat::kBinary);
  } else if (endsIn(path, ".ot")) {
    writeOctomap(map, path, OctomapFormat::kFull);
  } else if (endsIn(path, ".pcd")) {
    writePcd(map, path);
  } else {
    map.save(path);
  }
}

WindowOptions windowOf(const std::string& file, double distance, double memory) {
  WindowOptions window;
  window.file = file;
  window.distance = distance;
  window.memory = memory;
  return window;
}

py::dict insertScan(OccupancyMap& map, const Doubles& origin, const Floats& hits, const Floats& misses,
                    const Floats& reflectivity, double time, const Floats& hit_origins,
                    const Floats& miss_origins, const Bytes& colors) {
  Scan scan;
  scan.time = time;
  scan.origin = toVector("origin", origin).cast<float>();
  scan.hits = toPoints("hits", hits);
  scan.misses = toPoints("misses", misses);
  scan.hit_origins = toPoints("hit_origins", hit_origins);
  scan.miss_origins = toPoints("miss_origins", miss_origins);
  if (reflectivity.ndim() != 1) rejectShape("reflectivity", reflectivity, "(N,)");
  scan.colors = toColors("colors", colors);
  scan.reflectivity.assign(reflectivity.data(), reflectivity.data() + reflectivity.size());
  const InsertReport report = map.insertScan(scan);
  using namespace py::literals;
  return py::dict("hits"_a = report.hits, "non_finite"_a = report.non_finite, "too_near"_a = report.too_near,
                  "beyond_range"_a = report.beyond_range, "outside"_a = report.outside,
                  "changed_blocks"_a = report.changed_blocks.size());
}

// @param array a rigid transform, (4, 4)
Eigen::Isometry3d toTransform(const Doubles& array) {
  if (array.ndim() != 2 || array.shape(0) != 4 || array.shape(1) != 4)
    rejectShape("transform", array, "(4, 4)");
  const Eigen::Matrix4d matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(array.data());
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  constexpr double kTolerance = 1e-6;
  if (!matrix.allFinite() || !rotation.isUnitary(kTolerance) || rotation.determinant() < 0.0 ||
      (matrix.row(3) - Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0)).norm() > kTolerance)
    throw std::invalid_argument("transform isn't a rotation and a translation");
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.linear() = rotation;
  transform.translation() = matrix.topRightCorner<3, 1>();
  return transform;
}

py::bytes toBytes(const OccupancyMap& map) {
  return py::bytes(map.toBytes());
}

OccupancyMap fromBytes(const py::bytes& bytes) {
  const std::string content = bytes;
  return OccupancyMap::fromBytes(content.data(), content.data() + content.size(), "the map in bytes");
}

py::array_t<CellRow> cellsInBox(const OccupancyMap& map, const Doubles& min, const Doubles& max,
                                bool occupied_only) {
  std::vector<CellRow> rows;
  map.visitBox(toVector("min", min), toVector("max", max), [&](const Cell& cell) {
    if (!occupied_only || map.isOccupied(cell)) rows.push_back(toRow(map, cell));
    return true;
  });
  return toArray(rows);
}

py::array_t<CellRow> occupiedCells(const OccupancyMap& map) {
  std::vector<CellRow> rows;
  map.visitOccupied([&](const Cell& cell) {
    rows.push_back(toRow(map, cell));
    return true;
  });
  return toArray(rows);
}

py::array_t<RayRow> castRays(const OccupancyMap& map, const Doubles& origins, const Doubles& directions,
                             double max_range, bool ignore_unknown) {
  const std::size_t count = rowsOf("directions", directions), starts = rowsOf("origins", origins);
  if (starts != 1 && starts != count)
    rejectShape("origins", origins, "(3,) or (" + std::to_string(count) + ", 3)");
  std::vector<RayRow> rows;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d origin = rowOf(origins, starts == 1 ? 0 : i);
    const RayHit hit = map.castRay(origin, rowOf(directions, i), max_range, ignore_unknown);
    RayRow row{};
    for (int k = 0; k < 3; ++k) row.point[k] = hit.point[k];
    row.distance = (hit.point - origin).norm();
    row.result = static_cast<std::int32_t>(hit.result);
    row.log_odds = hit.result == RayHit::Result::kOccupied ? hit.cell.log_odds : kNan;
    rows.push_back(row);
  }
  return toArray(rows);
}

py::array_t<CellRow> nearestOccupied(const OccupancyMap& map, const Doubles& point, std::size_t k) {
  std::vector<CellRow> rows;
  for (const Cell& cell : map.nearestOccupied(toVector("point", point), k)) rows.push_back(toRow(map, cell));
  return toArray(rows);
}

py::dict statisticsOf(const OccupancyMap& map) {
  const Statistics s = map.statistics();
  using namespace py::literals;
  return py::dict("cells"_a = s.cells, "occupied_cells"_a = s.occupied_cells, "free_cells"_a = s.free_cells,
                  "occupied_volume"_a = s.occupied_volume, "free_volume"_a = s.free_volume,
                  "nodes"_a = s.nodes, "height"_a = s.height, "memory_bytes"_a = s.memory_bytes);
}

constexpr const char* kModule = R"(3D occupancy map of cuboids of variable size in an R-tree.

Points and boxes are in the map's frame, in metres, x forward, y to the left, z up where the frame is as REP 103
says. Arrays of other numbers are converted. Cells come as structured arrays of numpy with the fields
  min, max      (N, 3) float64, m: corners of the cuboid
  log_odds      (N,) float32
  reflectivity  (N,) float32: mean of the returns, NaN where there are none
  hits          (N,) uint32: returns that it is the mean of
  occupied      (N,) uint32: 1 or 0
  color         (N, 4) uint8: mean red, green, blue over the voxels, and 255; all 0 where there is none
so that cells['max'] - cells['min'] are their sizes. What can't be done raises ValueError (arguments) or RuntimeError
(files) with the reason. A map may be used by one thread at a time.)";

}  // namespace

PYBIND11_MODULE(core, module) {
  PYBIND11_NUMPY_DTYPE(CellRow, min, max, log_odds, reflectivity, hits, occupied, color);
  PYBIND11_NUMPY_DTYPE(RayRow, point, distance, log_odds, result);
  module.doc() = kModule;
  module.attr("UNKNOWN") = static_cast<int>(VoxelState::kUnknown);
  module.attr("FREE") = static_cast<int>(VoxelState::kFree);
  module.attr("OCCUPIED") = static_cast<int>(VoxelState::kOccupied);
  module.attr("RAY_OCCUPIED") = static_cast<int>(RayHit::Result::kOccupied);
  module.attr("RAY_UNKNOWN") = static_cast<int>(RayHit::Result::kUnknown);
  module.attr("RAY_NOTHING") = static_cast<int>(RayHit::Result::kNothing);

  py::class_<OccupancyMap>(module, "OccupancyMap", "The map. See the module for shapes, units and frames.")
      .def(py::init([](const py::kwargs& given) { return OccupancyMap(toOptions(given)); }),
           "OccupancyMap(resolution=0.1, **{'sensor_model/max_range': 30.0}): an empty map. The options are "
           "those\n"
           "of the nodelet's parameters, docs/parameters.md; ValueError names one that there isn't or that "
           "won't "
           "do.")
      .def_static("load", &load, py::arg("path"),
                  "The map of a file: .bt or .ot of OctoMap, otherwise the R-tree map's; the cells of a .db "
                  "are read when they\nare needed.")
      .def("save", &save, py::arg("path"),
           "Writes the map; .bt and .ot for OctoMap, .pcd the centres of the occupied voxels for PCL, "
           "otherwise the\n"
           "R-tree map's own file.")
      .def_static(
          "open",
          [](const std::string& file, double distance, double memory) {
            return OccupancyMap::open(windowOf(file, distance, memory));
          },
          py::arg("file"), py::arg("distance") = WindowOptions().distance,
          py::arg("memory") = WindowOptions().memory, "Goes on with a map that keep_in has put into a file.")
      .def(
          "keep_in",
          [](OccupancyMap& map, const std::string& file, double distance, double memory) {
            map.keepIn(windowOf(file, distance, memory));
          },
          py::arg("file"), py::arg("distance") = WindowOptions().distance,
          py::arg("memory") = WindowOptions().memory,
          "From here on a rolling window: blocks farther than distance (m) from the last scan's origin, and "
          "those\n"
          "used longest ago beyond memory (MiB), are in a new file (.db) alone. Queries see no difference.")
      .def("flush", &OccupancyMap::flush, "Writes to that file what is in memory alone.")
      .def_property_readonly("options", &optionsOf, "Values of all options by their names, as a dict.")
      .def_property_readonly(
          "resolution", [](const OccupancyMap& map) { return map.options().resolution; },
          "m, edge of a voxel, the smallest cell.")
      .def(
          "insert_scan", &insertScan, py::arg("origin"), py::arg("hits"), py::arg("misses") = Floats(0),
          py::arg("reflectivity") = Floats(0), py::arg("time") = 0.0, py::arg("hit_origins") = Floats(0),
          py::arg("miss_origins") = Floats(0), py::arg("colors") = Bytes(0),
          "Updates every voxel that a scan touches once.\n\n"
          "origin: (3,), where the beams start. hits: (N, 3), where they were reflected. misses: (M, 3), "
          "ends of\n"
          "beams without a return, which only clear. reflectivity: (N,), if the map has option "
          "reflectivity.\n"
          "time: s, when it was measured, for option decay_time. hit_origins, miss_origins: (N, 3), (M, 3), "
          "of a\n"
          "sensor that moved meanwhile: where the beam to each starts, instead of at origin. colors: (N, 3), "
          "red,\n"
          "green, blue, 0 to 255, if the map has option color.\n"
          "Returns a dict with how many hits were mapped, and left out and why, and of changed blocks of "
          "32^3 "
          "voxels.")
      .def("set_range", &OccupancyMap::setRange, py::arg("min_range"), py::arg("max_range"),
           "Changes the options sensor_model/min_range and max_range (m) for the scans to come.")
      .def(
          "merged", [](const OccupancyMap& a, const OccupancyMap& b) { return merged(a, b); },
          py::arg("other"),
          "A new map of what either of two knows. What both know adds up, as of independent observations. "
          "Frame and\n"
          "resolution of the other have to be this one's: transformed() makes them so.")
      .def(
          "transformed",
          [](const OccupancyMap& map, const Doubles& transform, const py::kwargs& options) {
            return transformed(map, toTransform(transform), toOptions(options, map.options()));
          },
          py::arg("transform"),
          "transformed(numpy.eye(4), resolution=0.5): a new map in another frame, with other options than "
          "this\n"
          "one's where some are given. transform: (4, 4), from this map's frame to the new one's. A larger "
          "voxel is\n"
          "as occupied as the most occupied part of it.")
      .def("to_bytes", &toBytes, "What save() writes to a .map file.")
      .def_static("from_bytes", &fromBytes, py::arg("bytes"), "The map of that. pickle and copy do the same.")
      .def(py::pickle(&toBytes, &fromBytes))
      .def("__copy__", [](const OccupancyMap& map) { return fromBytes(toBytes(map)); })
      .def("__deepcopy__", [](const OccupancyMap& map, const py::dict&) { return fromBytes(toBytes(map)); })
      .def("clear", &OccupancyMap::clear, "Forgets all cells.")
      .def(
          "clear_box",
          [](OccupancyMap& map, const Doubles& min, const Doubles& max) {
            return map.clearBox(toVector("min", min), toVector("max", max)).size();
          },
          py::arg("min"), py::arg("max"),
          "Makes all known voxels of a box free. min, max: (3,). Returns the number of blocks that changed.")
      .def(
          "cell_at",
          [](const OccupancyMap& map, const Doubles& point) -> py::object {
            const std::optional<Cell> cell = map.cellAt(toVector("point", point));
            if (!cell) return py::none();
            return toArray(std::vector<CellRow>{toRow(map, *cell)})[py::int_(0)];
          },
          py::arg("point"),
          "The cell at a point (3,), as a row of a cells array; None where space is unknown.")
      .def(
          "state_at",
          [](const OccupancyMap& map, const Doubles& points) {
            return forEachPoint<std::int8_t>(
                points, [&map](const Eigen::Vector3d& p) { return static_cast<int>(map.stateAt(p)); });
          },
          py::arg("points"),
          "UNKNOWN, FREE or OCCUPIED at points (N, 3): (N,) int8; at one point (3,): an int.")
      .def(
          "log_odds_at",
          [](const OccupancyMap& map, const Doubles& points) {
            return forEachPoint<float>(points, [&map](const Eigen::Vector3d& p) {
              const std::optional<Cell> cell = map.cellAt(p);
              return cell ? cell->log_odds : kNan;
            });
          },
          py::arg("points"),
          "Log odds at points (N, 3): (N,) float32, NaN where space is unknown; at one point (3,): a float.")
      .def(
          "colors_at",
          [](const OccupancyMap& map, const Doubles& points) {
            const std::size_t count = rowsOf("points", points);
            py::array_t<std::uint8_t> colors({count, std::size_t{4}});
            std::fill(colors.mutable_data(), colors.mutable_data() + colors.size(), std::uint8_t{0});
            for (std::size_t i = 0; i < count; ++i) {
              if (const auto color = map.colorAt(rowOf(points, i)))
                setColor(*color, colors.mutable_data() + 4 * i);
            }
            return points.ndim() == 1 ? py::object(colors[py::int_(0)]) : py::object(colors);
          },
          py::arg("points"),
          "Mean colours of the voxels at points (N, 3): (N, 4) uint8, red, green, blue and 255, or all 0 "
          "where "
          "there\n"
          "is none; at one point (3,): (4,).")
      .def("cells_in_box", &cellsInBox, py::arg("min"), py::arg("max"), py::arg("occupied_only") = false,
           "The cells that overlap a box. min, max: (3,); infinite ones reach to the map's ends.")
      .def("occupied_cells", &occupiedCells, "All occupied cells. Free ones aren't touched.")
      .def("cast_rays", &castRays, py::arg("origins"), py::arg("directions"),
           py::arg("max_range") = std::numeric_limits<double>::infinity(), py::arg("ignore_unknown") = true,
           "Follows N rays, each to the first occupied cell.\n\n"
           "origins: (N, 3), or (3,) for all. directions: (N, 3), of any length but zero. max_range: m.\n"
           "ignore_unknown: rays pass through unknown space; otherwise they end there.\n"
           "Returns a structured array (N,) with the fields point (m, where the ray ends), distance (m), "
           "log_odds\n"
           "(of the occupied cell, else NaN) and result (RAY_OCCUPIED, RAY_UNKNOWN or RAY_NOTHING).")
      .def("nearest_occupied", &nearestOccupied, py::arg("point"), py::arg("k") = 1,
           "The k occupied cells nearest to a point (3,), by distance to the cuboid, nearest first.")
      .def("statistics", &statisticsOf,
           "A dict: cells, occupied_cells, free_cells; occupied_volume, free_volume (m^3); nodes and height "
           "of the\n"
           "R-tree; memory_bytes.")
      .def_property_readonly(
          "bounds",
          [](const OccupancyMap& map) -> py::object {
            const VoxelBox box = map.bounds();
            if (box.isEmpty()) return py::none();
            return py::make_tuple(toArray(map.minCorner(box)), toArray(map.maxCorner(box)));
          },
          "Corners (3,) and (3,) of the box around all that is known; None for an empty map.")
      .def(
          "__len__", [](const OccupancyMap& map) { return map.size(); }, "The number of cells.");
  module.def("probability", py::vectorize(&OccupancyMap::probability), py::arg("log_odds"),
             "The probabilities that log odds, of any shape, stand for.");
}

}  // namespace rtree_occupancy_map
