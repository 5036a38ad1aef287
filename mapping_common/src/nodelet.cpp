// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/nodelet.h"

#include <algorithm>
#include <sstream>

namespace mapping_common {

void Nodelet::onInit() {
  try {
    const ros::NodeHandle& node = getPrivateNodeHandle();
    XmlRpc::XmlRpcValue values;
    node.getParam(node.getNamespace(), values);
    Parameters parameters(values);
    start(parameters);
  } catch (const std::exception& e) {
    NODELET_FATAL_STREAM("Not started: " << e.what());
    throw;  // the manager then reports that the nodelet could not be loaded
  }
}

void Nodelet::rejectUnknown(const Parameters& parameters, std::vector<std::string> except) const {
  except.push_back("reconfigure/");
  parameters.rejectUnknown(except);
}

void Nodelet::startDiagnostics(
    const std::string& hardware_id,
    const std::vector<std::pair<std::string, std::function<void(StatusWrapper&)>>>& reports) {
  diagnostics_ =
      std::make_unique<diagnostic_updater::Updater>(getNodeHandle(), getPrivateNodeHandle(), getName());
  diagnostics_->setHardwareID(hardware_id);
  for (const auto& [name, report] : reports) diagnostics_->add(name, report);
  last_report_ = ros::WallTime::now();
  // Wall time: what a bag brought is reported while it is paused, too.
  diagnostics_timer_ = getNodeHandle().createWallTimer(ros::WallDuration(1.0),
                                                       [this](const ros::WallTimerEvent&) { report(); });
}

void Nodelet::report() {
  diagnostics_->force_update();
  last_report_ = ros::WallTime::now();
}

double Nodelet::reportedTime() const {
  return std::max(1e-3, (ros::WallTime::now() - last_report_).toSec());
}

void Nodelet::endCallbacks() {
  diagnostics_timer_.stop();
  reconfigure_server_.reset();
}

DropCounts::DropCounts(std::vector<std::string> reasons)
    : reasons_(std::move(reasons)), counts_(reasons_.size(), 0) {}

void DropCounts::add(std::size_t reason, std::size_t count) {
  counts_[reason] += count;
  recent_ += count;
}

std::string DropCounts::text() const {
  std::ostringstream text;
  for (std::size_t i = 0; i < counts_.size(); ++i)
    text << (i > 0 ? ", " : "") << counts_[i] << ' ' << reasons_[i];
  return text.str();
}

void DropCounts::addTo(diagnostic_updater::DiagnosticStatusWrapper& status, const std::string& prefix) const {
  for (std::size_t i = 0; i < counts_.size(); ++i) status.add(prefix + ": " + reasons_[i], counts_[i]);
}

}  // namespace mapping_common
