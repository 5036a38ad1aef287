// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/calibration_file.h"

#include <mapping_common/files.h>
#include <yaml-cpp/yaml.h>

#include <boost/crc.hpp>
#include <cstdio>
#include <sstream>
#include <stdexcept>

namespace laser_intensity_calib {
namespace {

const char kFormat[] = "laser_intensity_calibration";
constexpr int kVersion = 1;
const char kChecksumLine[] = "\nchecksum: ";
constexpr double kRadians = M_PI / 180.0;
constexpr int kMaxNodes = 10000;  // of an axis

std::string checksumOf(const std::string& bytes) {
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  char hex[9];
  std::snprintf(hex, sizeof(hex), "%08x", static_cast<unsigned>(crc.checksum()));
  return hex;
}

void emit(YAML::Emitter& out, const std::string& key, const Interval& interval, double unit = 1.0) {
  out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq << interval.min / unit
      << interval.max / unit << YAML::EndSeq;
}

void emit(YAML::Emitter& out, const std::string& key, const Axis& axis, double unit = 1.0) {
  out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "min" << YAML::Value
      << axis.min / unit << YAML::Key << "step" << YAML::Value << axis.step / unit << YAML::Key << "count"
      << YAML::Value << axis.count << YAML::EndMap;
}

std::string toYaml(const Calibration& c) {
  YAML::Emitter out;
  out.SetDoublePrecision(9);
  out.SetFloatPrecision(6);
  out << YAML::BeginMap << YAML::Key << "format" << YAML::Value << kFormat << YAML::Key << "version"
      << YAML::Value << kVersion << YAML::Key << "scanner" << YAML::Value << YAML::DoubleQuoted << c.scanner
      << YAML::Key << "reference" << YAML::Value << YAML::DoubleQuoted << c.reference << YAML::Key << "date"
      << YAML::Value << YAML::DoubleQuoted << c.date << YAML::Key << "source" << YAML::Value
      << YAML::DoubleQuoted << c.source << YAML::Key << "samples" << YAML::Value << c.samples << YAML::Key
      << "scans" << YAML::Value << c.scans;
  emit(out, "range", c.range);
  emit(out, "incidence_deg", c.incidence, kRadians);
  out << YAML::Key << "residuals" << YAML::Value << YAML::BeginMap;
  for (const ModelType type : kModelTypes) {
    const Residuals& r = c.residuals[static_cast<int>(type)];
    out << YAML::Key << toString(type) << YAML::Value << YAML::Flow << YAML::BeginMap << YAML::Key << "rms"
        << YAML::Value << r.rms << YAML::Key << "median" << YAML::Value << r.median << YAML::Key << "covered"
        << YAML::Value << r.covered << YAML::EndMap;
  }
  out << YAML::EndMap << YAML::Key << "raw" << YAML::Value << c.raw;
  if (!c.offsets.empty()) out << YAML::Key << "offsets" << YAML::Value << YAML::Flow << c.offsets;
  if (c.has(ModelType::kRange)) {
    out << YAML::Key << "polynomial" << YAML::Value << YAML::BeginMap;
    emit(out, "range", c.polynomial.range());
    out << YAML::Key << "coefficients" << YAML::Value << YAML::Flow << c.polynomial.coefficients()
        << YAML::EndMap;
  }
  if (c.has(ModelType::kLut)) {
    out << YAML::Key << "table" << YAML::Value << YAML::BeginMap;
    emit(out, "range", c.table.range());
    emit(out, "incidence_deg", c.table.incidence(), kRadians);
    out << YAML::Key << "intensity" << YAML::Value << YAML::BeginSeq;
    for (Eigen::Index r = 0; r < c.table.values().rows(); ++r) {
      out << YAML::Flow << YAML::BeginSeq;
      for (Eigen::Index a = 0; a < c.table.values().cols(); ++a) out << c.table.values()(r, a);
      out << YAML::EndSeq;
    }
    out << YAML::EndSeq << YAML::EndMap;
  }
  out << YAML::EndMap;
  return std::string(
             "# What intensity a laser scanner reports of a reference surface, over range (m) and angle of "
             "incidence.\n# Written by laser_intensity_calib calibrate; the checksum is of all lines before "
             "it.\n") +
         out.c_str();
}

// A value that must be there.
template <class T>
T get(const YAML::Node& node, const std::string& key) {
  if (!node.IsMap() || !node[key]) throw std::runtime_error("it has no " + key);
  try {
    return node[key].as<T>();
  } catch (const YAML::Exception&) {
    throw std::runtime_error("its " + key + " is malformed");
  }
}

Interval readInterval(const YAML::Node& node, const std::string& key, double unit = 1.0) {
  const auto ends = get<std::vector<double>>(node, key);
  if (ends.size() != 2 || !(ends[0] <= ends[1])) throw std::runtime_error("its " + key + " is no interval");
  return {ends[0] * unit, ends[1] * unit};
}

Axis readAxis(const YAML::Node& node, const std::string& key, double unit = 1.0) {
  const auto axis = get<YAML::Node>(node, key);
  const Axis result{get<double>(axis, "min") * unit, get<double>(axis, "step") * unit,
                    get<int>(axis, "count")};
  if (result.count < 2 || result.count > kMaxNodes) {
    throw std::runtime_error("its " + key + " has " + std::to_string(result.count) + " nodes");
  }
  return result;
}

LookupTable readTable(const YAML::Node& node) {
  const Axis range = readAxis(node, "range"), incidence = readAxis(node, "incidence_deg", kRadians);
  const auto rows = get<std::vector<std::vector<float>>>(node, "intensity");
  Eigen::ArrayXXf values(range.count, incidence.count);
  bool fits = static_cast<Eigen::Index>(rows.size()) == values.rows();
  for (std::size_t r = 0; fits && r < rows.size(); ++r) {
    fits = static_cast<Eigen::Index>(rows[r].size()) == values.cols();
    for (std::size_t a = 0; fits && a < rows[r].size(); ++a) values(r, a) = rows[r][a];
  }
  if (!fits) throw std::runtime_error("its table hasn't as many intensities as nodes");
  return LookupTable(range, incidence, values);
}

Calibration fromYaml(const YAML::Node& node) {
  Calibration c;
  c.scanner = get<std::string>(node, "scanner");
  c.reference = get<std::string>(node, "reference");
  c.date = get<std::string>(node, "date");
  c.source = get<std::string>(node, "source");
  c.samples = get<std::size_t>(node, "samples");
  c.scans = get<std::size_t>(node, "scans");
  c.range = readInterval(node, "range");
  c.incidence = readInterval(node, "incidence_deg", kRadians);
  const auto residuals = get<YAML::Node>(node, "residuals");
  for (const ModelType type : kModelTypes) {
    const auto r = get<YAML::Node>(residuals, toString(type));
    c.residuals[static_cast<int>(type)] = {get<double>(r, "rms"), get<double>(r, "median"),
                                           get<double>(r, "covered")};
  }
  c.raw = get<double>(node, "raw");
  if (!(c.raw > 0.0) || !std::isfinite(c.raw)) throw std::runtime_error("its raw intensity isn't positive");
  if (node["offsets"]) c.offsets = get<std::vector<float>>(node, "offsets");
  for (const float offset : c.offsets)
    if (std::isinf(offset)) throw std::runtime_error("its offsets aren't finite");
  if (node["polynomial"]) {
    const auto p = get<YAML::Node>(node, "polynomial");
    c.polynomial = RangePolynomial(readInterval(p, "range"), get<std::vector<double>>(p, "coefficients"));
  }
  if (node["table"]) c.table = readTable(get<YAML::Node>(node, "table"));
  return c;
}

// The lines that the checksum is of, checked.
YAML::Node verified(const std::string& bytes) {
  if (bytes.find(std::string("\nformat: ") + kFormat + '\n') == std::string::npos) {
    throw std::runtime_error("it is no calibration of laser_intensity_calib");
  }
  const std::size_t line = bytes.rfind(kChecksumLine);
  const std::string content = bytes.substr(0, line == std::string::npos ? bytes.size() : line + 1);
  const std::string stored = line == std::string::npos ? "" : bytes.substr(line + sizeof(kChecksumLine) - 1);
  std::istringstream version_line(content.substr(std::min(content.size(), content.find("\nversion: "))));
  std::string key;
  int version = 0;
  if (version_line >> key >> version && version != kVersion) {
    throw std::runtime_error("it is of version " + std::to_string(version) + ", this program reads version " +
                             std::to_string(kVersion));
  }
  if (stored.empty()) throw std::runtime_error("it is truncated");
  if (stored != '"' + checksumOf(content) + "\"\n") {
    throw std::runtime_error("its checksum doesn't fit: it is damaged or was changed");
  }
  return YAML::Load(content);
}

}  // namespace

void saveCalibration(const Calibration& calibration, const std::string& path) {
  const std::string content = toYaml(calibration) + '\n';
  mapping_common::writeFile(path, [&content](std::ostream& out) {
    out << content << &kChecksumLine[1] << '"' << checksumOf(content) << "\"\n";
  });
}

Calibration loadCalibration(const std::string& path) {
  const std::string bytes = mapping_common::readFile(path);
  try {
    return fromYaml(verified(bytes));
  } catch (const std::exception& e) {
    throw std::runtime_error("The calibration " + path + " can't be read: " + e.what());
  }
}

}  // namespace laser_intensity_calib
