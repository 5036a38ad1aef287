// SPDX-License-Identifier: BSD-3-Clause
//
// Turns the intensities of scans and clouds into reflectivities, message by message. Everything happens in
// the nodelet's single-threaded callback queue, so that nothing here needs a lock; nothing depends on time.
#include <mapping_common/arrivals.h>
#include <mapping_common/nodelet.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <string>

#include "laser_intensity_calib/ros/conversions.h"
#include "laser_intensity_calib/ros/parameters.h"

namespace laser_intensity_calib {

using mapping_common::Arrivals;

class ReflectivityNodelet : public mapping_common::Nodelet {
 public:
  ~ReflectivityNodelet() override { endCallbacks(); }

 private:
  void start(mapping_common::Parameters& reader) override;

  void scanArrived(const sensor_msgs::LaserScan::ConstPtr& scan);
  void cloudArrived(const sensor_msgs::PointCloud2::ConstPtr& cloud);
  template <class Work>
  void process(std::size_t& received, const Work& work);

  void use(const std::string& file, ModelType model);
  void reload(std_srvs::Trigger::Response& response);
  void reconfigure(const ReflectivityParameters& changed);
  void report() override;
  void diagnose(StatusWrapper& status);

  ReflectivityParameters parameters_;
  Calibration calibration_;
  ScanIncidence scan_incidence_;

  ros::Subscriber scans_, clouds_;
  ros::Publisher scan_publisher_, cloud_publisher_;

  ReflectivityCounts counts_;
  std::unique_ptr<mapping_common::Drops> drops_;
  // Since the last diagnostics.
  std::size_t received_scans_ = 0, received_clouds_ = 0, processed_ = 0, valid_before_ = 0;
  double time_ = 0.0, longest_ = 0.0;  // s
};

void ReflectivityNodelet::start(mapping_common::Parameters& reader) {
  ros::NodeHandle& node = getNodeHandle();
  reader.read(parameters_);
  drops_ = std::make_unique<mapping_common::Drops>(
      mapping_common::Drops::Options{getName(), "Dropped a message", "Dropped", {Arrivals::kMalformed}});
  scan_incidence_ = ScanIncidence(parameters_.scan);
  use(parameters_.calibration_file, parameters_.model);

  allowReconfiguration<ReflectivityParameters>(
      parameters_, [this](const ReflectivityParameters& changed) { reconfigure(changed); });

  scan_publisher_ = node.advertise<sensor_msgs::LaserScan>("scan_reflectivity", parameters_.queue_size);
  cloud_publisher_ = node.advertise<sensor_msgs::PointCloud2>("cloud_reflectivity", parameters_.queue_size);
  scans_ = node.subscribe("scan", parameters_.queue_size, &ReflectivityNodelet::scanArrived, this);
  clouds_ = node.subscribe("cloud", parameters_.queue_size, &ReflectivityNodelet::cloudArrived, this);
  serve<std_srvs::Trigger>(getPrivateNodeHandle(), "reload",
                           [this](auto&, auto& response) { reload(response); });

  startDiagnostics(calibration_.scanner.empty() ? "none" : calibration_.scanner,
                   {{"Reflectivity", [this](StatusWrapper& status) { diagnose(status); }}});
}

// State changes only after the file was read and fits.
void ReflectivityNodelet::use(const std::string& file, ModelType model) {
  calibration_ = loadFor(model, file);
  parameters_.calibration_file = file;
  parameters_.model = model;
  NODELET_INFO_STREAM("Model " << toString(model) << (file.empty() ? ", uncalibrated" : " of " + file)
                               << (file.empty() ? ""
                                                : ": scanner " + calibration_.scanner + ", reference " +
                                                      calibration_.reference));
}

template <class Work>
void ReflectivityNodelet::process(std::size_t& received, const Work& work) {
  ++received;
  const ros::WallTime start = ros::WallTime::now();
  try {
    work();
  } catch (const std::invalid_argument& e) {
    return drops_->add(Arrivals::kMalformed, e.what());
  }
  const double time = (ros::WallTime::now() - start).toSec();
  ++processed_;
  time_ += time;
  longest_ = std::max(longest_, time);
}

void ReflectivityNodelet::scanArrived(const sensor_msgs::LaserScan::ConstPtr& scan) {
  process(received_scans_, [&] {
    if (scan->ranges.empty()) throw std::invalid_argument("it is empty");
    const ScanArrays arrays = readScan(*scan);
    const Eigen::ArrayXf intensities = withoutOffsets(calibration_, arrays.intensities, Eigen::ArrayXi());
    const Eigen::ArrayXf& incidence =
        scan_incidence_.estimate(arrays.ranges, scan->angle_min, scan->angle_increment);
    const Eigen::ArrayXf result = reflectivity(calibration_, parameters_.model, parameters_.outside,
                                               arrays.ranges, incidence, intensities, &counts_);
    const auto message = boost::make_shared<sensor_msgs::LaserScan>(*scan);
    message->intensities.assign(result.data(), result.data() + result.size());
    scan_publisher_.publish(message);
  });
}

void ReflectivityNodelet::cloudArrived(const sensor_msgs::PointCloud2::ConstPtr& cloud) {
  process(received_clouds_, [&] {
    if (cloud->width == 0 || cloud->height == 0) throw std::invalid_argument("it is empty");
    if (cloud_publisher_.getNumSubscribers() == 0) return;  // normals of clouds take their time
    const CloudArrays arrays = readCloud(*cloud);
    const Eigen::ArrayXf ranges = cloudRanges(arrays.points, arrays.viewpoints);
    const Eigen::ArrayXf intensities = withoutOffsets(calibration_, arrays.intensities, arrays.lasers);
    Eigen::ArrayXf incidence;
    if (parameters_.model == ModelType::kLut) {
      incidence = cloudIncidence(arrays.points, arrays.viewpoints, parameters_.cloud, arrays.width);
    }
    cloud_publisher_.publish(boost::make_shared<sensor_msgs::PointCloud2>(
        withReflectivity(*cloud, reflectivity(calibration_, parameters_.model, parameters_.outside, ranges,
                                              incidence, intensities, &counts_))));
  });
}

void ReflectivityNodelet::reload(std_srvs::Trigger::Response& response) {
  try {
    use(parameters_.calibration_file, parameters_.model);
    response.success = true;
    response.message = parameters_.calibration_file.empty() ? "There is no calibration file to read"
                                                            : "Read " + parameters_.calibration_file;
  } catch (const std::exception& e) {
    response.message = std::string(e.what()) + ". The calibration stays as it was";
  }
}

void ReflectivityNodelet::reconfigure(const ReflectivityParameters& changed) {
  if (changed.calibration_file != parameters_.calibration_file || changed.model != parameters_.model) {
    use(changed.calibration_file, changed.model);
  }
  parameters_.outside = changed.outside;
}

void ReflectivityNodelet::report() {
  Nodelet::report();
  drops_->endReport();
  received_scans_ = received_clouds_ = processed_ = 0;
  valid_before_ = counts_.valid;
  time_ = longest_ = 0.0;
}

void ReflectivityNodelet::diagnose(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const double seconds = reportedTime();
  if (drops_->recent() > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu messages dropped", drops_->recent());
  } else if (processed_ > 0 && counts_.valid == valid_before_ &&
             (received_scans_ > 0 || cloud_publisher_.getNumSubscribers() > 0)) {
    status.summary(DiagnosticStatus::WARN, "No beam has a reflectivity");
  } else {
    status.summary(DiagnosticStatus::OK, processed_ > 0 ? "Running" : "No input");
  }
  status.add("Model", toString(parameters_.model));
  status.add("Calibration file", parameters_.calibration_file);
  status.add("Calibration date", calibration_.date);
  status.add("Reference surface", calibration_.reference);
  status.addf("Scans (Hz)", "%.1f", static_cast<double>(received_scans_) / seconds);
  status.addf("Clouds (Hz)", "%.1f", static_cast<double>(received_clouds_) / seconds);
  drops_->addTo(status);
  status.add("Beams with reflectivity", counts_.valid);
  status.add("Beams without return", counts_.no_return);
  status.add("Beams without valid intensity", counts_.bad_intensity);
  status.add("Beams without angle of incidence", counts_.no_incidence);
  status.add(parameters_.outside == OutsidePolicy::kDrop ? "Beams dropped: outside of the calibration"
                                                         : "Beams clamped: outside of the calibration",
             counts_.outside);
  status.addf("Processing, mean (ms)", "%.3f", processed_ > 0 ? 1e3 * time_ / processed_ : 0.0);
  status.addf("Processing, longest (ms)", "%.3f", 1e3 * longest_);
}

}  // namespace laser_intensity_calib

PLUGINLIB_EXPORT_CLASS(laser_intensity_calib::ReflectivityNodelet, nodelet::Nodelet)
