// SPDX-License-Identifier: BSD-3-Clause
//
// Detects loop closures in the images of a camera. Everything happens in the nodelet's single-threaded
// callback queue, so that nothing here needs a lock.
#include <cv_bridge/cv_bridge.h>
#include <ibuild_loop_closure/LoopClosureConfig.h>
#include <image_transport/image_transport.h>
#include <mapping_common/nodelet.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <message_filters/subscriber.h>
#include <message_filters/sync_policies/approximate_time.h>
#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>
#include <std_srvs/Empty.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <algorithm>
#include <array>
#include <functional>
#include <iomanip>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "ibuild_loop_closure/pictures.h"
#include "ibuild_loop_closure/ros/conversions.h"
#include "ibuild_loop_closure/ros/parameters.h"

namespace ibuild_loop_closure {
namespace {

// Why an image was dropped: the order of the names given to drops_.
enum Reason { kMalformed, kOutOfOrder, kNoTransform };

// Stamps may be out of order by this much before time is said to have jumped back.
const ros::Duration kJump(1.0);

constexpr int kThumbnailWidth = 320;  // pixels, of the debug image's halves

// What happened since the last diagnostics.
struct Activity {
  std::size_t images = 0, key_frames = 0;
  std::array<double, kStages> seconds = {};
  double longest = 0.0;
};

// Two topics whose messages belong together.
template <class Policy, class First, class Second>
class Synchronized {
 public:
  using FirstPtr = boost::shared_ptr<const First>;
  using SecondPtr = boost::shared_ptr<const Second>;
  using Callback = std::function<void(const FirstPtr&, const SecondPtr&)>;
  Synchronized(ros::NodeHandle node, const std::string& first_topic, const std::string& second_topic,
               std::uint32_t queue, Callback callback)
      : callback_(std::move(callback)),
        first_(node, first_topic, queue),
        second_(node, second_topic, queue),
        both_(Policy(queue), first_, second_) {
    both_.registerCallback(&Synchronized::arrived, this);
  }

 private:
  void arrived(const FirstPtr& first, const SecondPtr& second) { callback_(first, second); }
  Callback callback_;
  message_filters::Subscriber<First> first_;
  message_filters::Subscriber<Second> second_;
  message_filters::Synchronizer<Policy> both_;
};

}  // namespace

class LoopClosureNodelet : public mapping_common::Nodelet {
 public:
  ~LoopClosureNodelet() override;

 private:
  void start(mapping_common::Parameters& reader) override;
  void subscribe();
  template <class Message>
  void subscribePairs(const std::string& topic);
  template <class Message>
  void arrived(
      const boost::shared_ptr<const Message>& image,
      const std::function<void(Frame&)>& add_depth = [](Frame&) {});
  bool inOrder(const ros::Time& stamp);
  bool poseAt(const std_msgs::Header& header, std::optional<Eigen::Isometry3d>& pose);
  void process(const Frame& frame, const std_msgs::Header& header);
  void publish(const Loop& loop, const std_msgs::Header& header);
  void drop(Reason reason, const std::string& why);

  bool saveVocabulary(mapping_msgs::SaveMap::Request& request, mapping_msgs::SaveMap::Response& response);
  bool loadVocabulary(mapping_msgs::LoadMap::Request& request, mapping_msgs::LoadMap::Response& response);
  std::string load(const std::string& path);
  bool reset(std_srvs::Empty::Request&, std_srvs::Empty::Response&);
  void reconfigure(const LoopClosureConfig& config);
  void report() override;
  void diagnoseInput(StatusWrapper& status);
  void diagnoseLoops(StatusWrapper& status);

  LoopClosureParameters parameters_;
  std::unique_ptr<LoopDetector> detector_;
  KeyFrameSelector key_frames_;
  std::optional<Camera> camera_;
  sensor_msgs::CameraInfoConstPtr right_info_;
  // Of each image of the vocabulary; those that a file brought have stamp zero and no thumbnail.
  std::vector<ros::Time> stamps_;
  std::vector<std::vector<unsigned char>> thumbnails_;  // JPEG
  int loaded_ = 0;
  ros::Time last_stamp_;

  tf2_ros::Buffer tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<image_transport::ImageTransport> transport_;
  image_transport::Subscriber images_;
  ros::Subscriber camera_info_, right_camera_info_, compressed_images_;
  std::shared_ptr<void> pairs_;  // a Synchronized
  ros::Publisher loops_;
  image_transport::Publisher debug_images_;
  std::vector<ros::ServiceServer> services_;
  Activity activity_;
  mapping_common::DropCounts drops_{{"malformed", "out of order", "no transform"}};
  std::size_t accepted_ = 0, with_transform_ = 0;
};

LoopClosureNodelet::~LoopClosureNodelet() {
  if (!detector_ || parameters_.save_on_shutdown.empty() || detector_->images() == 0) return;
  try {
    detector_->save(parameters_.save_on_shutdown);
    NODELET_INFO_STREAM("Wrote " << detector_->images() << " images to " << parameters_.save_on_shutdown);
  } catch (const std::exception& e) {
    NODELET_ERROR_STREAM("The vocabulary is lost: " << e.what());
  }
}

void LoopClosureNodelet::start(mapping_common::Parameters& reader) {
  ros::NodeHandle& node = getNodeHandle();
  ros::NodeHandle& private_node = getPrivateNodeHandle();
  parameters_ = readLoopClosureParameters(reader);
  rejectUnknown(reader, {"debug_image/"});

  detector_ = std::make_unique<LoopDetector>(parameters_.detector);
  if (!parameters_.vocabulary_file.empty()) NODELET_INFO_STREAM(load(parameters_.vocabulary_file));
  key_frames_.options = parameters_.key_frames;

  loops_ = node.advertise<mapping_msgs::EdgeConstraint>("loop_closures", 100);
  transport_ = std::make_unique<image_transport::ImageTransport>(node);
  if (parameters_.debug_image) {
    debug_images_ = image_transport::ImageTransport(private_node).advertise("debug_image", 1);
  }
  LoopClosureConfig config;
  config.min_interval = parameters_.key_frames.min_interval;
  config.min_distance = parameters_.key_frames.min_distance;
  config.min_angle = parameters_.key_frames.min_angle;
  config.min_difference = parameters_.key_frames.min_difference;
  allowReconfiguration<LoopClosureConfig>(
      config, [this](const LoopClosureConfig& changed, std::uint32_t) { reconfigure(changed); });

  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(tf_buffer_, node, false);
  subscribe();
  services_ = {private_node.advertiseService("save_vocabulary", &LoopClosureNodelet::saveVocabulary, this),
               private_node.advertiseService("load_vocabulary", &LoopClosureNodelet::loadVocabulary, this),
               private_node.advertiseService("reset", &LoopClosureNodelet::reset, this)};

  startDiagnostics("none", {{"Input", [this](StatusWrapper& status) { diagnoseInput(status); }},
                            {"Loop closure", [this](StatusWrapper& status) { diagnoseLoops(status); }}});
}

// --------------------------------------------------------------------------------------------------- input

void LoopClosureNodelet::subscribe() {
  ros::NodeHandle& node = getNodeHandle();
  const int queue = parameters_.queue_size;
  // As image_transport names it; its plugin isn't everywhere, and unpacking takes none.
  const std::string compressed = node.resolveName("image") + "/compressed";
  const bool raw = parameters_.image_transport == "raw";
  camera_info_ = node.subscribe<sensor_msgs::CameraInfo>(
      "camera_info", 1, [this](const sensor_msgs::CameraInfoConstPtr& info) { camera_ = toCamera(*info); });
  const bool pairs = parameters_.use_depth || parameters_.use_stereo;
  if (pairs && raw) {
    subscribePairs<sensor_msgs::Image>("image");
  } else if (pairs) {
    subscribePairs<sensor_msgs::CompressedImage>(compressed);
  } else if (raw) {
    images_ = transport_->subscribe("image", queue,
                                    [this](const sensor_msgs::ImageConstPtr& image) { arrived(image); });
  } else {
    compressed_images_ = node.subscribe<sensor_msgs::CompressedImage>(
        compressed, queue, [this](const sensor_msgs::CompressedImageConstPtr& image) { arrived(image); });
  }
}

template <class Message>
void LoopClosureNodelet::subscribePairs(const std::string& topic) {
  using message_filters::sync_policies::ApproximateTime;
  using message_filters::sync_policies::ExactTime;
  if (parameters_.use_depth) {
    using Policy = ApproximateTime<Message, sensor_msgs::Image>;
    pairs_ = std::make_shared<Synchronized<Policy, Message, sensor_msgs::Image>>(
        getNodeHandle(), topic, "depth", parameters_.queue_size,
        [this](const boost::shared_ptr<const Message>& image, const sensor_msgs::ImageConstPtr& depth) {
          arrived(image, [&](Frame& frame) { frame.depth = toDepth(*depth); });
        });
  } else {  // stereo: both cameras are triggered together
    using Policy = ExactTime<Message, Message>;
    right_camera_info_ = getNodeHandle().subscribe<sensor_msgs::CameraInfo>(
        "right/camera_info", 1, [this](const sensor_msgs::CameraInfoConstPtr& info) { right_info_ = info; });
    const bool raw = parameters_.image_transport == "raw";
    const std::string right = getNodeHandle().resolveName("right/image") + (raw ? "" : "/compressed");
    pairs_ = std::make_shared<Synchronized<Policy, Message, Message>>(
        getNodeHandle(), topic, right, parameters_.queue_size,
        [this](const boost::shared_ptr<const Message>& image,
               const boost::shared_ptr<const Message>& right_image) {
          arrived(image, [&](Frame& frame) {
            if (right_info_) frame.right = toRightImage(toImage(*right_image), *right_info_);
          });
        });
  }
}

template <class Message>
void LoopClosureNodelet::arrived(const boost::shared_ptr<const Message>& image,
                                 const std::function<void(Frame&)>& add_depth) {
  ++activity_.images;
  const std_msgs::Header& header = image->header;
  if (!inOrder(header.stamp)) return;
  try {
    Frame frame;
    frame.image = toImage(*image);
    std::optional<Eigen::Isometry3d> pose;
    if (!poseAt(header, pose)) return;
    if (!key_frames_.select(header.stamp.toSec(), pose, frame.image)) return;
    add_depth(frame);
    frame.camera = camera_;
    process(frame, header);
  } catch (const std::exception& e) {
    drop(kMalformed, e.what());
  }
}

bool LoopClosureNodelet::inOrder(const ros::Time& stamp) {
  if (stamp + kJump < last_stamp_) {
    NODELET_WARN_STREAM("Time jumped back by " << last_stamp_ - stamp << " s: the vocabulary goes on");
    if (!ros::Time::isSimTime()) tf_buffer_.clear();
    detector_->breakSequence();
    key_frames_.reset();
  } else if (stamp < last_stamp_) {
    drop(kOutOfOrder, "its stamp is earlier than that of the image before");
    return false;
  }
  last_stamp_ = stamp;
  return true;
}

// The latest pose: key frames need no better.
bool LoopClosureNodelet::poseAt(const std_msgs::Header& header, std::optional<Eigen::Isometry3d>& pose) {
  if (!key_frames_.options.needsMotion()) return true;
  try {
    pose = tf2::transformToEigen(
        tf_buffer_.lookupTransform(parameters_.fixed_frame, header.frame_id, ros::Time(0)));
    return true;
  } catch (const tf2::TransformException& e) {
    drop(kNoTransform, e.what());
    return false;
  }
}

void LoopClosureNodelet::process(const Frame& frame, const std_msgs::Header& header) {
  const ros::WallTime start = ros::WallTime::now();
  ros::WallTime last = start;
  const Detection detection = detector_->process(frame, [&](Stage stage) {
    const ros::WallTime now = ros::WallTime::now();
    activity_.seconds[static_cast<int>(stage)] += (now - last).toSec();
    last = now;
  });
  ++activity_.key_frames;
  activity_.longest = std::max(activity_.longest, (last - start).toSec());
  stamps_.push_back(header.stamp);
  thumbnails_.emplace_back();
  if (parameters_.debug_image) {
    cv::Mat grey = frame.image, small;
    if (grey.depth() != CV_8U) cv::normalize(grey, grey, 0, 255, cv::NORM_MINMAX, CV_8U);
    const double factor = std::min(1.0, static_cast<double>(kThumbnailWidth) / grey.cols);
    cv::resize(grey, small, {}, factor, factor, cv::INTER_AREA);
    cv::imencode(".jpg", small, thumbnails_.back());
  }
  if (detection.accepted) publish(*detection.best, header);
}

void LoopClosureNodelet::publish(const Loop& loop, const std_msgs::Header& header) {
  ++accepted_;
  with_transform_ += loop.geometry.pose.has_value();
  loops_.publish(toEdge(loop, header, stamps_[loop.match], loop.match < loaded_));
  if (!parameters_.debug_image || debug_images_.getNumSubscribers() == 0 || thumbnails_[loop.match].empty())
    return;
  const cv::Mat query = cv::imdecode(thumbnails_[loop.query], cv::IMREAD_GRAYSCALE);
  const cv::Mat match = cv::imdecode(thumbnails_[loop.match], cv::IMREAD_GRAYSCALE);
  std::vector<std::pair<cv::Point2f, cv::Point2f>> points;
  if (parameters_.detector.geometric_check) {
    const View &q = detector_->view(loop.query), &m = detector_->view(loop.match);
    for (const Match& pair : loop.geometry.pairs) {
      points.emplace_back(q.features.points[pair.a] * (static_cast<float>(query.cols) / q.size.width),
                          m.features.points[pair.b] * (static_cast<float>(match.cols) / m.size.width));
    }
  }
  std::ostringstream caption;
  caption << "image " << loop.match << " (left) and " << loop.query << " (right), similarity "
          << std::setprecision(2) << loop.similarity;
  debug_images_.publish(
      cv_bridge::CvImage(header, "bgr8", drawPair(query, match, points, caption.str())).toImageMsg());
}

void LoopClosureNodelet::drop(Reason reason, const std::string& why) {
  drops_.add(reason);
  NODELET_WARN_STREAM_THROTTLE(
      5.0, "Dropped an image (" << drops_.name(reason) << "): " << why << ". So far: " << drops_.text());
}

// ------------------------------------------------------------------------------------------------ services

bool LoopClosureNodelet::saveVocabulary(mapping_msgs::SaveMap::Request& request,
                                        mapping_msgs::SaveMap::Response& response) {
  mapping_common::answer(request.path, response, [&] {
    detector_->save(request.path);
    return "Wrote " + std::to_string(detector_->vocabulary().size()) + " words of " +
           std::to_string(detector_->images()) + " images to " + request.path;
  });
  return true;
}

bool LoopClosureNodelet::loadVocabulary(mapping_msgs::LoadMap::Request& request,
                                        mapping_msgs::LoadMap::Response& response) {
  mapping_common::answer(request.path, response, [&] { return load(request.path); });
  return true;
}

std::string LoopClosureNodelet::load(const std::string& path) {
  detector_->load(path);
  loaded_ = detector_->images();
  stamps_.assign(loaded_, ros::Time());
  thumbnails_.assign(loaded_, {});
  key_frames_.reset();
  return "Read " + std::to_string(detector_->vocabulary().size()) + " words of " + std::to_string(loaded_) +
         " images from " + path + ". Its delta and index replace those of the parameters";
}

bool LoopClosureNodelet::reset(std_srvs::Empty::Request&, std_srvs::Empty::Response&) {
  detector_ = std::make_unique<LoopDetector>(parameters_.detector);
  stamps_.clear();
  thumbnails_.clear();
  loaded_ = 0;
  key_frames_.reset();
  return true;
}

// ------------------------------------------------------------------------------------------- while it runs

void LoopClosureNodelet::reconfigure(const LoopClosureConfig& config) {
  KeyFrameOptions& options = key_frames_.options;
  options.min_interval = config.min_interval;
  options.min_distance = config.min_distance;
  options.min_angle = config.min_angle;
  options.min_difference = config.min_difference;
}

void LoopClosureNodelet::report() {
  Nodelet::report();
  drops_.endReport();
  activity_ = {};
}

void LoopClosureNodelet::diagnoseInput(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const double seconds = reportedTime();
  if (drops_.recent() > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu images dropped", drops_.recent());
  } else {
    status.summary(DiagnosticStatus::OK, activity_.images > 0 ? "Images" : "No input");
  }
  status.addf("Images (Hz)", "%.1f", static_cast<double>(activity_.images) / seconds);
  status.addf("Key frames (Hz)", "%.1f", static_cast<double>(activity_.key_frames) / seconds);
  drops_.addTo(status, "Dropped");
  status.add("Camera calibrated", camera_.has_value());
  if (parameters_.use_stereo) status.add("Right camera calibrated", right_info_ != nullptr);
}

void LoopClosureNodelet::diagnoseLoops(StatusWrapper& status) {
  status.summaryf(diagnostic_msgs::DiagnosticStatus::OK, "%zu loops", accepted_);
  status.add("Key frames", detector_->images());
  status.add("Words", detector_->vocabulary().size());
  status.add("Loops", accepted_);
  status.add("Loops with a transform", with_transform_);
  const double count = std::max<std::size_t>(1, activity_.key_frames);
  for (int s = 0; s < kStages; ++s) {
    status.addf(std::string(stageName(static_cast<Stage>(s))) + ", mean (ms)", "%.2f",
                1e3 * activity_.seconds[s] / count);
  }
  status.addf("Longest (ms)", "%.2f", 1e3 * activity_.longest);
}

}  // namespace ibuild_loop_closure

PLUGINLIB_EXPORT_CLASS(ibuild_loop_closure::LoopClosureNodelet, nodelet::Nodelet)
