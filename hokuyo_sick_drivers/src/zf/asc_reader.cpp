// SPDX-License-Identifier: BSD-3-Clause
//
// ASC, XYZ: lines of numbers whose meaning is a matter of the export's settings.
#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "columns.h"
#include "point_text.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kSampleLines = 100;
constexpr std::size_t kMaxColumns = Columns::kMost;

// A text may have a decimal comma: then there is no point, and commas are only found between digits.
bool hasDecimalComma(const std::vector<std::string>& lines) {
  const auto is_digit = [](const std::string& line, std::size_t i) {
    return i < line.size() && line[i] >= '0' && line[i] <= '9';
  };
  bool comma = false;
  for (std::string line : lines) {
    double values[kMaxColumns];
    const std::size_t count = parseNumbers(line, values, kMaxColumns);
    if (count == kNotNumbers || count == 1) continue;  // a header
    if (line.find('.') != line.npos) return false;
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (line[i] != ',') continue;
      if (!is_digit(line, i - 1) || !is_digit(line, i + 1)) return false;
      line[i] = '.';
      comma = true;
    }
    const std::size_t with_decimals = parseNumbers(line, values, kMaxColumns);
    if (with_decimals == kNotNumbers || with_decimals < 3) return false;
  }
  return comma;
}

class AscReader : public ScanFileReader {
 public:
  AscReader(std::shared_ptr<ByteSource> source, const ReadOptions& options)
      : source_(std::move(source)), options_(options) {
    findColumns();
    lookThrough();
  }

  ScanFormat format() const override { return ScanFormat::kAsc; }
  bool read(std::size_t scan, const PointSink& sink) override;
  std::vector<std::string> warnings() const override {
    std::vector<std::string> all = warnings_;
    if (skipped_ > 0) all.push_back(plural(skipped_, "line") + " that held no point skipped");
    return all;
  }

 private:
  void findColumns();
  void lookThrough();
  bool parse(std::string_view line, std::array<double, kMaxColumns>& values);

  std::shared_ptr<ByteSource> source_;
  ReadOptions options_;
  std::optional<Columns> columns_;
  bool decimal_comma_ = false;
  std::string line_;  // with points for commas
  std::uint64_t skipped_ = 0;
};

void AscReader::findColumns() {
  LineReader lines(*source_);
  std::vector<std::string> sample;
  std::string_view line;
  while (sample.size() < kSampleLines && lines.next(line)) sample.emplace_back(line);
  decimal_comma_ = hasDecimalComma(sample);
  if (!options_.columns.empty()) {
    columns_.emplace(options_.columns);
    return;
  }
  std::map<std::size_t, std::size_t> counts;  // of numbers in a line -> of such lines
  std::optional<Columns> named;
  for (std::string& text : sample) {
    if (counts.empty() && !named) named = Columns::named(text);
    if (decimal_comma_) std::replace(text.begin(), text.end(), ',', '.');
    double values[kMaxColumns];
    const std::size_t count = parseNumbers(text, values, kMaxColumns);
    if (count != kNotNumbers && count >= 3) ++counts[count];
  }
  if (counts.empty()) throw std::runtime_error("has no line of numbers among its first 100");
  const auto usual = std::max_element(counts.begin(), counts.end(),
                                      [](const auto& a, const auto& b) { return a.second < b.second; });
  columns_ = named && named->count() == usual->first ? named : Columns::usual(usual->first);
  if (!columns_) {
    throw std::runtime_error("has " + std::to_string(usual->first) +
                             " columns, which can't be guessed: tell them, e.g. \"x y z i _\"");
  }
}

// For the number of lines and the scale of intensities.
void AscReader::lookThrough() {
  ScanInfo info;
  info.name = "scan 1";
  info.has_intensity = columns_->hasIntensity();
  info.has_colour = columns_->hasColour();
  LineReader lines(*source_);
  OpeningProgress progress(options_, lines);
  IntensityGuess guess;
  std::string_view line;
  while (lines.next(line)) {
    progress.lineRead();
    std::array<double, kMaxColumns> values;
    if (info.has_intensity && info.points < kIntensitySample && parse(line, values)) {
      guess.add(columns_->intensity(values.data()));
    }
    ++info.points;
  }
  info.intensity_limits = guess.limits();
  scans_.push_back(info);
}

bool AscReader::parse(std::string_view line, std::array<double, kMaxColumns>& values) {
  if (decimal_comma_) {
    line_.assign(line);
    std::replace(line_.begin(), line_.end(), ',', '.');
    line = line_;
  }
  return parseNumbers(line, values.data(), columns_->count()) == columns_->count();
}

bool AscReader::read(std::size_t index, const PointSink& sink) {
  const ScanInfo& info = scans_.at(index);
  const IntensityMap intensity(options_, info.intensity_limits);
  LineReader lines(*source_);
  ChunkWriter out(sink);
  const auto progress = [&] { return lines.progress(); };
  skipped_ = 0;
  std::string_view line;
  std::array<double, kMaxColumns> values;
  while (lines.next(line)) {
    if (!parse(line, values)) {
      ++skipped_;
      continue;
    }
    ScanPoint point;
    columns_->read(values.data(), intensity, point);
    if (!out.add(point, progress)) return false;
  }
  return out.flush(1.0);
}

}  // namespace

std::unique_ptr<ScanFileReader> openAsc(std::shared_ptr<ByteSource> source, const ReadOptions& options) {
  return std::make_unique<AscReader>(std::move(source), options);
}

}  // namespace hokuyo_sick_drivers
