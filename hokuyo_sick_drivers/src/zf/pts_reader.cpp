// SPDX-License-Identifier: BSD-3-Clause
//
// PTS: the number of points, then a line for each; maybe another number and its points, which is a scan of
// its own.
#include <cmath>

#include "point_text.h"

namespace hokuyo_sick_drivers {
namespace {

// x y z, intensity, colour
struct PtsLayout {
  std::size_t fields = 0;
  bool intensity() const { return fields == 4 || fields == 7; }
  bool colour() const { return fields >= 6; }
};

struct PtsScan {
  LineReader::Position start;  // of the points
  std::uint64_t points = 0;
  PtsLayout layout;
};

class PtsReader : public ScanFileReader {
 public:
  PtsReader(std::shared_ptr<ByteSource> source, const ReadOptions& options)
      : source_(std::move(source)), options_(options) {
    LineReader lines(*source_);
    std::string_view line;
    bool more = lines.next(line);
    if (!more) throw std::runtime_error("is an empty PTS file");
    while (more) more = readCountAndSkipPoints(line, lines);
  }

  ScanFormat format() const override { return ScanFormat::kPts; }
  bool read(std::size_t scan, const PointSink& sink) override;

 private:
  bool readCountAndSkipPoints(std::string_view& line, LineReader& lines);

  std::shared_ptr<ByteSource> source_;
  ReadOptions options_;
  std::vector<PtsScan> starts_;
};

// Leaves the next count in `line`. Returns false at the end of the file.
bool PtsReader::readCountAndSkipPoints(std::string_view& line, LineReader& lines) {
  const auto announced = asCount(line);
  if (!announced) lines.fail("has to be the number of points of a PTS file");
  ScanInfo info;
  PtsScan scan;
  info.name = "scan " + std::to_string(scans_.size() + 1);
  OpeningProgress progress(options_, lines);
  IntensityGuess guess;
  std::uint64_t surplus = 0;
  bool more = false;
  while ((more = lines.next(line))) {
    progress.lineRead();
    if (line.size() < 20 && asCount(line)) break;
    if (scan.points == *announced) {
      ++surplus;
      continue;
    }
    if (scan.points < kIntensitySample) {
      double v[8];
      const std::size_t count = parseNumbers(line, v, 8);
      if (scan.points == 0) {
        if (count != 3 && count != 4 && count != 6 && count != 7)
          lines.fail("has to be 3, 4, 6 or 7 numbers");
        scan.start = lines.position();
        scan.layout.fields = count;
      }
      if (scan.layout.intensity() && count != kNotNumbers && count >= 4) guess.add(v[3]);
    }
    ++scan.points;
  }
  if (surplus > 0) {
    warnings_.push_back(plural(surplus, "line") + " after the " + plural(*announced, "point") + " that " +
                        info.name + " announces " + (surplus == 1 ? "is" : "are") + " left out");
  }
  if (scan.points < *announced) {
    warnings_.push_back(info.name + " announces " + plural(*announced, "point") + " but ends after " +
                        std::to_string(scan.points) + ", at line " + std::to_string(lines.position().line));
  }
  info.points = scan.points;
  info.has_intensity = scan.layout.intensity();
  info.has_colour = scan.layout.colour();
  info.intensity_limits = guess.limits();
  scans_.push_back(info);
  starts_.push_back(scan);
  return more;
}

bool PtsReader::read(std::size_t index, const PointSink& sink) {
  const ScanInfo& info = scans_.at(index);
  const PtsScan& scan = starts_.at(index);
  const IntensityMap intensity(options_, info.intensity_limits);
  const std::size_t fields = scan.layout.fields;
  ChunkWriter out(sink);
  if (scan.points == 0) return out.flush(1.0);
  LineReader lines(*source_, scan.start);
  std::uint64_t done = 0;
  const auto progress = [&] { return static_cast<double>(done) / static_cast<double>(scan.points); };

  std::string_view line;
  ScanPoint point;
  for (; done < scan.points; ++done) {
    if (!lines.next(line)) lines.fail("is missing: the file was cut while it was read");
    double v[7];
    if (parseNumbers(line, v, fields) != fields) {
      lines.fail("isn't a point of " + std::to_string(fields) + " numbers as those before");
    }
    point.x = v[0];
    point.y = v[1];
    point.z = v[2];
    point.valid = std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
    if (info.has_intensity) point.intensity = intensity(v[3]);
    if (info.has_colour) {
      point.r = toColour(v[fields - 3]);
      point.g = toColour(v[fields - 2]);
      point.b = toColour(v[fields - 1]);
    }
    if (!out.add(point, progress)) return false;
  }
  return out.flush(1.0);
}

}  // namespace

std::unique_ptr<ScanFileReader> openPts(std::shared_ptr<ByteSource> source, const ReadOptions& options) {
  return std::make_unique<PtsReader>(std::move(source), options);
}

}  // namespace hokuyo_sick_drivers
