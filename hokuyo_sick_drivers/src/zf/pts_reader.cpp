// SPDX-License-Identifier: BSD-3-Clause
//
// PTS: the number of points, then a line for each; maybe another number and its points, which is a scan of
// its own. CloudCompare writes the columns' names above the number, others leave the number out.
#include <optional>

#include "columns.h"
#include "point_text.h"

namespace hokuyo_sick_drivers {
namespace {

struct PtsScan {
  LineReader::Position start;  // of the points
  std::uint64_t points = 0;
  std::optional<Columns> columns;  // none: no points
};

class PtsReader : public ScanFileReader {
 public:
  PtsReader(std::shared_ptr<ByteSource> source, const ReadOptions& options)
      : source_(std::move(source)), options_(options) {
    if (!options_.columns.empty()) told_.emplace(options_.columns);
    LineReader lines(*source_);
    std::string_view line;
    if (!skipHeader(line, lines)) throw std::runtime_error("is a PTS file without points");
    while (readCountAndSkipPoints(line, lines)) {
    }
  }

  ScanFormat format() const override { return ScanFormat::kPts; }
  bool read(std::size_t scan, const PointSink& sink) override;

 private:
  bool skipHeader(std::string_view& line, LineReader& lines);
  bool readCountAndSkipPoints(std::string_view& line, LineReader& lines);
  Columns columnsOf(std::size_t count, const LineReader& lines) const;

  std::shared_ptr<ByteSource> source_;
  ReadOptions options_;
  std::optional<Columns> told_, named_;  // by the options, by the header
  std::vector<PtsScan> starts_;
};

std::size_t countNumbers(std::string_view line) {
  double values[Columns::kMost];
  return parseNumbers(line, values, Columns::kMost);
}

// Leaves the first count or point in `line`. Returns false at the end of the file.
bool PtsReader::skipHeader(std::string_view& line, LineReader& lines) {
  while (lines.next(line)) {
    if (asCount(line) || countNumbers(line) != kNotNumbers) return true;
    const auto columns = Columns::named(line);
    const bool is_comment = line[0] == '#' || line.substr(0, 2) == "//";
    if (columns) {
      named_ = columns;
    } else if (!is_comment) {
      lines.fail("is \"" + std::string(line.substr(0, 40)) +
                 "\", expected the number of points of a PTS file, or a point");
    }
  }
  return false;
}

Columns PtsReader::columnsOf(std::size_t count, const LineReader& lines) const {
  if (count == kNotNumbers) lines.fail("has to be the numbers of a point");
  if (told_ && count >= told_->count()) return *told_;
  if (told_)
    lines.fail("has fewer numbers than the " + std::to_string(told_->count()) + " columns that were told");
  if (named_ && named_->count() == count) return *named_;
  const auto usual = Columns::usual(count);
  if (!usual || count > 7) {
    lines.fail("has " + std::to_string(count) +
               " numbers; 3, 4, 6 and 7 have a meaning in a PTS file, for others tell the columns, e.g. "
               "\"x y z _ i\"");
  }
  return *usual;
}

// Leaves the next count in `line`. Returns false at the end of the file.
bool PtsReader::readCountAndSkipPoints(std::string_view& line, LineReader& lines) {
  const auto announced = asCount(line);
  ScanInfo info;
  PtsScan scan;
  info.name = "scan " + std::to_string(scans_.size() + 1);
  OpeningProgress progress(options_, lines);
  IntensityGuess guess;
  std::uint64_t surplus = 0;
  bool more = announced ? lines.next(line) : true;
  for (; more; more = lines.next(line)) {
    progress.lineRead();
    if (line.size() < 20 && asCount(line)) break;
    if (announced && scan.points == *announced) {
      ++surplus;
      continue;
    }
    if (scan.points < kIntensitySample) {
      double values[Columns::kMost];
      const std::size_t count = parseNumbers(line, values, Columns::kMost);
      if (scan.points == 0) {
        scan.columns = columnsOf(count, lines);
        scan.start = lines.position();
      }
      if (scan.columns->hasIntensity() && count != kNotNumbers && count >= scan.columns->count())
        guess.add(scan.columns->intensity(values));
    }
    ++scan.points;
  }
  if (!announced) warnings_.emplace_back("the number of points isn't told; all lines are taken");
  if (surplus > 0) {
    warnings_.push_back(plural(surplus, "line") + " after the " + plural(*announced, "point") + " that " +
                        info.name + " announces " + (surplus == 1 ? "is" : "are") + " left out");
  }
  if (announced && scan.points < *announced) {
    warnings_.push_back(info.name + " announces " + plural(*announced, "point") + " but ends after " +
                        std::to_string(scan.points) + ", at line " + std::to_string(lines.position().line));
  }
  info.points = scan.points;
  info.has_intensity = scan.columns && scan.columns->hasIntensity();
  info.has_colour = scan.columns && scan.columns->hasColour();
  info.intensity_limits = guess.limits();
  scans_.push_back(info);
  starts_.push_back(scan);
  return more;
}

bool PtsReader::read(std::size_t index, const PointSink& sink) {
  const ScanInfo& info = scans_.at(index);
  const PtsScan& scan = starts_.at(index);
  const IntensityMap intensity(options_, info.intensity_limits);
  ChunkWriter out(sink);
  if (scan.points == 0) return out.flush(1.0);
  const Columns& columns = *scan.columns;
  LineReader lines(*source_, scan.start);
  std::uint64_t done = 0;
  const auto progress = [&] { return static_cast<double>(done) / static_cast<double>(scan.points); };

  std::string_view line;
  ScanPoint point;
  double values[Columns::kMost];
  for (; done < scan.points; ++done) {
    if (!lines.next(line)) lines.fail("is missing: the file was cut while it was read");
    if (parseNumbers(line, values, columns.count()) != columns.count()) {
      lines.fail("isn't a point of " + std::to_string(columns.count()) + " numbers as those before");
    }
    columns.read(values, intensity, point);
    if (!out.add(point, progress)) return false;
  }
  return out.flush(1.0);
}

}  // namespace

std::unique_ptr<ScanFileReader> openPts(std::shared_ptr<ByteSource> source, const ReadOptions& options) {
  return std::make_unique<PtsReader>(std::move(source), options);
}

}  // namespace hokuyo_sick_drivers
