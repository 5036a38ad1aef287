// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <mapping_common/callback_guard.h>
#include <mapping_common/files.h>
#include <mapping_common/parameters.h>
#include <mapping_common/reconfiguration.h>
#include <nodelet/nodelet.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace mapping_common {

/// Does what a service for a file is asked for: success and message of the response tell how it went.
/// @param path must be absolute, as the nodelet's folder isn't the caller's
/// @param work returns the message, or throws
template <class Response>
void answer(const std::string& path, Response& response, const std::function<std::string()>& work) {
  try {
    if (path.empty() || path[0] != '/')
      throw std::invalid_argument("path is '" + path + "', allowed is an absolute path");
    response.message = work();
    response.success = true;
  } catch (const std::exception& e) {
    response.message = e.what();
  }
}

/// A nodelet that starts with checked parameters or not at all, and reports every second. An exception out of
/// a callback of its node handles (messages, services, timers, reconfiguration) ends there: it is logged and
/// counted, and the manager lives.
class Nodelet : public nodelet::Nodelet {
 protected:
  using StatusWrapper = diagnostic_updater::DiagnosticStatusWrapper;

  /// Reads the parameters, sets all up and subscribes. No callback comes before it is done.
  /// @throws std::exception what it says is logged, and the nodelet isn't loaded. Nothing may be advertised
  ///   or subscribed before: a manager doesn't survive the end of a nodelet's publishers in a failed start
  virtual void start(Parameters& parameters) = 0;

  /// Lets a struct's dynamic options change while the nodelet runs, by rqt_reconfigure under the nodelet's
  /// own name. What they were changed to is on the parameter server then.
  /// @param options as it was started
  /// @param apply gets changed ones that have been checked; where it throws, having changed nothing, those
  /// before stay
  template <class Options>
  void allowReconfiguration(const Options& options, std::function<void(const Options&)> apply);

  /// Advertises a service. Where `work` throws, what it says is logged, and the call fails;
  /// std::invalid_argument is the caller's fault, and no failure of the nodelet.
  template <class Service>
  void serve(ros::NodeHandle& node, const std::string& name,
             const std::function<void(typename Service::Request&, typename Service::Response&)>& work);
  /// Advertises a private service for a file, see `answer`.
  /// @param work gets the path, returns the message, or throws
  template <class Service>
  void serveFile(const std::string& name, const std::function<std::string(const std::string&)>& work);

  /// Does `work` periodically. roscpp never calls a timer again whose callback threw; this goes on.
  /// Wall time: what a bag brought is published while it is paused, too.
  ros::WallTimer every(double seconds, const std::function<void()>& work);

  /// Begins to publish diagnostics, by name, and of the nodelet itself.
  void startDiagnostics(
      const std::string& hardware_id,
      const std::vector<std::pair<std::string, std::function<void(StatusWrapper&)>>>& reports);
  diagnostic_updater::Updater& diagnostics() { return *diagnostics_; }
  /// Called every second: publishes the diagnostics. Counts of what happened since the last ones end here.
  virtual void report();
  /// s, that the next report is about
  double reportedTime() const;

  /// For callbacks that don't come by the node handles.
  const std::shared_ptr<CallbackGuard>& guard() const { return guard_; }

  /// Ends services, reconfiguration and reports: for the destructor, where they use what it destroys.
  void endCallbacks();

 private:
  void onInit() final;
  void watchClock();
  void diagnose(StatusWrapper& status);

  std::shared_ptr<CallbackGuard> guard_;
  std::unique_ptr<GuardedQueue> queue_;
  std::vector<ros::ServiceServer> services_;

  ros::Time clock_;  // simulated
  ros::WallTime clock_moved_;
  Throttle clock_throttle_{60.0};
  std::atomic<bool> clock_stands_{false};  // reports may come from other threads
  std::size_t reported_exceptions_ = 0;

  boost::recursive_mutex reconfigure_mutex_;
  std::shared_ptr<void> reconfigure_server_;  // of the nodelet's own type of configuration
  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;
  ros::WallTimer diagnostics_timer_;
  ros::WallTime last_report_;
};

template <class Options>
void Nodelet::allowReconfiguration(const Options& options, std::function<void(const Options&)> apply) {
  using Config = Reconfiguration<Options>;
  const auto server =
      std::make_shared<dynamic_reconfigure::Server<Config>>(reconfigure_mutex_, getPrivateNodeHandle());
  server->updateConfig(Config{options, ""});
  server->setCallback([this, accepted = options, apply](Config& changed, std::uint32_t) mutable {
    try {
      if (!changed.error.empty()) throw std::invalid_argument(changed.error);
      apply(validate(changed.options, "~"));
      accepted = changed.options;
    } catch (const std::exception& e) {
      NODELET_ERROR_STREAM("Reconfiguration rejected: " << e.what());
      changed = Config{accepted, ""};
    }
  });
  reconfigure_server_ = server;
}

template <class Service>
void Nodelet::serve(
    ros::NodeHandle& node, const std::string& name,
    const std::function<void(typename Service::Request&, typename Service::Response&)>& work) {
  using Request = typename Service::Request;
  using Response = typename Service::Response;
  const boost::function<bool(Request&, Response&)> callback = [=](Request& request, Response& response) {
    bool done = false;
    guard_->run([&] {
      try {
        work(request, response);
        done = true;
      } catch (const std::invalid_argument& e) {
        NODELET_ERROR_STREAM(name << ": " << e.what());
      }
    });
    return done;
  };
  services_.push_back(node.advertiseService<Request, Response>(name, callback));
}

template <class Service>
void Nodelet::serveFile(const std::string& name, const std::function<std::string(const std::string&)>& work) {
  serve<Service>(getPrivateNodeHandle(), name,
                 [work](typename Service::Request& request, typename Service::Response& response) {
                   answer(request.path, response, [&] { return work(request.path); });
                 });
}

}  // namespace mapping_common
