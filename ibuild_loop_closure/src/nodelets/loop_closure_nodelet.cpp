// SPDX-License-Identifier: BSD-3-Clause
//
// Detects loop closures in the images of a camera. Everything happens in the nodelet's single-threaded
// callback queue, so that nothing here needs a lock.
#include <cv_bridge/cv_bridge.h>
#include <image_transport/image_transport.h>
#include <mapping_common/arrivals.h>
#include <mapping_common/nodelet.h>
#include <mapping_msgs/EdgeConstraint.h>
#include <mapping_msgs/LoadMap.h>
#include <mapping_msgs/SaveMap.h>
#include <message_filters/sync_policies/approximate_time.h>
#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>
#include <std_srvs/Empty.h>

#include <algorithm>
#include <array>
#include <functional>
#include <iomanip>
#include <map>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "ibuild_loop_closure/pictures.h"
#include "ibuild_loop_closure/ros/conversions.h"
#include "ibuild_loop_closure/ros/parameters.h"

namespace ibuild_loop_closure {
namespace {

using mapping_common::Arrivals;

constexpr const char* kImages = "image";       // what Arrivals calls the sensor
constexpr int kThumbnailWidth = 320;           // pixels, of the debug image's halves
constexpr std::size_t kMostThumbnails = 2000;  // that are kept, of about 10 kB each
constexpr std::size_t kMostWaiting = 100;      // images, for transforms where stamps don't go on

std::string toText(const ros::Time& stamp) {
  std::ostringstream text;
  text << stamp << " s";
  return text.str();
}

// What happened since the last diagnostics.
struct Activity {
  std::size_t key_frames = 0;
  std::array<double, kStages> seconds = {};
  double longest = 0.0;
};

// Messages of two topics that belong together. Their stamps must be in order.
template <class Policy, class First, class Second>
class Synchronized {
 public:
  using FirstPtr = boost::shared_ptr<const First>;
  using SecondPtr = boost::shared_ptr<const Second>;
  using Callback = std::function<void(const FirstPtr&, const SecondPtr&)>;
  Synchronized(int queue, Callback callback) : queue_(queue), callback_(std::move(callback)) { restart(); }

  void addFirst(const FirstPtr& first) { add<0>(ros::MessageEvent<const First>(first)); }
  void addSecond(const SecondPtr& second) { add<1>(ros::MessageEvent<const Second>(second)); }
  // Forgets those that wait for their like.
  void restart() {
    both_ = std::make_unique<message_filters::Synchronizer<Policy>>(Policy(queue_));
    both_->registerCallback(&Synchronized::arrived, this);
  }

 private:
  // It throws where stamps differ by more than half a century, and doesn't recover by itself.
  template <int I, class Event>
  void add(const Event& event) {
    try {
      both_->template add<I>(event);
    } catch (const std::runtime_error&) {
      restart();
      throw;
    }
  }
  void arrived(const FirstPtr& first, const SecondPtr& second) { callback_(first, second); }
  int queue_;
  Callback callback_;
  std::unique_ptr<message_filters::Synchronizer<Policy>> both_;
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
  void pair(const std::string& sensor, const std::string& label, const std_msgs::Header& header,
            const std::function<void()>& add);
  template <class Policy, class First, class Second>
  void subscribePair(const std::string& first_topic, const std::string& second_topic,
                     typename Synchronized<Policy, First, Second>::Callback arrived);
  template <class Message>
  void arrived(
      const boost::shared_ptr<const Message>& image,
      const std::function<void(Frame&)>& add_depth = [](Frame&) {});
  void process(const Frame& frame, const std_msgs::Header& header);
  void keepThumbnail(int image, const cv::Mat& grey);
  void publish(const Loop& loop, const std_msgs::Header& header);
  void publishDebugImage(const Loop& loop, const std_msgs::Header& header);

  void offerServices();
  std::string load(const std::string& path);
  void reset();
  void report() override;
  void diagnoseInput(StatusWrapper& status);
  void diagnoseLoops(StatusWrapper& status);

  LoopClosureParameters parameters_;
  std::unique_ptr<LoopDetector> detector_;
  KeyFrameSelector key_frames_;
  std::optional<Camera> camera_;
  sensor_msgs::CameraInfoConstPtr right_info_;
  std::vector<ros::Time> stamps_;  // of each image of the vocabulary; zero of those that a file brought
  std::map<int, std::vector<unsigned char>> thumbnails_;  // JPEG, of the last images, for who listens
  int loaded_ = 0;

  std::unique_ptr<Arrivals> arrivals_;
  std::unique_ptr<image_transport::ImageTransport> transport_;
  image_transport::Subscriber images_;
  ros::Subscriber camera_info_, right_camera_info_, compressed_images_;
  ros::Subscriber first_, second_;  // of pairs
  std::function<void()> restart_pairs_ = [] {};
  ros::Publisher loops_;
  image_transport::Publisher debug_images_;
  Activity activity_;
  std::size_t accepted_ = 0, with_transform_ = 0;
};

LoopClosureNodelet::~LoopClosureNodelet() {
  endCallbacks();
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
  mapping_common::requireOwnEnding(parameters_.save_on_shutdown);

  detector_ = std::make_unique<LoopDetector>(parameters_.detector);
  if (!parameters_.vocabulary_file.empty()) NODELET_INFO_STREAM(load(parameters_.vocabulary_file));
  key_frames_.options = parameters_.key_frames;

  loops_ = node.advertise<mapping_msgs::EdgeConstraint>("loop_closures", 100);
  transport_ = std::make_unique<image_transport::ImageTransport>(node);
  if (parameters_.debug_image) {
    debug_images_ = image_transport::ImageTransport(private_node).advertise("debug_image", 1);
  }
  allowReconfiguration<LoopClosureParameters>(parameters_, [this](const LoopClosureParameters& changed) {
    key_frames_.options = changed.key_frames;
  });

  subscribe();
  offerServices();
  startDiagnostics("none", {{"Input", [this](StatusWrapper& status) { diagnoseInput(status); }},
                            {"Loop closure", [this](StatusWrapper& status) { diagnoseLoops(status); }}});
}

// --------------------------------------------------------------------------------------------------- input

void LoopClosureNodelet::subscribe() {
  ros::NodeHandle& node = getNodeHandle();
  Arrivals::Options options;
  options.drops.name = getName();
  options.drops.warning = "Dropped an image";
  options.in_order = true;
  if (key_frames_.options.needsMotion()) options.transforms.target_frame = parameters_.fixed_frame;
  options.transforms.timeout = parameters_.transform_timeout;
  options.transforms.most = kMostWaiting;
  arrivals_ = std::make_unique<Arrivals>(node, guard(), options, [this](const ros::Time&) {
    restart_pairs_();
    detector_->breakSequence();
    key_frames_.reset();
  });
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
    images_ = transport_->subscribe("image", queue, [this](const sensor_msgs::ImageConstPtr& image) {
      if (arrivals_->accept(kImages, "Images", image->header)) arrived(image);
    });
  } else {
    compressed_images_ = node.subscribe<sensor_msgs::CompressedImage>(
        compressed, queue, [this](const sensor_msgs::CompressedImageConstPtr& image) {
          if (arrivals_->accept(kImages, "Images", image->header)) arrived(image);
        });
  }
}

template <class Message>
void LoopClosureNodelet::subscribePairs(const std::string& topic) {
  using message_filters::sync_policies::ApproximateTime;
  using message_filters::sync_policies::ExactTime;
  using MessagePtr = boost::shared_ptr<const Message>;
  if (parameters_.use_depth) {
    subscribePair<ApproximateTime<Message, sensor_msgs::Image>, Message, sensor_msgs::Image>(
        topic, "depth", [this](const MessagePtr& image, const sensor_msgs::ImageConstPtr& depth) {
          arrived(image, [depth](Frame& frame) { frame.depth = toDepth(*depth); });
        });
  } else {  // stereo: both cameras are triggered together
    right_camera_info_ = getNodeHandle().subscribe<sensor_msgs::CameraInfo>(
        "right/camera_info", 1, [this](const sensor_msgs::CameraInfoConstPtr& info) { right_info_ = info; });
    const bool raw = parameters_.image_transport == "raw";
    subscribePair<ExactTime<Message, Message>, Message, Message>(
        topic, getNodeHandle().resolveName("right/image") + (raw ? "" : "/compressed"),
        [this](const MessagePtr& image, const MessagePtr& right_image) {
          arrived(image, [this, right_image](Frame& frame) {
            if (right_info_) frame.right = toRightImage(toImage(*right_image), *right_info_);
          });
        });
  }
}

template <class Policy, class First, class Second>
void LoopClosureNodelet::subscribePair(const std::string& first_topic, const std::string& second_topic,
                                       typename Synchronized<Policy, First, Second>::Callback arrived) {
  const auto pairs =
      std::make_shared<Synchronized<Policy, First, Second>>(parameters_.queue_size, std::move(arrived));
  restart_pairs_ = [pairs] { pairs->restart(); };
  ros::NodeHandle& node = getNodeHandle();
  first_ = node.subscribe<First>(first_topic, parameters_.queue_size,
                                 [this, pairs](const boost::shared_ptr<const First>& first) {
                                   pair(kImages, "Images", first->header, [&] { pairs->addFirst(first); });
                                 });
  second_ = node.subscribe<Second>(
      second_topic, parameters_.queue_size, [this, pairs](const boost::shared_ptr<const Second>& second) {
        pair("second", "Second images", second->header, [&] { pairs->addSecond(second); });
      });
}

void LoopClosureNodelet::pair(const std::string& sensor, const std::string& label,
                              const std_msgs::Header& header, const std::function<void()>& add) {
  if (!arrivals_->accept(sensor, label, header)) return;
  try {
    add();
  } catch (const std::runtime_error& e) {
    arrivals_->drops().add(Arrivals::kMalformed,
                           std::string("its stamp is too far from those of the other topic: ") + e.what());
  }
}

template <class Message>
void LoopClosureNodelet::arrived(const boost::shared_ptr<const Message>& image,
                                 const std::function<void(Frame&)>& add_depth) {
  arrivals_->add(kImages, image->header, [=](const Arrivals::Transforms& transforms) {
    Frame frame;
    frame.image = toImage(*image);
    std::optional<Eigen::Isometry3d> pose;
    if (key_frames_.options.needsMotion()) pose = transforms.message;
    if (!key_frames_.select(image->header.stamp.toSec(), pose, frame.image)) return;
    add_depth(frame);
    frame.camera = camera_;
    process(frame, image->header);
  });
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
  stamps_.resize(detection.image + 1);
  stamps_.back() = header.stamp;
  if (parameters_.debug_image && debug_images_.getNumSubscribers() > 0)
    keepThumbnail(detection.image, frame.image);
  for (const Loop& loop : detection.earlier) {
    std_msgs::Header of_query = header;
    of_query.stamp = stamps_[loop.query];
    publish(loop, of_query);
  }
  if (detection.accepted) publish(*detection.best, header);
}

void LoopClosureNodelet::keepThumbnail(int image, const cv::Mat& grey) {
  const int width = std::min(kThumbnailWidth, grey.cols);
  cv::Mat small;
  cv::resize(grey, small, {width, std::max(1, grey.rows * width / grey.cols)}, 0.0, 0.0, cv::INTER_AREA);
  cv::imencode(".jpg", small, thumbnails_[image]);
  if (thumbnails_.size() > kMostThumbnails) thumbnails_.erase(thumbnails_.begin());
}

void LoopClosureNodelet::publish(const Loop& loop, const std_msgs::Header& header) {
  const bool has_transform = loop.geometry.pose.has_value(), other_run = loop.match < loaded_;
  ++accepted_;
  with_transform_ += has_transform;
  NODELET_INFO_STREAM("Loop " << accepted_ << ": image " << loop.query << " (" << header.stamp
                              << " s) shows the place of image " << loop.match << " ("
                              << (other_run ? "of the file" : toText(stamps_[loop.match])) << "), similarity "
                              << loop.similarity
                              << (has_transform ? ", with a transform" : ", without a transform"));
  loops_.publish(toEdge(loop, header, stamps_[loop.match], other_run));
  if (parameters_.debug_image && debug_images_.getNumSubscribers() > 0) publishDebugImage(loop, header);
}

// Where somebody has listened since the match was seen.
void LoopClosureNodelet::publishDebugImage(const Loop& loop, const std_msgs::Header& header) {
  if (thumbnails_.count(loop.query) == 0 || thumbnails_.count(loop.match) == 0) return;
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

// ------------------------------------------------------------------------------------------------ services

void LoopClosureNodelet::offerServices() {
  serveFile<mapping_msgs::SaveMap>("save_vocabulary", [this](const std::string& path) {
    mapping_common::requireOwnEnding(path);
    detector_->save(path);
    return "Wrote " + std::to_string(detector_->vocabulary().size()) + " words of " +
           std::to_string(detector_->images()) + " images to " + path;
  });
  serveFile<mapping_msgs::LoadMap>("load_vocabulary", [this](const std::string& path) { return load(path); });
  serve<std_srvs::Empty>(getPrivateNodeHandle(), "reset", [this](auto&, auto&) { reset(); });
}

std::string LoopClosureNodelet::load(const std::string& path) {
  detector_->load(path);
  loaded_ = detector_->images();
  stamps_.assign(loaded_, ros::Time());
  thumbnails_.clear();
  key_frames_.reset();
  return "Read " + std::to_string(detector_->vocabulary().size()) + " words of " + std::to_string(loaded_) +
         " images from " + path + ". Its delta and index replace those of the parameters";
}

void LoopClosureNodelet::reset() {
  detector_ = std::make_unique<LoopDetector>(parameters_.detector);
  stamps_.clear();
  thumbnails_.clear();
  loaded_ = 0;
  key_frames_.reset();
}

// ------------------------------------------------------------------------------------------- while it runs

void LoopClosureNodelet::report() {
  Nodelet::report();
  arrivals_->endReport();
  activity_ = {};
}

void LoopClosureNodelet::diagnoseInput(StatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const double seconds = reportedTime();
  const std::size_t dropped = arrivals_->drops().recent(), waiting = arrivals_->queue().waiting();
  if (dropped > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu images dropped", dropped);
  } else if (activity_.key_frames == 0 && waiting > 0) {
    status.summaryf(DiagnosticStatus::WARN, "%zu images wait for a transform to %s", waiting,
                    parameters_.fixed_frame.c_str());
  } else {
    status.summary(DiagnosticStatus::OK, arrivals_->recent() > 0 ? "Images" : "No input");
  }
  arrivals_->addTo(status, seconds);
  status.addf("Key frames (Hz)", "%.1f", static_cast<double>(activity_.key_frames) / seconds);
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
