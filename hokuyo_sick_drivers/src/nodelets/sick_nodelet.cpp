// SPDX-License-Identifier: BSD-3-Clause
//
// Publishes the scans of a SICK LMS 2xx.
#include <diagnostic_updater/publisher.h>
#include <hokuyo_sick_drivers/SickConfig.h>
#include <sensor_msgs/LaserScan.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <vector>

#include "device_nodelet.h"
#include "hokuyo_sick_drivers/lms2xx.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::Parameters;

// Index of a parameter's value among those allowed; none for "": as the device has it.
std::optional<int> readChoice(Parameters& parameters, const std::string& name, const std::string& fallback,
                              const std::vector<std::string>& allowed) {
  std::vector<std::string> words = allowed;
  words.push_back("");
  const std::string value = parameters.choice(name, fallback, words);
  if (value.empty()) return std::nullopt;
  return static_cast<int>(std::find(allowed.begin(), allowed.end(), value) - allowed.begin());
}

std::optional<bool> readSwitch(Parameters& parameters, const std::string& name, const std::string& fallback) {
  const std::optional<int> choice = readChoice(parameters, name, fallback, {"disabled", "enabled"});
  if (!choice) return std::nullopt;
  return *choice == 1;
}

std::optional<lms::Variant> readVariant(Parameters& parameters) {
  const int angle = parameters.get("angle", 0, 0, 180);
  const double resolution = parameters.get("resolution", 0.0, 0.0, 1.0);
  if (angle == 0 && resolution == 0.0) return std::nullopt;
  return lms::Variant{angle, static_cast<int>(std::lround(100.0 * resolution))};
}

LmsOptions readOptions(Parameters& parameters) {
  const auto indexOf = [&](const std::string& name, const std::vector<std::string>& allowed) {
    const std::string value = parameters.choice(name, allowed[0], allowed);
    return std::find(allowed.begin(), allowed.end(), value) - allowed.begin();
  };
  LmsOptions options;
  options.baud_rate = parameters.get("baud", options.baud_rate);
  options.connect_delay = std::llround(parameters.get("connect_delay", 0.0, 0.0, 600.0) * kSecond);
  options.variant = readVariant(parameters);
  options.interlaced = parameters.get("interlaced", false);
  options.intensity =
      static_cast<LmsOptions::Intensity>(indexOf("intensity", {"none", "normalised", "direct"}));
  options.intensity_range =
      static_cast<LmsOptions::IntensityRange>(indexOf("intensity_range", {"plain", "flags", "16_bit"}));
  options.first_index = parameters.get("first_index", options.first_index);
  options.last_index = parameters.get("last_index", options.last_index);
  if (const auto unit = readChoice(parameters, "units", "", {"cm", "mm"})) {
    options.unit = static_cast<lms::Unit>(*unit);
  }
  const int measuring_mode = parameters.get("measuring_mode", -1, -1, 255);
  if (measuring_mode >= 0) options.measuring_mode = measuring_mode;
  options.sensitivity = readChoice(parameters, "sensitivity", "", {"standard", "medium", "low", "high"});
  options.highest_availability = readSwitch(parameters, "highest_availability", "");
  options.ignore_dazzling = readSwitch(parameters, "ignore_dazzling", "");
  options.real_time_index = readSwitch(parameters, "realtime_index", "enabled");
  options.restore_on_exit = parameters.get("restore_on_exit", false);
  options.check();
  return options;
}

}  // namespace

class SickNodelet : public DeviceNodelet {
 public:
  ~SickNodelet() override { disconnect(); }

 private:
  void start(Parameters& parameters) override;

  void publish(const lms::Scan& scan);
  void reportHere() override;
  void diagnose(StatusWrapper& status);

  std::string frame_id_;
  bool use_rep_117_ = true;
  SickConfig config_;
  std::unique_ptr<Lms2xx> lms_;
  ros::Publisher publisher_;

  std::unique_ptr<diagnostic_updater::TopicDiagnostic> scan_diagnostic_;
  double desired_frequency_ = 0.0;
  double min_frequency_ = 0.0, max_frequency_ = 0.0;  // Hz, that the diagnostics expect
  std::string last_problem_, last_warning_;
  LmsReport::Phase last_phase_ = LmsReport::Phase::kNoPort;
  std::size_t last_faults_ = 0;
  double latency_ = 0.0;  // s, of the last stamp
};

void SickNodelet::start(Parameters& parameters) {
  const LmsOptions options = readOptions(parameters);
  Endpoint endpoint;
  endpoint.device = parameters.get<std::string>("port", "/dev/lms200");
  endpoint.baud_rate = options.baud_rate;
  frame_id_ = parameters.get<std::string>("frame_id", "laser");
  use_rep_117_ = parameters.get("use_rep_117", true);
  config_.inverted = parameters.get("inverted", false);
  config_.time_offset = parameters.get("time_offset", 0.0, -1.0, 1.0);
  config_.intensity_scale = parameters.get("intensity_scale", 1.0);
  desired_frequency_ = parameters.get("desired_frequency", 0.0, 0.0, 100.0);
  config_.min_frequency = parameters.get("min_frequency", 0.0, 0.0, 100.0);
  config_.max_frequency = parameters.get("max_frequency", 0.0, 0.0, 100.0);
  const diagnostic_updater::FrequencyStatusParam frequency(
      &min_frequency_, &max_frequency_, parameters.get("frequency_tolerance", 0.3, 0.0, 1.0),
      parameters.get("window_size", 5, 1, 1000));
  const diagnostic_updater::TimeStampStatusParam delay(
      parameters.get("min_acceptable_delay", 0.0, -10.0, 10.0),
      parameters.get("max_acceptable_delay", 1.0, 0.0, 10.0));
  const std::string hardware_id = parameters.get<std::string>("hardware_id", "SICK LMS");
  rejectUnknown(parameters);

  publisher_ = getNodeHandle().advertise<sensor_msgs::LaserScan>("scan", 10);
  startDiagnostics(hardware_id, {{"Device", [this](StatusWrapper& status) { diagnose(status); }}});
  scan_diagnostic_ =
      std::make_unique<diagnostic_updater::TopicDiagnostic>("scan", diagnostics(), frequency, delay);

  Connection::Options times;
  if (options.restore_on_exit) times.stop_timeout = Lms2xx::kRestoreTime;
  lms_ = std::make_unique<Lms2xx>(options, [this](const lms::Scan& scan) { publish(scan); });
  const SickConfig config = config_;
  connect(endpoint, *lms_, times);
  allowReconfiguration<SickConfig>(config, [this](const SickConfig& changed, std::uint32_t) {
    post([this, changed](Nanoseconds) { config_ = changed; });
  });
}

// --------------------------------------------------------------------------------------------------------
// in the connection's thread

void SickNodelet::publish(const lms::Scan& scan) {
  latency_ = static_cast<double>(scan.stamp - Connection::now()) / kSecond;
  const std::int64_t stamp = toRosTime(scan.stamp, config_.time_offset);
  if (stamp <= 0) return;
  const auto message = boost::make_shared<sensor_msgs::LaserScan>();
  message->header.stamp.fromNSec(static_cast<std::uint64_t>(stamp));
  message->header.frame_id = frame_id_;
  const double side = config_.inverted ? -1.0 : 1.0;
  message->angle_min = static_cast<float>(side * scan.angle_min);
  message->angle_increment = static_cast<float>(side * scan.angle_increment);
  message->angle_max = static_cast<float>(
      side * (scan.angle_min + static_cast<double>(scan.ranges.size() - 1) * scan.angle_increment));
  message->time_increment = static_cast<float>(scan.time_increment);
  message->scan_time = static_cast<float>(scan.scan_time);
  message->range_min = static_cast<float>(scan.range_min);
  message->range_max = static_cast<float>(scan.range_max);
  message->ranges = scan.ranges;
  if (!use_rep_117_) {
    for (float& range : message->ranges) {
      if (!std::isfinite(range)) range = message->range_max + 1.0f;
    }
  }
  message->intensities = scan.intensities;
  for (float& intensity : message->intensities) intensity *= static_cast<float>(config_.intensity_scale);
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
  const double expected = desired_frequency_ > 0.0 ? desired_frequency_ : report.scan_rate;
  min_frequency_ = config_.min_frequency > 0.0 ? config_.min_frequency : expected;
  max_frequency_ = config_.max_frequency > 0.0 ? config_.max_frequency : expected;
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
  status.addf("User Time Offset", "%.4f", config_.time_offset);
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
