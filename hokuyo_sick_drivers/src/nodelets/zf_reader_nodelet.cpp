// SPDX-License-Identifier: BSD-3-Clause
//
// Publishes terrestrial scans from a file (E57, PTX, PTS, ASC). A thread reads, so that the manager goes on.
#include <mapping_common/nodelet.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "hokuyo_sick_drivers/zf/scan_file.h"
#include "zf/ros/parameters.h"
#include "zf/ros/scan_message.h"

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
  void reconfigure(const ZfReaderParameters& changed);

  void run();
  [[noreturn]] void readAndPublish();
  Scan readScan(ScanFileReader& reader, std::size_t index, const std::string& frame);
  void publish(Scan& scan);
  void waitForServices();
  void waitForSubscriber();
  void waitForNext();
  void waitForLoop();
  void diagnose(StatusWrapper& status);

  ZfReaderParameters parameters_;  // rate and loop: with mutex_
  std::vector<std::string> files_;
  std::string file_;  // that the thread reads

  ros::Publisher publisher_;
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> broadcaster_;

  std::mutex mutex_;  // of all below
  std::condition_variable changed_;
  bool stop_ = false;
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
  publisher_ = getNodeHandle().advertise<sensor_msgs::PointCloud2>("cloud", 1, parameters_.latch);
  broadcaster_ = std::make_unique<tf2_ros::StaticTransformBroadcaster>();
  allowReconfiguration<ZfReaderParameters>(
      parameters_, [this](const ZfReaderParameters& changed) { reconfigure(changed); });
  startDiagnostics(parameters_.file, {{"Scan file", [this](StatusWrapper& status) { diagnose(status); }}});
  thread_ = std::thread([this] { run(); });
}

void ZfReaderNodelet::readParameters(mapping_common::Parameters& parameters) {
  parameters.read(parameters_);
  if (parameters_.file.empty())
    throw std::invalid_argument("~file is '', allowed is the path of a scan file or of a folder of them");
  parseOffset(parameters_.offset, parameters_.cloud);
  parameters_.reading.opening = [this](double done) {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.progress = done;
    return !stop_;
  };
  files_ = scanFiles(parameters_.file);
  for (const std::string& file : files_) {
    const auto source = openFile(file);
    try {
      state_.format = toString(recogniseScanFile(*source, file));
    } catch (const std::runtime_error& e) {
      throw std::runtime_error(file + ' ' + e.what());
    }
  }
}

void ZfReaderNodelet::reconfigure(const ZfReaderParameters& changed) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    mapping_common::copyDynamic(changed, parameters_);
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
  std::unique_ptr<ScanFileReader> reader;
  Scan scan;
  bool has_subscriber = false;
  waitForServices();
  while (true) {
    std::size_t before = 0;  // scans of files before this one
    for (const std::string& file : files_) {
      if (file_ != file) {
        file_ = file;
        reader = openScanFile(file, parameters_.reading);
      }
      const std::vector<std::size_t> chosen = chooseScans(*reader, parameters_.scan);
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        state_.format = toString(reader->format());
        state_.scans = reader->scans().size();
      }
      const bool several = files_.size() > 1 || chosen.size() > 1;
      if (several && !std::exchange(has_subscriber, true))
        waitForSubscriber();  // a latched publisher only keeps the last one
      for (const std::size_t index : chosen) {
        if (several || !scan.cloud) {
          const bool numbered = several && parameters_.publish_tf;
          scan = Scan();  // its memory is for the next one
          scan = readScan(*reader, index,
                          parameters_.frame_id + (numbered ? '_' + std::to_string(before + index + 1) : ""));
        }
        publish(scan);
        waitForNext();
      }
      before += reader->scans().size();
    }
    waitForLoop();
  }
}

Scan ZfReaderNodelet::readScan(ScanFileReader& reader, std::size_t index, const std::string& frame) {
  const ScanInfo& info = reader.scans()[index];
  CloudBuilder builder(info, parameters_.cloud);
  std::uint64_t points = 0;
  const ros::WallTime start = ros::WallTime::now();
  const bool whole = reader.read(index, [&](const std::vector<ScanPoint>& chunk, double done) {
    builder.add(chunk);
    points += chunk.size();
    NODELET_INFO_STREAM_THROTTLE(
        5.0, file_ << ", " << info.name << ": " << static_cast<int>(100.0 * done) << " % read");
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
  NODELET_INFO_STREAM(file_ << ", " << info.name << ": " << cloud.points << " points, " << cloud.missing
                            << " missing");
  if (!cloud.offset.isZero())
    NODELET_INFO_STREAM("Offset taken off the points: " << cloud.offset.transpose());

  Scan scan;
  std_msgs::Header header;
  header.frame_id = frame;
  scan.pose = toMessage(cloud.pose, header, parameters_.parent_frame);
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
  if (parameters_.publish_tf) broadcaster_->sendTransform(scan.pose);
  publisher_.publish(scan.cloud);
  const std::lock_guard<std::mutex> lock(mutex_);
  ++state_.published;
  state_.doing = "Published";
}

void ZfReaderNodelet::waitForServices() {
  for (const std::string& name : mapping_common::listOf(parameters_.wait_for)) {
    const std::string service = getNodeHandle().resolveName(name);
    while (!ros::service::exists(service, false)) {
      std::unique_lock<std::mutex> lock(mutex_);
      state_.doing = "Waiting for the service " + service;
      changed_.wait_for(lock, std::chrono::milliseconds(50));
      if (stop_) throw ReadStopped();
    }
  }
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
  const auto next = [&] { return start + std::chrono::duration<double>(1.0 / parameters_.rate); };
  while (!stop_ && std::chrono::steady_clock::now() < next()) {
    changed_.wait_for(lock, next() - std::chrono::steady_clock::now());
  }
  if (stop_) throw ReadStopped();
}

void ZfReaderNodelet::waitForLoop() {
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return stop_ || parameters_.loop; });
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
