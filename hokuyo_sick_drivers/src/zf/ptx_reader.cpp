// SPDX-License-Identifier: BSD-3-Clause
//
// PTX: per scan a header of ten lines (columns, rows, scanner position and axes, 4 x 4 matrix for row
// vectors, whose last row is the translation), then a line per cell of the grid, column after column. Some
// programs write the matrix for column vectors, with the translation in its last column.
#include <Eigen/Geometry>
#include <cmath>

#include "point_text.h"

namespace hokuyo_sick_drivers {
namespace {

// Of a matrix written with six decimals.
constexpr double kRotationTolerance = 1e-5;
// "0 0 0 0" and its end of line: no cell takes less.
constexpr std::uint64_t kShortestLine = 6;

struct PtxScan {
  LineReader::Position start;  // of the points
  std::uint64_t points = 0;
  bool scaled = false;
  Eigen::Matrix3d scale = Eigen::Matrix3d::Identity();  // what of the matrix is no rotation
};

class PtxReader : public ScanFileReader {
 public:
  PtxReader(std::shared_ptr<ByteSource> source, const ReadOptions& options)
      : source_(std::move(source)), options_(options) {
    LineReader lines(*source_);
    std::string_view line;
    while (lines.next(line)) readHeaderAndSkipPoints(line, lines);
    if (scans_.empty()) throw std::runtime_error("is an empty PTX file");
  }

  ScanFormat format() const override { return ScanFormat::kPtx; }
  bool read(std::size_t scan, const PointSink& sink) override;

 private:
  void readHeaderAndSkipPoints(std::string_view line, LineReader& lines);
  void readMatrix(LineReader& lines, ScanInfo& info, PtxScan& scan);

  std::shared_ptr<ByteSource> source_;
  ReadOptions options_;
  std::vector<PtxScan> starts_;
};

// Nothing was measured: such lines may lack numbers.
bool isMissing(const double* numbers, std::size_t count) {
  return count != kNotNumbers && count >= 3 && numbers[0] == 0.0 && numbers[1] == 0.0 && numbers[2] == 0.0;
}

std::uint32_t readCount(std::string_view line, const LineReader& lines, const std::string& name) {
  const auto count = asCount(line);
  if (!count || *count > std::numeric_limits<std::uint32_t>::max()) {
    lines.fail("is \"" + std::string(line.substr(0, 40)) + "\", expected the number of " + name +
               " of a PTX scan");
  }
  return static_cast<std::uint32_t>(*count);
}

std::string_view nextLine(LineReader& lines, const std::string& what) {
  std::string_view line;
  if (!lines.next(line)) lines.fail("is missing: the file ends before the " + what + " of a PTX scan");
  return line;
}

void PtxReader::readHeaderAndSkipPoints(std::string_view line, LineReader& lines) {
  ScanInfo info;
  PtxScan scan;
  info.columns = readCount(line, lines, "columns");
  info.rows = readCount(nextLine(lines, "number of rows"), lines, "rows");
  const std::uint64_t cells = std::uint64_t{info.rows} * info.columns;
  if (cells > 0 && cells > source_->size() / kShortestLine + 1) {
    lines.fail("announces " + std::to_string(info.columns) + " x " + std::to_string(info.rows) +
               " points, which the file is too short to hold");
  }
  info.points = scan.points = cells;
  info.name = "scan " + std::to_string(scans_.size() + 1);
  info.has_pose = info.has_intensity = true;
  info.intensity_limits = Limits{0.0, 1.0};
  for (int i = 0; i < 4; ++i) {
    double numbers[4];
    if (parseNumbers(nextLine(lines, "position and axes"), numbers, 4) != 3)
      lines.fail("has to be 3 numbers");
  }
  readMatrix(lines, info, scan);

  OpeningProgress progress(options_, lines);
  bool measured = false;
  for (std::uint64_t i = 0; i < scan.points; ++i) {
    if (!lines.next(line)) {
      lines.fail("is missing: the file ends after " + std::to_string(i) + " of " +
                 std::to_string(scan.points) + " points of " + info.name);
    }
    if (i == 0) scan.start = lines.position();
    if (!measured) {  // some exporters write missing points without their colour
      double v[11];
      const std::size_t count = parseNumbers(line, v, 11);
      measured = !isMissing(v, count);
      if (measured && count != 4 && count != 7 && count != 10) lines.fail("has to be 4, 7 or 10 numbers");
      info.has_colour = count == 7 || count == 10;
    }
    progress.lineRead();
  }
  scans_.push_back(info);
  starts_.push_back(scan);
}

void PtxReader::readMatrix(LineReader& lines, ScanInfo& info, PtxScan& scan) {
  Eigen::Matrix4d matrix;  // for column vectors: the transpose of the file's
  bool finite = true;
  for (int i = 0; i < 4; ++i) {
    double numbers[5];
    if (parseNumbers(nextLine(lines, "matrix"), numbers, 5) != 4) lines.fail("has to be 4 numbers");
    for (int k = 0; k < 4; ++k) {
      matrix(k, i) = numbers[k];
      finite = finite && std::abs(numbers[k]) < 1e12;
    }
  }
  const std::string where = "line " + std::to_string(lines.position().line) + ": the matrix of " + info.name;
  const bool translates_below = !matrix.topRightCorner<3, 1>().isZero(0.0),
             translates_beside = !matrix.bottomLeftCorner<1, 3>().isZero(0.0);
  if (translates_below && translates_beside) {
    throw std::runtime_error(where +
                             " has a last row and a last column, and may have one of them: it is no pose");
  }
  if (translates_beside) {
    matrix.transposeInPlace();
    warnings_.push_back(where + " has its translation in the last column and is read for column vectors");
  }
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  if (!finite || !(std::abs(linear.determinant()) > 1e-9)) {
    warnings_.push_back(where + " can't be inverted, so its points are left without a pose");
    info.has_pose = false;
    return;
  }
  Eigen::Affine3d transform(matrix);
  Eigen::Matrix3d rotation, scale;
  transform.computeRotationScaling(&rotation, &scale);
  info.pose.linear() = Eigen::Quaterniond(rotation).normalized().toRotationMatrix();
  info.pose.translation() = matrix.topRightCorner<3, 1>();
  if ((scale - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > kRotationTolerance) {
    scan.scaled = true;
    scan.scale = scale;
    warnings_.push_back(where + " isn't only a rotation; its scale is applied to the points");
  }
}

bool PtxReader::read(std::size_t index, const PointSink& sink) {
  const ScanInfo& info = scans_.at(index);
  const PtxScan& scan = starts_.at(index);
  LineReader lines(*source_, scan.start);
  const IntensityMap intensity(options_, info.intensity_limits);
  ChunkWriter out(sink);
  if (scan.points == 0) return out.flush(1.0);
  std::uint64_t done = 0;
  const auto progress = [&] { return static_cast<double>(done) / static_cast<double>(scan.points); };

  std::string_view line;
  ScanPoint point;
  for (point.column = 0; point.column < info.columns; ++point.column) {
    for (point.row = 0; point.row < info.rows; ++point.row, ++done) {
      if (!lines.next(line)) lines.fail("is missing: the file was cut while it was read");
      double v[7];
      const std::size_t count = parseNumbers(line, v, 7);
      const bool missing = isMissing(v, count);
      if (count == kNotNumbers || (count < 4 && !missing))
        lines.fail("isn't a point of a PTX file (x y z intensity)");
      if (count < 4) v[3] = 0.0;
      Eigen::Vector3d position(v[0], v[1], v[2]);
      if (scan.scaled) position = scan.scale * position;
      point.x = position.x();
      point.y = position.y();
      point.z = position.z();
      point.valid = !missing && position.allFinite();
      point.intensity = intensity(v[3]);
      const bool colour = info.has_colour && count == 7;
      point.r = colour ? toColour(v[4]) : 0;
      point.g = colour ? toColour(v[5]) : 0;
      point.b = colour ? toColour(v[6]) : 0;
      if (!out.add(point, progress)) return false;
    }
  }
  return out.flush(1.0);
}

}  // namespace

std::unique_ptr<ScanFileReader> openPtx(std::shared_ptr<ByteSource> source, const ReadOptions& options) {
  return std::make_unique<PtxReader>(std::move(source), options);
}

}  // namespace hokuyo_sick_drivers
