// SPDX-License-Identifier: BSD-3-Clause
#include <hokuyo_sick_drivers/zf/scan_choice.h>
#include <hokuyo_sick_drivers/zf/scan_cloud.h>
#include <hokuyo_sick_drivers/zf/scan_file.h>
#include <rosbag_tests/converters/terrestrial_scans.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <set>
#include <stdexcept>

#include "file_utils.h"

namespace rosbag_tests {
namespace {

using namespace hokuyo_sick_drivers;

void copyCloud(const ScanCloud& from, pcl::PointCloud<pcl::PointXYZI>& cloud) {
  const std::size_t step = from.pointStep();
  cloud.clear();
  cloud.resize(from.data.size() / step);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    float values[4] = {};
    std::memcpy(values, &from.data[i * step], from.has_intensity ? sizeof(values) : 3 * sizeof(float));
    cloud[i].getVector3fMap() << values[0], values[1], values[2];
    cloud[i].intensity = values[3];
  }
}

class TerrestrialScans : public ScanSource {
 public:
  TerrestrialScans(const std::vector<std::string>& paths, double voxel) {
    options_.voxel = voxel;
    options_.grid = false;
    std::set<std::string> files;
    for (const std::string& path : paths) {
      if (!std::filesystem::exists(path)) fail(path, "no such file or folder");
      for (const std::string& file : scanFiles(std::filesystem::canonical(path).string())) files.insert(file);
    }
    for (const std::string& file : files) {
      std::size_t scans = 1;
      std::string error;
      try {
        scans = openScanFile(file)->scans().size();
        if (scans == 0) error = file + ": holds no scan";
      } catch (const std::runtime_error& e) {
        error = e.what();
      }
      for (std::size_t i = 0; i < std::max<std::size_t>(1, scans); ++i) entries_.push_back({file, error, i});
    }
  }

  std::size_t size() const override { return entries_.size(); }

  bool next(mapping_simulation::PosedScan& scan) override {
    if (next_ == entries_.size()) return false;
    const Entry& entry = entries_[next_++];
    scan.name = entry.file;
    scan.stamp = static_cast<double>(next_ - 1);
    if (!entry.error.empty()) throw std::runtime_error(entry.error);
    if (file_ != entry.file) {
      file_.clear();
      reader_ = openScanFile(entry.file);
      file_ = entry.file;
    }
    const ScanInfo& info = reader_->scans().at(entry.scan);
    if (reader_->scans().size() > 1) scan.name += ", " + info.name;
    CloudBuilder builder(info, options_);
    reader_->read(entry.scan, [&](const std::vector<ScanPoint>& points, double) {
      builder.add(points);
      return true;
    });
    const ScanCloud cloud = builder.finish();
    scan.pose = cloud.pose;
    copyCloud(cloud, scan.cloud);
    return true;
  }

  void rewind() override { next_ = 0; }

 private:
  struct Entry {
    std::string file, error;
    std::size_t scan;
  };
  CloudOptions options_;
  std::vector<Entry> entries_;
  std::size_t next_ = 0;
  std::unique_ptr<ScanFileReader> reader_;
  std::string file_;  // that it reads
};

}  // namespace

std::unique_ptr<ScanSource> openTerrestrialScans(const std::vector<std::string>& paths, double voxel) {
  return std::make_unique<TerrestrialScans>(paths, voxel);
}

}  // namespace rosbag_tests
