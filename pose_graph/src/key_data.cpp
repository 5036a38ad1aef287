// SPDX-License-Identifier: BSD-3-Clause
//
// Format 1 of scans: stamp (float64, s), origin (2 float32), then vectors (count as uint64) of points (2
// float32), reflectivities, times, free ends and free times. Of clouds: time (float64, s), origin (3
// float32), then vectors of hits (3 float32), reflectivities, misses, origins of hits and of misses. See
// mapping_common/archive.h.
#include <mapping_common/archive.h>

#include <cmath>
#include <sstream>
#include <stdexcept>

#include "pose_graph/maps.h"

namespace pose_graph {
namespace {

using mapping_common::ArchiveReader;
using mapping_common::ArchiveWriter;

constexpr std::uint32_t kFormat = 1;
constexpr std::size_t kChecksumSize = 8;

// All of a scan or cloud, in order.
template <class Archive, class Scan>
void visitScan(Archive& archive, Scan& scan) {
  archive(scan.stamp);
  archive(scan.origin);
  archive(scan.points);
  archive(scan.reflectivities);
  archive(scan.times);
  archive(scan.free);
  archive(scan.free_times);
}
template <class Archive, class Cloud>
void visitCloud(Archive& archive, Cloud& cloud) {
  archive(cloud.time);
  archive(cloud.origin);
  archive(cloud.hits);
  archive(cloud.reflectivity);
  archive(cloud.misses);
  archive(cloud.hit_origins);
  archive(cloud.miss_origins);
}

template <class Write>
KeyData encode(DataKind kind, double seconds, const Write& write) {
  std::ostringstream out;
  ArchiveWriter writer(out);
  write(writer);
  writer.finish();
  KeyData data;
  data.kind = kind;
  data.stamp = static_cast<std::int64_t>(std::llround(seconds * 1e9));
  data.format = kFormat;
  data.data = out.str();
  return data;
}

template <class Read>
void decode(const KeyData& data, DataKind kind, const Read& read) {
  const std::string what =
      mapping_common::nameOf(data.kind) + " at key pose " + std::to_string(data.key_pose);
  if (data.kind != kind) throw std::runtime_error(what + " isn't a " + mapping_common::nameOf(kind));
  if (data.format != kFormat)
    throw std::runtime_error(what + ": its format is " + std::to_string(data.format) +
                             ", this program reads " + std::to_string(kFormat));
  if (data.data.size() < kChecksumSize) throw std::runtime_error(what + " is truncated");
  ArchiveReader reader(data.data.data(), data.data.data() + data.data.size() - kChecksumSize, kFormat);
  try {
    read(reader);
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(what + " is damaged: " + e.what());
  }
}

void requireSize(std::size_t size, std::size_t expected) {
  if (size != 0 && size != expected) throw std::runtime_error("its parts don't agree in number");
}

}  // namespace

KeyData toKeyData(const intensity_hector_slam::Scan& scan) {
  return encode(DataKind::kScan, scan.stamp, [&](ArchiveWriter& writer) { visitScan(writer, scan); });
}

KeyData toKeyData(const rtree_occupancy_map::Scan& cloud) {
  return encode(DataKind::kCloud, cloud.time, [&](ArchiveWriter& writer) { visitCloud(writer, cloud); });
}

intensity_hector_slam::Scan toScan(const KeyData& data) {
  intensity_hector_slam::Scan scan;
  decode(data, DataKind::kScan, [&](ArchiveReader& reader) { visitScan(reader, scan); });
  return scan;
}

rtree_occupancy_map::Scan toCloud(const KeyData& data) {
  rtree_occupancy_map::Scan cloud;
  decode(data, DataKind::kCloud, [&](ArchiveReader& reader) {
    visitCloud(reader, cloud);
    requireSize(cloud.reflectivity.size(), cloud.hits.size());
    requireSize(cloud.hit_origins.size(), cloud.hits.size());
    requireSize(cloud.miss_origins.size(), cloud.misses.size());
  });
  return cloud;
}

}  // namespace pose_graph
