// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <mapping_common/parameters.h>
#include <mapping_common/reconfiguration.h>
#include <nodelet/nodelet.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace mapping_common {

/// A nodelet that starts with checked parameters or not at all, and reports every second.
class Nodelet : public nodelet::Nodelet {
 protected:
  using StatusWrapper = diagnostic_updater::DiagnosticStatusWrapper;

  /// Reads the parameters, sets all up and subscribes. No callback comes before it is done.
  /// @throws std::exception what it says is logged, and the nodelet isn't loaded. Nothing may be advertised
  ///   or subscribed before: a manager doesn't survive the end of a nodelet's publishers in a failed start
  virtual void start(Parameters& parameters) = 0;

  /// To be called by `start` once it has asked for all parameters: others are errors.
  /// @param except how the names start that somebody else reads
  void rejectUnknown(const Parameters& parameters, std::vector<std::string> except = {}) const;

  /// Lets parameters change while the nodelet runs, by rqt_reconfigure.
  /// @param config as it was started
  /// @param apply gets a changed one and its level; where it throws, having changed nothing, the one before
  ///   stays
  /// @param name_space under the nodelet's own
  template <class Config>
  void allowReconfiguration(const Config& config, std::function<void(const Config&, std::uint32_t)> apply,
                            const std::string& name_space = "reconfigure");

  /// Lets a struct's dynamic options change while the nodelet runs, by rqt_reconfigure.
  /// @param options as it was started
  /// @param apply gets changed ones that have been checked; where it throws, having changed nothing, those
  /// before stay
  /// @param name_space under the nodelet's own
  template <class Options>
  void allowReconfiguration(const Options& options, std::function<void(const Options&)> apply,
                            const std::string& name_space = "reconfigure");

  /// Begins to publish diagnostics, by name.
  void startDiagnostics(
      const std::string& hardware_id,
      const std::vector<std::pair<std::string, std::function<void(StatusWrapper&)>>>& reports);
  diagnostic_updater::Updater& diagnostics() { return *diagnostics_; }
  /// Called every second: publishes the diagnostics. Counts of what happened since the last ones end here.
  virtual void report();
  /// s, that the next report is about
  double reportedTime() const;

  /// Ends reconfiguration and reports: for the destructor, where they use what it destroys.
  void endCallbacks();

 private:
  void onInit() final;

  boost::recursive_mutex reconfigure_mutex_;
  std::shared_ptr<void> reconfigure_server_;  // of the nodelet's own type of configuration
  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;
  ros::WallTimer diagnostics_timer_;
  ros::WallTime last_report_;
};

template <class Config>
void Nodelet::allowReconfiguration(const Config& config,
                                   std::function<void(const Config&, std::uint32_t)> apply,
                                   const std::string& name_space) {
  const auto server = std::make_shared<dynamic_reconfigure::Server<Config>>(
      reconfigure_mutex_, ros::NodeHandle(getPrivateNodeHandle(), name_space));
  server->updateConfig(config);
  server->setCallback([this, accepted = config, apply](Config& changed, std::uint32_t level) mutable {
    try {
      apply(changed, level);
      accepted = changed;
    } catch (const std::exception& e) {
      NODELET_ERROR_STREAM("Reconfiguration rejected: " << e.what());
      changed = accepted;
    }
  });
  reconfigure_server_ = server;
}

template <class Options>
void Nodelet::allowReconfiguration(const Options& options, std::function<void(const Options&)> apply,
                                   const std::string& name_space) {
  using Config = Reconfiguration<Options>;
  allowReconfiguration<Config>(
      Config{options, ""},
      [apply](const Config& changed, std::uint32_t) {
        if (!changed.error.empty()) throw std::invalid_argument(changed.error);
        apply(validate(changed.options, "~"));
      },
      name_space);
}

/// Counts of messages that were dropped, by reason.
class DropCounts {
 public:
  /// @param reasons names, in the order of their numbers
  explicit DropCounts(std::vector<std::string> reasons);

  void add(std::size_t reason, std::size_t count = 1);
  /// Since the last call of `endReport`.
  std::size_t recent() const { return recent_; }
  void endReport() { recent_ = 0; }

  const std::string& name(std::size_t reason) const { return reasons_[reason]; }
  /// e.g. "3 no transform, 0 malformed"
  std::string text() const;
  /// One value for each reason, named e.g. "Dropped: malformed".
  void addTo(diagnostic_updater::DiagnosticStatusWrapper& status, const std::string& prefix) const;

 private:
  std::vector<std::string> reasons_;
  std::vector<std::size_t> counts_;
  std::size_t recent_ = 0;
};

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

}  // namespace mapping_common
