// SPDX-License-Identifier: BSD-3-Clause
//
// Publishes terrestrial scans from a file (E57, PTX, PTS, ASC). A thread reads, so that the manager goes on.
#include <hokuyo_sick_drivers/ZfReaderConfig.h>
#include <mapping_common/nodelet.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <chrono>
#include <condition_variable>
#include <limits>
#include <memory>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"
#include "zf/ros/scan_message.h"
#include "zf/scan_choice.h"

namespace hokuyo_sick_drivers {
namespace {

using CloudPtr = boost::shared_ptr<sensor_msgs::PointCloud2>;

// What diagnostics tell.
struct State {
  std::string doing = "Looking through the file", error, format, scan;
  std::size_t scans = 0, published = 0;
  double progress = 0.0;                                               // of what it is doing, 0 to 1
  double points_per_second = 0.0;                                      // while reading
  std::uint64_t points = 0, missing = 0, duplicates = 0, outside = 0;  // of the scan read last
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  std::vector<std::string> warnings;
};

// A scan, ready to be published.
struct Scan {
  CloudPtr cloud;
  geometry_msgs::TransformStamped pose;
};

}  // namespace

class ZfReaderNodelet : public mapping_common::Nodelet {
 public:
  ~ZfReaderNodelet() override;

 private:
  void start(mapping_common::Parameters& parameters) override;
  void readParameters(mapping_common::Parameters& parameters);
  void reconfigure(const ZfReaderConfig& config);

  void run();
  [[noreturn]] void readAndPublish();
  Scan readScan(ScanFileReader& reader, std::size_t index, bool only_one);
  void publish(Scan& scan);
  void waitForSubscriber();
  void waitForNext();
  void waitForLoop();
  void diagnose(StatusWrapper& status);

  std::string file_, choice_, frame_id_, parent_frame_;
  bool latch_ = true, publish_tf_ = true;
  ReadOptions reading_;
  CloudOptions cloud_options_;

  ros::Publisher publisher_;
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> broadcaster_;

  std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  bool stop_ = false;
  ZfReaderConfig config_;
  State state_;

  std::thread thread_;
};

ZfReaderNodelet::~ZfReaderNodelet() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void ZfReaderNodelet::start(mapping_common::Parameters& parameters) {
  readParameters(parameters);
  publisher_ = getNodeHandle().advertise<sensor_msgs::PointCloud2>("cloud", 1, latch_);
  broadcaster_ = std::make_unique<tf2_ros::StaticTransformBroadcaster>();
  allowReconfiguration<ZfReaderConfig>(
      config_, [this](const ZfReaderConfig& config, std::uint32_t) { reconfigure(config); });
  startDiagnostics(file_, {{"Scan file", [this](StatusWrapper& status) { diagnose(status); }}});
  thread_ = std::thread([this] { run(); });
}

void ZfReaderNodelet::readParameters(mapping_common::Parameters& parameters) {
  constexpr double kMax = std::numeric_limits<double>::max();
  file_ = parameters.get<std::string>("file", "");
  choice_ = parameters.get<std::string>("scan", "1");
  frame_id_ = parameters.get<std::string>("frame_id", "scanner");
  parent_frame_ = parameters.get<std::string>("parent_frame", "map");
  publish_tf_ = parameters.get("publish_tf", true);
  latch_ = parameters.get("latch", true);
  config_.rate = parameters.get("rate", 1.0, 0.001, 100.0);
  config_.loop = parameters.get("loop", false);
  const std::string intensity = parameters.choice("intensity", "raw", {"raw", "normalised", "limits"});
  reading_.intensity = intensity == "raw"          ? IntensityScale::kRaw
                       : intensity == "normalised" ? IntensityScale::kNormalised
                                                   : IntensityScale::kLimits;
  reading_.intensity_limits.min = parameters.get("intensity_min", 0.0);
  reading_.intensity_limits.max = parameters.get("intensity_max", 1.0);
  reading_.columns = parameters.get<std::string>("columns", "");
  reading_.verify_checksums = parameters.get("verify_checksums", true);
  reading_.opening = [this](double done) {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.progress = done;
    return !stop_;
  };
  cloud_options_.voxel = parameters.get("voxel", 0.0, 0.0, kMax);
  cloud_options_.grid = parameters.get("grid", true);
  cloud_options_.apply_pose = parameters.get("apply_pose", false);
  const std::string offset = parameters.get<std::string>("offset", "auto");
  rejectUnknown(parameters);

  if (file_.empty()) mapping_common::rejectParameter("file", "\"\"", "expected the path of a scan file");
  if (frame_id_.empty()) mapping_common::rejectParameter("frame_id", "\"\"", "expected a frame");
  if (publish_tf_ && (parent_frame_.empty() || parent_frame_ == frame_id_)) {
    mapping_common::rejectParameter("parent_frame", '"' + parent_frame_ + '"',
                                    "expected a frame other than ~frame_id");
  }
  if (!(reading_.intensity_limits.min < reading_.intensity_limits.max)) {
    mapping_common::rejectParameter("intensity_max", reading_.intensity_limits.max,
                                    "expected more than ~intensity_min");
  }
  if (!parseOffset(offset, cloud_options_)) {
    mapping_common::rejectParameter("offset", '"' + offset + '"', "allowed is auto, none or \"X Y Z\"");
  }
  const auto source = openFile(file_);
  try {
    state_.format = toString(recogniseScanFile(*source, file_));
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(file_ + ' ' + e.what());
  }
}

void ZfReaderNodelet::reconfigure(const ZfReaderConfig& config) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    config_ = config;
  }
  changed_.notify_all();
}

// -----------------------------------------------------------------------------------------------------
// the thread

void ZfReaderNodelet::run() {
  std::string error;
  try {
    readAndPublish();
  } catch (const ReadStopped&) {
    return;
  } catch (const std::bad_alloc&) {
    error = file_ + " takes more memory than there is: use ~voxel";
  } catch (const std::exception& e) {
    error = e.what();
    if (error.find(file_) != 0) error = file_ + ' ' + error;
  }
  NODELET_FATAL_STREAM("Stopped reading: " << error);
  const std::lock_guard<std::mutex> lock(mutex_);
  state_.error = error;
}

void ZfReaderNodelet::readAndPublish() {
  const auto reader = openScanFile(file_, reading_);
  const std::vector<std::size_t> chosen = chooseScans(*reader, choice_);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.scans = reader->scans().size();
  }
  if (chosen.size() > 1) waitForSubscriber();  // a latched publisher only keeps the last one
  Scan scan;
  while (true) {
    for (const std::size_t index : chosen) {
      if (chosen.size() > 1 || !scan.cloud) {
        scan = Scan();  // its memory is for the next one
        scan = readScan(*reader, index, chosen.size() == 1);
      }
      publish(scan);
      waitForNext();
    }
    waitForLoop();
  }
}

Scan ZfReaderNodelet::readScan(ScanFileReader& reader, std::size_t index, bool only_one) {
  const ScanInfo& info = reader.scans()[index];
  CloudBuilder builder(info, cloud_options_);
  std::uint64_t points = 0;
  const ros::WallTime start = ros::WallTime::now();
  const bool whole = reader.read(index, [&](const std::vector<ScanPoint>& chunk, double done) {
    builder.add(chunk);
    points += chunk.size();
    NODELET_INFO_STREAM_THROTTLE(5.0, info.name << ": " << static_cast<int>(100.0 * done) << " % read");
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.doing = "Reading";
    state_.scan = info.name;
    state_.progress = done;
    state_.points_per_second =
        static_cast<double>(points) / std::max(1e-6, (ros::WallTime::now() - start).toSec());
    return !stop_;
  });
  if (!whole) throw ReadStopped();
  ScanCloud cloud = builder.finish();
  const std::vector<std::string> warnings = reader.warnings();
  for (const std::string& warning : warnings) NODELET_WARN_STREAM(file_ << ": " << warning);
  NODELET_INFO_STREAM(info.name << ": " << cloud.points << " points, " << cloud.missing << " missing");
  if (!cloud.offset.isZero())
    NODELET_INFO_STREAM("Offset taken off the points: " << cloud.offset.transpose());

  Scan scan;
  std_msgs::Header header;
  header.frame_id = frame_id_ + (only_one ? "" : '_' + std::to_string(index + 1));
  scan.pose = toMessage(cloud.pose, header, parent_frame_);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.points = cloud.points;
    state_.missing = cloud.missing;
    state_.duplicates = cloud.duplicates;
    state_.outside = cloud.outside;
    state_.offset = cloud.offset;
    state_.warnings = warnings;
  }
  scan.cloud = boost::make_shared<sensor_msgs::PointCloud2>(toMessage(std::move(cloud), header));
  return scan;
}

void ZfReaderNodelet::publish(Scan& scan) {
  if (scan.cloud.use_count() >
      1) {  // somebody has the one before, or the publisher keeps it for who comes late
    scan.cloud = boost::make_shared<sensor_msgs::PointCloud2>(*scan.cloud);
  }
  scan.cloud->header.stamp = scan.pose.header.stamp = ros::Time::now();
  if (publish_tf_) broadcaster_->sendTransform(scan.pose);
  publisher_.publish(scan.cloud);
  const std::lock_guard<std::mutex> lock(mutex_);
  ++state_.published;
  state_.doing = "Published";
}

void ZfReaderNodelet::waitForSubscriber() {
  std::unique_lock<std::mutex> lock(mutex_);
  state_.doing = "Waiting for a subscriber";
  while (!stop_ && publisher_.getNumSubscribers() == 0)
    changed_.wait_for(lock, std::chrono::milliseconds(50));
  if (stop_) throw ReadStopped();
}

void ZfReaderNodelet::waitForNext() {
  std::unique_lock<std::mutex> lock(mutex_);
  const auto start = std::chrono::steady_clock::now();
  const auto next = [&] { return start + std::chrono::duration<double>(1.0 / config_.rate); };
  while (!stop_ && std::chrono::steady_clock::now() < next()) {
    changed_.wait_for(lock, next() - std::chrono::steady_clock::now());
  }
  if (stop_) throw ReadStopped();
}

void ZfReaderNodelet::waitForLoop() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return stop_ || config_.loop; });
  if (stop_) throw ReadStopped();
}

void ZfReaderNodelet::diagnose(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!state_.error.empty()) {
    status.summary(DiagnosticStatus::ERROR, state_.error);
  } else if (!state_.warnings.empty()) {
    status.summary(DiagnosticStatus::WARN, state_.warnings.front());
  } else {
    status.summary(DiagnosticStatus::OK, state_.doing);
  }
  status.add("Format", state_.format);
  status.add("Scans in the file", state_.scans);
  status.add("Scan", state_.scan);
  status.addf("Progress (%)", "%.0f", 100.0 * state_.progress);
  status.addf("Reading (points/s)", "%.0f", state_.points_per_second);
  status.add("Published", state_.published);
  status.add("Points", state_.points);
  status.add("Points missing", state_.missing);
  status.add("Points dropped: cell taken", state_.duplicates);
  status.add("Points dropped: outside of the grid", state_.outside);
  status.addf("Offset (m)", "%.3f %.3f %.3f", state_.offset.x(), state_.offset.y(), state_.offset.z());
  status.add("Warnings", state_.warnings.size());
  for (const std::string& warning : state_.warnings) status.add("Warning", warning);
}

}  // namespace hokuyo_sick_drivers

PLUGINLIB_EXPORT_CLASS(hokuyo_sick_drivers::ZfReaderNodelet, nodelet::Nodelet)
