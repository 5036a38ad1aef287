// SPDX-License-Identifier: BSD-3-Clause
//
// E57 (ASTM E2807): pages with checksums, an XML part that describes the scans, and their points in packets.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "e57_fields.h"
#include "e57_pages.h"
#include "e57_xml.h"
#include "readers.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr std::uint64_t kPageSize = 1024;
constexpr std::uint64_t kLongestXml = std::uint64_t{1} << 27U;
constexpr std::uint64_t kMaxConstantRecords = 1000000;  // of points that take no bits, as all are the same
constexpr std::uint32_t kOutside = std::numeric_limits<std::uint32_t>::max();

// What is read of a point.
enum Role {
  kX,
  kY,
  kZ,
  kState,
  kIntensity,
  kNoIntensity,
  kRed,
  kGreen,
  kBlue,
  kNoColour,
  kRow,
  kColumn,
  kRoles
};
using Names = std::array<const char*, kRoles>;
constexpr Names kCartesian = {"cartesianX", "cartesianY",         "cartesianZ", "cartesianInvalidState",
                              "intensity",  "isIntensityInvalid", "colorRed",   "colorGreen",
                              "colorBlue",  "isColorInvalid",     "rowIndex",   "columnIndex"};
constexpr Names kSpherical = {
    "sphericalRange", "sphericalAzimuth",   "sphericalElevation", "sphericalInvalidState",
    "intensity",      "isIntensityInvalid", "colorRed",           "colorGreen",
    "colorBlue",      "isColorInvalid",     "rowIndex",           "columnIndex"};

struct Layout {
  std::array<int, kRoles> field;  // -1: there is none
  bool spherical = false;

  bool has(int role) const { return field[role] >= 0; }
  bool hasPosition() const { return has(kX) && has(kY) && has(kZ); }
};

Layout findFields(const std::vector<E57Field>& fields) {
  const auto find = [&](const Names& names) {
    Layout layout;
    layout.field.fill(-1);
    for (std::size_t i = 0; i < fields.size(); ++i) {
      const auto* name = std::find(names.begin(), names.end(), fields[i].name);
      if (name != names.end() && fields[i].type != E57Field::Type::kString) {
        layout.field[name - names.begin()] = static_cast<int>(i);
      }
    }
    return layout;
  };
  Layout layout = find(kCartesian);
  if (layout.hasPosition()) return layout;
  layout = find(kSpherical);
  layout.spherical = true;
  return layout;
}

std::optional<Limits> limitsOf(const std::optional<Limits>& told, const E57Field& field) {
  if (told) return told;
  if (field.bounded && field.highest > field.lowest) return Limits{field.lowest, field.highest};
  return {};
}

std::uint32_t cellIndex(double value, double minimum) {
  const double index = value - minimum;
  return index >= 0.0 && index < static_cast<double>(kOutside) ? static_cast<std::uint32_t>(index) : kOutside;
}

class E57Reader : public ScanFileReader {
 public:
  E57Reader(std::shared_ptr<ByteSource> source, const ReadOptions& options)
      : source_(std::move(source)), options_(options), pages_(*source_, options.verify_checksums) {
    for (E57Scan& scan : parseE57Xml(readXml(), warnings_)) addScan(std::move(scan));
  }

  ScanFormat format() const override { return ScanFormat::kE57; }
  bool read(std::size_t scan, const PointSink& sink) override;
  std::vector<std::string> warnings() const override {
    std::vector<std::string> all = warnings_;
    if (const std::string damage = pages_.damage(); !damage.empty()) all.push_back(damage);
    return all;
  }

 private:
  struct Scan {
    E57Scan xml;
    Layout layout;
    E57Section section;
  };

  std::string readXml();
  void addScan(E57Scan xml);
  void findGrid(Scan& scan, ScanInfo& info);
  Limits findBounds(const Scan& scan, Role role);
  E57Stream stream(const Scan& scan, int role);

  std::shared_ptr<ByteSource> source_;
  ReadOptions options_;
  E57Pages pages_;
  std::vector<Scan> details_;
};

std::string E57Reader::readXml() {
  struct {
    char magic[8];
    std::uint32_t major, minor;
    std::uint64_t file_length, xml_offset, xml_length, page_size;
  } header;
  static_assert(sizeof header == 48);
  if (source_->read(0, reinterpret_cast<char*>(&header), sizeof header) != sizeof header) {
    throw std::runtime_error("is truncated in its header");
  }
  if (header.major != 1)
    throw std::runtime_error("is of E57 version " + std::to_string(header.major) + ", expected 1");
  if (header.page_size != kPageSize) {
    throw std::runtime_error("has pages of " + std::to_string(header.page_size) + " bytes, expected 1024");
  }
  if (header.file_length > source_->size()) {
    throw std::runtime_error("is truncated: it announces " + std::to_string(header.file_length) +
                             " bytes and has " + std::to_string(source_->size()));
  }
  if (header.file_length < source_->size()) {
    warnings_.push_back(std::to_string(source_->size() - header.file_length) +
                        " bytes after the end of the E57 file");
  }
  const std::uint64_t start = pages_.toLogical(header.xml_offset);
  if (header.xml_length > std::min(kLongestXml, pages_.size() - start)) {
    throw std::runtime_error("has an XML part of " + std::to_string(header.xml_length) +
                             " bytes, which it can't hold");
  }
  std::string xml(header.xml_length, '\0');
  pages_.read(start, &xml[0], xml.size());
  return xml;
}

void E57Reader::addScan(E57Scan xml) {
  Scan scan;
  scan.layout = findFields(xml.fields);
  scan.xml = std::move(xml);
  const std::string& name = scan.xml.name;
  const std::uint64_t records = scan.xml.records;
  if (records > 0) {
    if (!scan.layout.hasPosition()) {
      throw std::runtime_error("has in " + name +
                               " neither cartesianX, Y, Z nor sphericalRange, Azimuth, Elevation");
    }
    scan.section = readSection(pages_, scan.xml.file_offset, scan.xml.fields.size());
    std::uint64_t bits = 0;
    for (const E57Field& field : scan.xml.fields) bits += field.bits();
    const std::uint64_t bytes = scan.section.end - scan.section.first_packet;
    if (records > (bits > 0 ? 8 * bytes / bits : kMaxConstantRecords)) {
      throw std::runtime_error("announces " + std::to_string(records) + " points in " + name +
                               ", which its " + std::to_string(bytes) + " bytes can't hold");
    }
  }
  ScanInfo info;
  info.name = name;
  info.points = records;
  info.has_intensity = scan.layout.has(kIntensity);
  info.has_colour = scan.layout.has(kRed) && scan.layout.has(kGreen) && scan.layout.has(kBlue);
  info.pose = scan.xml.pose;
  info.has_pose = scan.xml.has_pose;
  if (info.has_intensity) {
    info.intensity_limits = limitsOf(scan.xml.intensity, scan.xml.fields[scan.layout.field[kIntensity]]);
    if (!info.intensity_limits && options_.intensity == IntensityScale::kNormalised) {
      warnings_.push_back(name + " tells no limits of its intensities; they are left as they are");
    }
  }
  findGrid(scan, info);
  scans_.push_back(std::move(info));
  details_.push_back(std::move(scan));
}

void E57Reader::findGrid(Scan& scan, ScanInfo& info) {
  if (info.points == 0 || !scan.layout.has(kRow) || !scan.layout.has(kColumn)) return;
  if (!scan.xml.rows) scan.xml.rows = findBounds(scan, kRow);
  if (!scan.xml.columns) scan.xml.columns = findBounds(scan, kColumn);
  const double rows = scan.xml.rows->max - scan.xml.rows->min + 1;
  const double columns = scan.xml.columns->max - scan.xml.columns->min + 1;
  if (!(rows < kOutside && columns < kOutside)) {
    warnings_.push_back(info.name + " has rows and columns that make no grid");
    return;
  }
  info.rows = static_cast<std::uint32_t>(rows);
  info.columns = static_cast<std::uint32_t>(columns);
}

// For files that don't tell them: the first pass of two.
Limits E57Reader::findBounds(const Scan& scan, Role role) {
  E57Stream values = stream(scan, role);
  std::array<double, kChunkPoints> chunk;
  constexpr double kInf = std::numeric_limits<double>::infinity();
  Limits bounds{kInf, -kInf};
  for (std::uint64_t done = 0; done < scan.xml.records;) {
    const std::size_t count = std::min<std::uint64_t>(kChunkPoints, scan.xml.records - done);
    values.read(chunk.data(), count);
    for (std::size_t i = 0; i < count; ++i) {
      bounds.min = std::min(bounds.min, chunk[i]);
      bounds.max = std::max(bounds.max, chunk[i]);
    }
    done += count;
    const double progress = static_cast<double>(done) / static_cast<double>(scan.xml.records);
    if (options_.opening && !options_.opening(progress)) throw ReadStopped();
  }
  return bounds;
}

E57Stream E57Reader::stream(const Scan& scan, int role) {
  const int index = scan.layout.field[role];
  return {pages_, scan.section, scan.xml.fields[index], static_cast<std::size_t>(index)};
}

bool E57Reader::read(std::size_t index, const PointSink& sink) {
  const ScanInfo& info = scans_.at(index);
  const Scan& scan = details_.at(index);
  const Layout& layout = scan.layout;
  if (info.points == 0) return sink({}, 1.0);

  std::vector<std::pair<int, E57Stream>> streams;
  for (int role = 0; role < kRoles; ++role) {
    if (layout.has(role)) streams.emplace_back(role, stream(scan, role));
  }
  const IntensityMap intensity(options_, info.intensity_limits);
  struct {
    double offset = 0.0, factor = 1.0;
  } colour[3];
  for (int i = 0; info.has_colour && i < 3; ++i) {
    if (const auto limits = limitsOf(scan.xml.colour[i], scan.xml.fields[layout.field[kRed + i]])) {
      colour[i] = {limits->min, 255.0 / (limits->max - limits->min)};
    }
  }

  std::vector<std::array<double, kChunkPoints>> values(kRoles);
  std::vector<ScanPoint> points;
  for (std::uint64_t done = 0; done < info.points;) {
    const std::size_t count = std::min<std::uint64_t>(kChunkPoints, info.points - done);
    for (auto& [role, stream] : streams) stream.read(values[role].data(), count);
    points.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      ScanPoint& point = points[i];
      point.x = values[kX][i];
      point.y = values[kY][i];
      point.z = values[kZ][i];
      if (layout.spherical) {
        const double range = point.x, azimuth = point.y, elevation = point.z;
        point.x = range * std::cos(elevation) * std::cos(azimuth);
        point.y = range * std::cos(elevation) * std::sin(azimuth);
        point.z = range * std::sin(elevation);
      }
      point.valid = layout.has(kState) ? values[kState][i] == 0.0 && std::isfinite(point.x) &&
                                             std::isfinite(point.y) && std::isfinite(point.z)
                                       : isMeasured(point.x, point.y, point.z);
      point.intensity = values[kNoIntensity][i] == 0.0 ? intensity(values[kIntensity][i])
                                                       : std::numeric_limits<float>::quiet_NaN();
      const bool coloured = info.has_colour && values[kNoColour][i] == 0.0;
      const auto channel = [&](int k) {
        return coloured ? toColour((values[kRed + k][i] - colour[k].offset) * colour[k].factor)
                        : std::uint8_t{0};
      };
      point.r = channel(0);
      point.g = channel(1);
      point.b = channel(2);
      if (info.hasGrid()) {
        point.row = cellIndex(values[kRow][i], scan.xml.rows->min);
        point.column = cellIndex(values[kColumn][i], scan.xml.columns->min);
      }
    }
    done += count;
    if (!sink(points, static_cast<double>(done) / static_cast<double>(info.points))) return false;
  }
  return true;
}

}  // namespace

std::unique_ptr<ScanFileReader> openE57(std::shared_ptr<ByteSource> source, const ReadOptions& options) {
  return std::make_unique<E57Reader>(std::move(source), options);
}

}  // namespace hokuyo_sick_drivers
