// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/nodelet.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace mapping_common {
namespace {

const ros::WallDuration kClockStands(5.0);

// The parameter server keeps a name that was corrected in the launch file, for as long as the master lives.
// @param error e.g. "unknown: ~kernal (~kernel?), ~x; ..." @return how to remove these; "" of other errors
std::string adviceOn(const std::string& error, const std::string& name_space) {
  const std::string start = "unknown: ";
  if (error.compare(0, start.size(), start) != 0) return "";
  std::istringstream words(error.substr(start.size(), error.find(';') - start.size()));
  std::string commands;
  for (std::string word; words >> word;) {
    if (word[0] != '~') continue;
    commands += (commands.empty() ? "" : "; ") + ("rosparam delete " + name_space + '/') +
                word.substr(1, word.find(',') - 1);
  }
  return ". Names that have been corrected since are still on the parameter server: " + commands;
}

}  // namespace

void Nodelet::onInit() {
  guard_ = std::make_shared<CallbackGuard>(getName());
  queue_ = std::make_unique<GuardedQueue>(getSTCallbackQueue(), guard_);
  queue_->hold();  // the manager's other threads would run callbacks while `start` goes on
  for (ros::NodeHandle* node : {&getNodeHandle(), &getPrivateNodeHandle()})
    node->setCallbackQueue(queue_.get());
  try {
    const ros::NodeHandle& node = getPrivateNodeHandle();
    XmlRpc::XmlRpcValue values;
    node.getParam(node.getNamespace(), values);
    Parameters parameters(values);
    start(parameters);
    queue_->release();
  } catch (const std::exception& e) {
    NODELET_FATAL_STREAM("Not started: " << e.what()
                                         << adviceOn(e.what(), getPrivateNodeHandle().getNamespace()));
    throw;  // the manager then reports that the nodelet could not be loaded
  }
}

void Nodelet::startDiagnostics(
    const std::string& hardware_id,
    const std::vector<std::pair<std::string, std::function<void(StatusWrapper&)>>>& reports) {
  diagnostics_ =
      std::make_unique<diagnostic_updater::Updater>(getNodeHandle(), getPrivateNodeHandle(), getName());
  diagnostics_->setHardwareID(hardware_id);
  for (const auto& [name, report] : reports) diagnostics_->add(name, report);
  diagnostics_->add("Nodelet", [this](StatusWrapper& status) { diagnose(status); });
  last_report_ = clock_moved_ = ros::WallTime::now();
  diagnostics_timer_ = every(1.0, [this] {
    watchClock();
    report();
  });
}

ros::WallTimer Nodelet::every(double seconds, const std::function<void()>& work) {
  return getNodeHandle().createWallTimer(ros::WallDuration(seconds),
                                         [this, work](const ros::WallTimerEvent&) { guard_->run(work); });
}

void Nodelet::report() {
  diagnostics_->force_update();
  last_report_ = ros::WallTime::now();
}

double Nodelet::reportedTime() const {
  return std::max(1e-3, (ros::WallTime::now() - last_report_).toSec());
}

// Whoever plays a recording leaves /use_sim_time true, and the next driver's stamps don't go on.
void Nodelet::watchClock() {
  if (!ros::Time::isSimTime()) return;
  const ros::WallTime now = ros::WallTime::now();
  if (const ros::Time clock = ros::Time::now(); clock != clock_) {
    clock_ = clock;
    clock_moved_ = now;
  }
  clock_stands_ = now - clock_moved_ > kClockStands;
  if (clock_stands_ && clock_throttle_()) {
    NODELET_WARN_STREAM("/use_sim_time is true, and "
                        << (clock_.isZero() ? "no clock has come" : "the clock hasn't moved") << " for "
                        << std::lround((now - clock_moved_).toSec())
                        << " s: time stands. Unless a recording or a simulator is about to publish /clock: "
                           "rosparam set /use_sim_time false, and start this again");
  }
}

void Nodelet::diagnose(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::size_t exceptions = guard_->exceptions();
  if (exceptions > reported_exceptions_) {
    status.summary(DiagnosticStatus::ERROR, "A callback failed: " + guard_->lastException());
  } else if (clock_stands_) {
    status.summary(DiagnosticStatus::WARN, "/use_sim_time is true, and the clock stands");
  } else {
    status.summary(DiagnosticStatus::OK, "Running");
  }
  status.add("Callbacks that failed", exceptions);
  status.add("Last failure", guard_->lastException());
  reported_exceptions_ = exceptions;
}

void Nodelet::endCallbacks() {
  services_.clear();
  diagnostics_timer_.stop();
  reconfigure_server_.reset();
}

}  // namespace mapping_common
