// SPDX-License-Identifier: BSD-3-Clause
//
// Recognises places in the clouds of a 3D scanner, or in its panoramas. Everything happens in the nodelet's
// single-threaded callback queue, so that nothing here needs a lock.
#include <cv_bridge/cv_bridge.h>
#include <mapping_common/arrivals.h>
#include <mapping_common/nodelet.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Empty.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iomanip>
#include <iterator>
#include <map>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "intensity_place_recognition/pictures.h"
#include "intensity_place_recognition/ros/conversions.h"
#include "intensity_place_recognition/ros/parameters.h"

namespace intensity_place_recognition {
namespace {

using mapping_common::Arrivals;

constexpr const char* kUnpaired = "unpaired";
constexpr std::size_t kMostPictures = 500;  // that are kept, of some 50 kB each

// What happened since the last diagnostics.
struct Activity {
  std::size_t scans = 0;
  std::array<double, kStages> seconds = {};
  double longest = 0.0;
};

}  // namespace

class PlaceRecognitionNodelet : public mapping_common::Nodelet {
 public:
  ~PlaceRecognitionNodelet() override;

 private:
  void start(mapping_common::Parameters& reader) override;
  void subscribeImages();
  void arrived(const std_msgs::Header& header, const std::function<Cloud()>& points);
  void publish(const Recognition& recognition, std::uint32_t query, const std_msgs::Header& header);
  std::string load(const std::string& path);
  void reset();
  void report() override;
  void diagnoseInput(StatusWrapper& status);
  void diagnosePlaces(StatusWrapper& status);

  PlaceRecognitionParameters parameters_;
  std::unique_ptr<PlaceRecognizer> recognizer_;
  std::vector<Origin> origins_;  // of each place
  std::uint32_t scans_ = 0;      // places of a file count as one each
  ros::Time last_;
  std::map<std::uint32_t, cv::Mat1b> pictures_;  // of the last clouds, while somebody listens

  std::unique_ptr<Arrivals> arrivals_;
  ros::Subscriber clouds_, intensity_subscriber_, range_subscriber_;
  using Images = std::map<ros::Time, sensor_msgs::ImageConstPtr>;
  Images intensities_, ranges_;  // that wait for those of the other topic
  ros::Publisher places_, debug_images_;
  Activity activity_;
  std::size_t accepted_ = 0;
};

PlaceRecognitionNodelet::~PlaceRecognitionNodelet() {
  endCallbacks();
  if (!recognizer_ || parameters_.save_on_shutdown.empty() || recognizer_->places() == 0) return;
  try {
    recognizer_->save(parameters_.save_on_shutdown);
    NODELET_INFO_STREAM("Wrote " << recognizer_->places() << " places to " << parameters_.save_on_shutdown);
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("The places are lost: " << e.what());
  }
}

void PlaceRecognitionNodelet::start(mapping_common::Parameters& reader) {
  ros::NodeHandle &node = getNodeHandle(), &private_node = getPrivateNodeHandle();
  reader.read(parameters_);
  mapping_common::requireOwnEnding(parameters_.save_on_shutdown);
  recognizer_ = std::make_unique<PlaceRecognizer>(parameters_.recognizer);
  if (!parameters_.database_file.empty()) NODELET_INFO_STREAM(load(parameters_.database_file));

  places_ = node.advertise<mapping_msgs::EdgeConstraint>("places", 100);
  if (parameters_.debug_image) debug_images_ = private_node.advertise<sensor_msgs::Image>("debug_image", 1);
  allowReconfiguration<PlaceRecognitionParameters>(parameters_,
                                                   [this](const PlaceRecognitionParameters& changed) {
                                                     parameters_.min_interval = changed.min_interval;
                                                     parameters_.same_place = changed.same_place;
                                                     recognizer_->setThresholds(changed.recognizer);
                                                   });
  Arrivals::Options options;
  options.drops.name = getName();
  options.drops.warning = "Dropped a scan";
  options.drops.reasons = {kUnpaired};
  options.in_order = true;
  arrivals_ = std::make_unique<Arrivals>(node, guard(), options, [this](const ros::Time&) {
    last_ = ros::Time();
    intensities_.clear();
    ranges_.clear();
  });
  if (parameters_.input == Input::kImages) {
    subscribeImages();
  } else {
    clouds_ = arrivals_->subscribe<sensor_msgs::PointCloud2>(
        "cloud", parameters_.queue_size, "Clouds",
        [this](const sensor_msgs::PointCloud2& cloud, const Arrivals::Transforms&) {
          arrived(cloud.header, [&] { return toCloud(cloud, parameters_.intensity_field); });
        });
  }

  serveFile<mapping_msgs::SaveMap>("save_places", [this](const std::string& path) {
    mapping_common::requireOwnEnding(path);
    recognizer_->save(path);
    return "Wrote " + std::to_string(recognizer_->places()) + " places to " + path;
  });
  serveFile<mapping_msgs::LoadMap>("load_places", [this](const std::string& path) { return load(path); });
  serve<std_srvs::Empty>(private_node, "reset", [this](auto&, auto&) { reset(); });
  startDiagnostics("none", {{"Input", [this](StatusWrapper& status) { diagnoseInput(status); }},
                            {"Places", [this](StatusWrapper& status) { diagnosePlaces(status); }}});
}

void PlaceRecognitionNodelet::subscribeImages() {
  const auto subscribe = [this](const std::string& topic, const std::string& label, Images& own) {
    return getNodeHandle().subscribe<sensor_msgs::Image>(
        topic, parameters_.queue_size, [this, topic, label, &own](const sensor_msgs::ImageConstPtr& image) {
          const ros::Time stamp = image->header.stamp;
          if (!arrivals_->accept(topic, label, image->header)) return;
          own[stamp] = image;
          const auto intensity = intensities_.find(stamp), range = ranges_.find(stamp);
          if (intensity == intensities_.end() || range == ranges_.end()) {
            if (own.size() <= static_cast<std::size_t>(parameters_.queue_size)) return;
            own.erase(own.begin());
            return arrivals_->drops().add(kUnpaired,
                                          "no image of the other topic has the stamp of one of " + topic);
          }
          const auto first = intensity->second, second = range->second;
          intensities_.erase(intensities_.begin(), std::next(intensity));
          ranges_.erase(ranges_.begin(), std::next(range));
          arrivals_->add("pair", first->header, [this, first, second](const Arrivals::Transforms&) {
            arrived(first->header, [&] {
              return toCloud(*first, *second, parameters_.range_unit, parameters_.recognizer.panorama);
            });
          });
        });
  };
  intensity_subscriber_ = subscribe("image", "Images", intensities_);
  range_subscriber_ = subscribe("range_image", "Range images", ranges_);
}

void PlaceRecognitionNodelet::arrived(const std_msgs::Header& header, const std::function<Cloud()>& points) {
  const ros::Time stamp = header.stamp;
  if (!last_.isZero() && (stamp - last_).toSec() < parameters_.min_interval) return;
  const Cloud cloud = points();
  const ros::WallTime start = ros::WallTime::now();
  ros::WallTime last = start;
  const auto done = [&](Stage stage) {
    const ros::WallTime now = ros::WallTime::now();
    activity_.seconds[static_cast<std::size_t>(stage)] += (now - last).toSec();
    last = now;
  };
  Place place = recognizer_->describe(cloud, done);
  const Recognition result = recognizer_->recognize(place, recognizer_->places(), done);
  last_ = stamp;
  ++activity_.scans;
  activity_.longest = std::max(activity_.longest, (last - start).toSec());
  const std::uint32_t number = scans_++;
  if (!result.registration.accepted ||
      !(result.registration.pose.translation().norm() < parameters_.same_place)) {
    recognizer_->add(std::move(place));
    origins_.push_back({number, stamp});
  }
  if (parameters_.debug_image && debug_images_.getNumSubscribers() > 0) {
    const PlaceRecognizerOptions& options = recognizer_->options();
    pictures_[number] = toPicture(toPanorama(cloud, options.panorama, options.largest_hole));
    if (pictures_.size() > kMostPictures) pictures_.erase(pictures_.begin());
  }
  if (result.registration.accepted) publish(result, number, header);
  for (const Recognition& other : result.others) publish(other, number, header);
}

void PlaceRecognitionNodelet::publish(const Recognition& recognition, std::uint32_t query,
                                      const std_msgs::Header& header) {
  ++accepted_;
  const Origin& from = origins_.at(recognition.match);
  std::ostringstream text;
  text << "cloud " << query << " shows the place of ";
  if (from.stamp.isZero())
    text << "place " << from.cloud << " of the file";
  else
    text << "cloud " << from.cloud << " (" << from.stamp << " s)";
  text << ", score " << std::setprecision(2) << recognition.registration.score;
  NODELET_INFO_STREAM("Place " << accepted_ << ": " << text.str());
  places_.publish(toEdge(recognition.registration, from, query, header));
  if (pictures_.count(query) == 0 || pictures_.count(from.cloud) == 0) return;
  const Eigen::Matrix3d rotation = recognition.registration.pose.rotation();
  debug_images_.publish(cv_bridge::CvImage(header, "bgr8",
                                           drawPlaces(pictures_[query], pictures_[from.cloud],
                                                      std::atan2(rotation(1, 0), rotation(0, 0)), text.str()))
                            .toImageMsg());
}

std::string PlaceRecognitionNodelet::load(const std::string& path) {
  recognizer_->load(path);
  origins_.resize(recognizer_->places());
  for (scans_ = 0; scans_ < origins_.size(); ++scans_) origins_[scans_] = {scans_, ros::Time()};
  pictures_.clear();
  last_ = ros::Time();
  return "Read " + std::to_string(recognizer_->places()) + " places from " + path;
}

void PlaceRecognitionNodelet::reset() {
  recognizer_ = std::make_unique<PlaceRecognizer>(recognizer_->options());
  origins_.clear();
  scans_ = 0;
  pictures_.clear();
  last_ = ros::Time();
}

void PlaceRecognitionNodelet::report() {
  Nodelet::report();
  arrivals_->endReport();
  activity_ = {};
}

void PlaceRecognitionNodelet::diagnoseInput(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::size_t dropped = arrivals_->drops().recent();
  if (dropped > 0)
    status.summaryf(DiagnosticStatus::WARN, "%zu scans dropped", dropped);
  else
    status.summary(DiagnosticStatus::OK, arrivals_->recent() > 0 ? "Scans" : "No input");
  arrivals_->addTo(status, reportedTime());
}

void PlaceRecognitionNodelet::diagnosePlaces(StatusWrapper& status) {
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%zu recognised", accepted_);
  status.add("Places", recognizer_->places());
  status.add("Recognised", accepted_);
  const double count = static_cast<double>(std::max<std::size_t>(1, activity_.scans));
  for (int s = 0; s < kStages; ++s)
    status.addf(std::string(stageName(static_cast<Stage>(s))) + ", mean (ms)", "%.2f",
                1e3 * activity_.seconds[static_cast<std::size_t>(s)] / count);
  status.addf("Longest (ms)", "%.2f", 1e3 * activity_.longest);
}

}  // namespace intensity_place_recognition

PLUGINLIB_EXPORT_CLASS(intensity_place_recognition::PlaceRecognitionNodelet, nodelet::Nodelet)
