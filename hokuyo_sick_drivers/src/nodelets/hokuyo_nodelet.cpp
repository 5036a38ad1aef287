// SPDX-License-Identifier: BSD-3-Clause
//
// Publishes the scans of a Hokuyo.
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/MultiEchoLaserScan.h>
#include <std_srvs/Trigger.h>

#include <cmath>
#include <deque>
#include <map>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "device_nodelet.h"
#include "hokuyo_parameters.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr std::size_t kQueueSize = 20;
constexpr Nanoseconds kSayAgain = 30 * kSecond;
const ros::WallDuration kStatusTimeout(5.0);

template <class Message>
boost::shared_ptr<Message> makeMessage(const HokuyoScan& scan, const std_msgs::Header& header) {
  auto message = boost::make_shared<Message>();
  message->header = header;
  message->angle_min = static_cast<float>(scan.angle_min);
  message->angle_max = static_cast<float>(scan.angle_max);
  message->angle_increment = static_cast<float>(scan.angle_increment);
  message->time_increment = static_cast<float>(scan.time_increment);
  message->scan_time = static_cast<float>(scan.scan_time);
  message->range_min = static_cast<float>(scan.range_min);
  message->range_max = static_cast<float>(scan.range_max);
  return message;
}

sensor_msgs::LaserScanPtr toMessage(const HokuyoScan& scan, Echo echo, const std_msgs::Header& header) {
  auto message = makeMessage<sensor_msgs::LaserScan>(scan, header);
  selectEchoes(scan, echo, message->ranges, message->intensities);
  return message;
}

sensor_msgs::MultiEchoLaserScanPtr toMessage(const HokuyoScan& scan, const std_msgs::Header& header) {
  auto message = makeMessage<sensor_msgs::MultiEchoLaserScan>(scan, header);
  message->ranges.resize(scan.rays());
  message->intensities.resize(scan.intensities.empty() ? 0 : scan.rays());
  for (std::size_t ray = 0; ray < scan.rays(); ++ray) {
    const auto begin = scan.first_echo[ray], end = scan.first_echo[ray + 1];
    message->ranges[ray].echoes.assign(scan.ranges.begin() + begin, scan.ranges.begin() + end);
    if (scan.intensities.empty()) continue;
    message->intensities[ray].echoes.assign(scan.intensities.begin() + begin, scan.intensities.begin() + end);
  }
  return message;
}

}  // namespace

class HokuyoNodelet : public DeviceNodelet {
 public:
  ~HokuyoNodelet() override { disconnect(); }

 private:
  void start(mapping_common::Parameters& parameters) override;

  void publish(const HokuyoScan& scan);
  void say(Hokuyo::Level level, const std::string& text);

  bool updateStatus(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response);
  void reportHere() override;
  void diagnoseDevice(StatusWrapper& status);
  void diagnoseScans(StatusWrapper& status);

  ros::Publisher scan_publisher_, echoes_publisher_;
  std::map<Echo, ros::Publisher> echo_publishers_;
  ros::ServiceServer status_service_;

  // Of the connection's thread, once that runs.
  HokuyoParameters parameters_;
  std::map<std::string, Nanoseconds> said_;
  Hokuyo::Status status_;  // as it is reported
  HokuyoFaults reported_faults_{};
  std::deque<std::pair<ros::WallTime, std::uint64_t>> scan_counts_;
  std::unique_ptr<Hokuyo> hokuyo_;
};

void HokuyoNodelet::start(mapping_common::Parameters& parameters) {
  parameters.read(parameters_);
  const Endpoint endpoint = parameters_.endpoint();

  scan_publisher_ = getNodeHandle().advertise<sensor_msgs::LaserScan>("scan", kQueueSize);
  // Beside the nodelet, so that those of several scanners don't mix.
  ros::NodeHandle& own = getPrivateNodeHandle();
  echoes_publisher_ = own.advertise<sensor_msgs::MultiEchoLaserScan>("echoes", kQueueSize);
  echo_publishers_[Echo::kFirst] = own.advertise<sensor_msgs::LaserScan>("first", kQueueSize);
  echo_publishers_[Echo::kLast] = own.advertise<sensor_msgs::LaserScan>("last", kQueueSize);
  echo_publishers_[Echo::kMostIntense] = own.advertise<sensor_msgs::LaserScan>("most_intense", kQueueSize);

  hokuyo_ = std::make_unique<Hokuyo>(
      parameters_.options(), parameters_.settings,
      Hokuyo::Events{[this](const HokuyoScan& scan) { publish(scan); },
                     [this](Hokuyo::Level level, const std::string& text) { say(level, text); }});
  startDiagnostics(endpoint.name(),
                   {{"Hardware Status", [this](StatusWrapper& status) { diagnoseDevice(status); }},
                    {"Scans", [this](StatusWrapper& status) { diagnoseScans(status); }}});
  const HokuyoParameters at_start = parameters_;
  connect(endpoint, *hokuyo_, {});
  allowReconfiguration<HokuyoParameters>(at_start, [this](const HokuyoParameters& changed) {
    ask([this, changed](Nanoseconds now) {
      hokuyo_->configure(changed.settings, now);
      parameters_ = changed;
    });
  });
  status_service_ = own.advertiseService("update_laser_status", &HokuyoNodelet::updateStatus, this);
}

// ------------------------------------------------------------------------------- in the connection's thread

void HokuyoNodelet::publish(const HokuyoScan& scan) {
  const std::int64_t stamp = toRosTime(scan.stamp, parameters_.time_offset);
  if (stamp <= 0) return;
  std_msgs::Header header;
  header.frame_id = parameters_.frame_id;
  header.stamp.fromNSec(static_cast<std::uint64_t>(stamp));
  if (scan_publisher_.getNumSubscribers() > 0) scan_publisher_.publish(toMessage(scan, Echo::kFirst, header));
  if (echoes_publisher_.getNumSubscribers() > 0) echoes_publisher_.publish(toMessage(scan, header));
  for (const auto& [echo, publisher] : echo_publishers_) {
    if (publisher.getNumSubscribers() > 0) publisher.publish(toMessage(scan, echo, header));
  }
}

// The same again only after a while.
void HokuyoNodelet::say(Hokuyo::Level level, const std::string& text) {
  const Nanoseconds now = Connection::now();
  const auto said = said_.find(text);
  if (said != said_.end() && now - said->second < kSayAgain) return;
  said_[text] = now;
  switch (level) {
    case Hokuyo::Level::kInfo:
      NODELET_INFO_STREAM(text);
      break;
    case Hokuyo::Level::kWarning:
      NODELET_WARN_STREAM(text);
      break;
    case Hokuyo::Level::kError:
      NODELET_ERROR_STREAM(text);
      break;
  }
}

void HokuyoNodelet::reportHere() {
  status_ = hokuyo_->status();
  const ros::WallTime now = ros::WallTime::now();
  scan_counts_.emplace_back(now, status_.scans);
  while ((now - scan_counts_.front().first).toSec() > parameters_.diagnostics_window_time + 0.5)
    scan_counts_.pop_front();
  DeviceNodelet::reportHere();
  reported_faults_ = status_.faults;
}

void HokuyoNodelet::diagnoseDevice(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::string trouble = status_.trouble(), faults = differences(reported_faults_, status_.faults);
  if (!portProblem().empty()) {
    status.summary(DiagnosticStatus::ERROR, "Not connected: " + portProblem());
  } else if (!status_.measuring) {
    status.summary(DiagnosticStatus::ERROR,
                   "Not measuring: " + (status_.problem.empty() ? status_.activity : status_.problem));
  } else if (!trouble.empty()) {
    status.summary(DiagnosticStatus::ERROR, "Measuring, but the device says: " + trouble);
  } else if (!status_.warning.empty()) {
    status.summary(DiagnosticStatus::WARN, status_.warning);
  } else if (!faults.empty()) {
    status.summary(DiagnosticStatus::WARN, "Since the last report: " + faults);
  } else {
    status.summary(DiagnosticStatus::OK, "Measuring");
  }
  status.add("Port", endpoint().name());
  if (endpoint().host.empty()) status.add("Baud rate", status_.baud_rate);
  const std::vector<std::pair<std::string, std::string>> info = {
      {"Vendor Name", "VEND"},      {"Product Name", "PROD"}, {"Firmware Version", "FIRM"},
      {"Protocol Version", "PROT"}, {"Device ID", "SERI"},    {"Device Status", "STAT"}};
  for (const auto& [label, key] : info) {
    const auto found = status_.info.find(key);
    status.add(label, found != status_.info.end() ? found->second : "unknown");
  }
  status.addf("Computed Latency", "%.6f", 1e-9 * static_cast<double>(status_.latency));
  status.add("User Time Offset", parameters_.time_offset);
  status.addf("Clock drift (ppm)", "%.1f", -1e6 * status_.clock_drift);
  for (std::size_t i = 0; i < status_.faults.size(); ++i) {
    status.add(std::string("Count: ") + name(static_cast<HokuyoFault>(i)), status_.faults[i]);
  }
}

void HokuyoNodelet::diagnoseScans(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const auto& [begin, first_count] = scan_counts_.front();
  const auto& [end, last_count] = scan_counts_.back();
  const double seconds = (end - begin).toSec();
  const double rate = seconds > 0.0 ? static_cast<double>(last_count - first_count) / seconds : 0.0;
  const double expected =
      status_.geometry ? 1e9 / static_cast<double>(status_.geometry->period() * (status_.settings.skip + 1))
                       : 0.0;
  if (last_count == first_count) {
    status.summary(DiagnosticStatus::ERROR, "No scans");
  } else if (std::abs(rate - expected) > parameters_.diagnostics_tolerance * expected) {
    status.summary(DiagnosticStatus::WARN, "Rate not as expected");
  } else {
    status.summary(DiagnosticStatus::OK, "Rate as expected");
  }
  status.addf("Rate (Hz)", "%.2f", rate);
  status.addf("Expected rate (Hz)", "%.2f", expected);
  status.add("Scans", status_.scans);
  status.add("Intensities", status_.settings.intensity);
  status.add("Multiple echoes", status_.settings.multi_echo);
}

// ------------------------------------------------------------------------------------ in ROS's threads

bool HokuyoNodelet::updateStatus(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response) {
  try {
    const std::uint64_t before = ask([this](Nanoseconds now) {
      hokuyo_->updateStatus(now);
      return hokuyo_->status().informed;
    });
    const ros::WallTime end = ros::WallTime::now() + kStatusTimeout;
    while (ros::ok() && !response.success && ros::WallTime::now() < end) {
      ros::WallDuration(0.01).sleep();
      const Hokuyo::Status status = ask([this](Nanoseconds) { return hokuyo_->status(); });
      const auto state = status.info.find("STAT");
      response.success = status.informed > before && state != status.info.end();
      response.message = response.success         ? state->second
                         : status.problem.empty() ? status.activity
                                                  : status.problem;
    }
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

}  // namespace hokuyo_sick_drivers

PLUGINLIB_EXPORT_CLASS(hokuyo_sick_drivers::HokuyoNodelet, nodelet::Nodelet)
