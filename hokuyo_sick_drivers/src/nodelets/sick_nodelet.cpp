// SPDX-License-Identifier: BSD-3-Clause
//
// Publishes the scans of a SICK LMS 2xx.
#include <diagnostic_updater/publisher.h>
#include <sensor_msgs/LaserScan.h>

#include <array>
#include <cmath>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <string>

#include "device_nodelet.h"
#include "sick_parameters.h"

namespace hokuyo_sick_drivers {
class SickNodelet : public DeviceNodelet {
 public:
  ~SickNodelet() override { disconnect(); }

 private:
  void start(mapping_common::Parameters& parameters) override;

  void publish(const lms::Scan& scan);
  void reportHere() override;
  void diagnose(StatusWrapper& status);

  SickParameters parameters_;
  std::unique_ptr<Lms2xx> lms_;
  ros::Publisher publisher_;

  std::unique_ptr<diagnostic_updater::TopicDiagnostic> scan_diagnostic_;
  double min_frequency_ = 0.0, max_frequency_ = 0.0;  // Hz, that the diagnostics expect
  std::string last_problem_, last_warning_;
  LmsReport::Phase last_phase_ = LmsReport::Phase::kNoPort;
  std::size_t last_faults_ = 0;
  double latency_ = 0.0;  // s, of the last stamp
};

void SickNodelet::start(mapping_common::Parameters& parameters) {
  parameters.read(parameters_);
  const LmsOptions options = parameters_.options();
  const diagnostic_updater::FrequencyStatusParam frequency(
      &min_frequency_, &max_frequency_, parameters_.frequency_tolerance, parameters_.window_size);
  const diagnostic_updater::TimeStampStatusParam delay(parameters_.min_acceptable_delay,
                                                       parameters_.max_acceptable_delay);

  publisher_ = getNodeHandle().advertise<sensor_msgs::LaserScan>("scan", 10);
  startDiagnostics(parameters_.hardware_id,
                   {{"Device", [this](StatusWrapper& status) { diagnose(status); }}});
  scan_diagnostic_ =
      std::make_unique<diagnostic_updater::TopicDiagnostic>("scan", diagnostics(), frequency, delay);

  Connection::Options times;
  if (options.restore_on_exit) times.stop_timeout = Lms2xx::kRestoreTime;
  lms_ = std::make_unique<Lms2xx>(options, [this](const lms::Scan& scan) { publish(scan); });
  const SickParameters at_start = parameters_;
  connect(parameters_.endpoint(), *lms_, times);
  allowReconfiguration<SickParameters>(at_start, [this](const SickParameters& changed) {
    post([this, changed](Nanoseconds) { parameters_ = changed; });
  });
}

// --------------------------------------------------------------------------------------------------------
// in the connection's thread

void SickNodelet::publish(const lms::Scan& scan) {
  latency_ = static_cast<double>(scan.stamp - Connection::now()) / kSecond;
  const std::int64_t stamp = toRosTime(scan.stamp, parameters_.time_offset);
  if (stamp <= 0) return;
  const auto message = boost::make_shared<sensor_msgs::LaserScan>();
  message->header.stamp.fromNSec(static_cast<std::uint64_t>(stamp));
  message->header.frame_id = parameters_.frame_id;
  const double side = parameters_.inverted ? -1.0 : 1.0;
  message->angle_min = static_cast<float>(side * scan.angle_min);
  message->angle_increment = static_cast<float>(side * scan.angle_increment);
  message->angle_max = static_cast<float>(
      side * (scan.angle_min + static_cast<double>(scan.ranges.size() - 1) * scan.angle_increment));
  message->time_increment = static_cast<float>(scan.time_increment);
  message->scan_time = static_cast<float>(scan.scan_time);
  message->range_min = static_cast<float>(scan.range_min);
  message->range_max = static_cast<float>(scan.range_max);
  message->ranges = scan.ranges;
  if (!parameters_.use_rep_117) {
    for (float& range : message->ranges) {
      if (!std::isfinite(range)) range = message->range_max + 1.0f;
    }
  }
  message->intensities = scan.intensities;
  for (float& intensity : message->intensities) intensity *= static_cast<float>(parameters_.intensity_scale);
  publisher_.publish(message);
  scan_diagnostic_->tick(message->header.stamp);
}

void SickNodelet::reportHere() {
  const LmsReport& report = lms_->report();
  if (report.problem != last_problem_ && !report.problem.empty()) {
    NODELET_WARN_STREAM(endpoint().name() << ": " << report.problem << ", trying again");
  }
  if (report.warning != last_warning_ && !report.warning.empty()) {
    NODELET_WARN_STREAM(endpoint().name() << ": " << report.warning);
  }
  if (report.phase != last_phase_ && report.phase == LmsReport::Phase::kStreaming) {
    NODELET_INFO_STREAM(endpoint().name() << ": " << report.type << " at " << report.baud_rate << " baud, "
                                          << report.variant.text() << ", " << report.scan_rate << " Hz");
  }
  if (report.beyond_top > 0) {
    NODELET_WARN_ONCE(
        "There are ranges of more than 13 bits, perhaps with flags on top: see the parameter "
        "intensity_range");
  }
  if (report.unit_changes > 0) NODELET_WARN_ONCE("Scans come in another unit than the device is set to");
  last_problem_ = report.problem;
  last_warning_ = report.warning;
  last_phase_ = report.phase;
  const double expected =
      parameters_.desired_frequency > 0.0 ? parameters_.desired_frequency : report.scan_rate;
  min_frequency_ = parameters_.min_frequency > 0.0 ? parameters_.min_frequency : expected;
  max_frequency_ = parameters_.max_frequency > 0.0 ? parameters_.max_frequency : expected;
  DeviceNodelet::reportHere();
}

void SickNodelet::diagnose(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  using Phase = LmsReport::Phase;
  const LmsReport& report = lms_->report();
  const lms::Status device(report.status);
  std::size_t faults = report.lost;
  for (const auto& [reason, count] : report.dropped()) faults += count;
  const bool streaming = report.phase == Phase::kStreaming;
  if (!portProblem().empty()) {
    status.summary(DiagnosticStatus::ERROR, "Not connected: " + portProblem());
  } else if (!streaming) {
    const std::string doing = report.phase == Phase::kSettingUp ? "Setting up" : "Looking for the device";
    status.summary(DiagnosticStatus::ERROR, report.problem.empty() ? doing : doing + ": " + report.problem);
  } else if (device.severity >= 3) {
    status.summaryf(DiagnosticStatus::ERROR, "The device reports %s, status %02Xh",
                    device.severity == 3 ? "an error" : "a fatal error", report.status);
  } else if (device.pollution || device.severity == 2) {
    status.summary(DiagnosticStatus::WARN,
                   device.pollution ? "The front window is dirty" : "The device reports a warning");
  } else if (!report.warning.empty()) {
    status.summary(DiagnosticStatus::WARN, report.warning);
  } else if (faults != last_faults_) {
    status.summaryf(DiagnosticStatus::WARN, "%zu faults of transmission", faults - last_faults_);
  } else {
    status.summary(DiagnosticStatus::OK, "Streaming");
  }
  last_faults_ = faults;

  status.add("Serial Port", endpoint().device);
  status.add("Serial Baud", report.baud_rate);
  status.add("Vendor Name", "SICK");
  status.add("Product Name", report.type);
  status.add("Firmware Version", report.software_version);
  status.add("Protocol Version", "LMS 2xx telegrams");
  status.addf("Computed Latency", "%.4f", latency_);
  status.addf("User Time Offset", "%.4f", parameters_.time_offset);
  status.add("Variant", streaming ? report.variant.text() : "");
  status.addf("Measuring mode", "%02Xh", report.measuring_mode & 0xFF);
  status.add("Real-time index", report.real_time_index ? "on" : "off");
  status.addf("Expected rate (Hz)", "%.2f", report.scan_rate);
  status.add("Pollution", device.pollution ? "yes" : "no");
  status.add("Implausible values", device.implausible ? "yes" : "no");
  status.addf("Status", "%02Xh", report.status);
  status.add("Scans", report.scans);
  status.add("Scans lost", report.lost);
  for (const auto& [reason, count] : report.dropped()) status.add("Dropped: " + reason, count);
  status.add("Dropped: bytes", report.line.skipped);
  status.add("Unexpected telegrams", report.unexpected);
  status.add("Commands repeated", report.repeated);
  status.add("Commands refused", report.refused);
  status.add("Scans failed to appear", report.timeouts);
  status.add("Power-ons", report.power_ons);
  status.add("Disconnects", disconnects());
  status.add("Configurations written", report.configurations_written);
  status.add("Scans in another unit", report.unit_changes);
  status.add("Ranges of more than 13 bits", report.beyond_top);
}

}  // namespace hokuyo_sick_drivers

PLUGINLIB_EXPORT_CLASS(hokuyo_sick_drivers::SickNodelet, nodelet::Nodelet)
