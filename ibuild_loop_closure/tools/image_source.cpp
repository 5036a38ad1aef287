// SPDX-License-Identifier: BSD-3-Clause
#include "image_source.h"

#include <cv_bridge/cv_bridge.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <stdexcept>

namespace ibuild_loop_closure {
namespace {

namespace fs = std::filesystem;

// The last number in a file's name, -1 without one.
long numberIn(const fs::path& file) {
  const std::string stem = file.stem().string();
  const auto last = stem.find_last_of("0123456789");
  if (last == std::string::npos) return -1;
  const auto before = stem.find_last_not_of("0123456789", last);
  const std::string digits = stem.substr(before == std::string::npos ? 0 : before + 1, last - before);
  return digits.size() > 9 ? -1 : std::stol(digits);
}

bool isImage(const fs::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), ::tolower);
  static const std::set<std::string> known = {".jpg", ".jpeg", ".png", ".ppm",
                                              ".pgm", ".bmp",  ".tif", ".tiff"};
  return known.count(extension) > 0;
}

std::vector<int> counted(std::size_t count) {
  std::vector<int> ids(count);
  std::iota(ids.begin(), ids.end(), 0);
  return ids;
}

class Folders : public ImageSource {
 public:
  Folders(const std::vector<std::string>& folders, const std::vector<std::string>& right) {
    if (!right.empty()) {
      right_ = std::make_unique<Folders>(right, std::vector<std::string>());
    }
    for (const std::string& folder : folders) {
      if (!fs::is_directory(folder)) throw std::runtime_error("there is no folder " + folder);
      std::vector<fs::path> files;
      for (const auto& entry : fs::directory_iterator(folder)) {
        if (isImage(entry.path())) files.push_back(entry.path());
      }
      if (files.empty()) throw std::runtime_error(folder + " holds no image");
      std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
        const long i = numberIn(a), j = numberIn(b);
        return i != j ? i < j : a < b;
      });
      lengths_.push_back(static_cast<int>(files.size()));
      files_.insert(files_.end(), files.begin(), files.end());
    }
    if (right_ && right_->lengths() != lengths_)
      throw std::runtime_error("the folders of left and right images don't hold equal numbers of images");
  }
  std::size_t size() const override { return files_.size(); }
  cv::Mat image(std::size_t index) const override {
    cv::Mat image = cv::imread(files_[index].string(), cv::IMREAD_GRAYSCALE);
    if (image.empty()) throw std::runtime_error(files_[index].string() + " can't be read");
    return image;
  }
  cv::Mat right(std::size_t index) const override { return right_ ? right_->image(index) : cv::Mat(); }
  std::string name(std::size_t index) const override { return files_[index].string(); }
  std::vector<int> ids(bool from_names) const override {
    std::vector<int> ids = counted(size());
    if (!from_names) return ids;
    for (std::size_t i = 0; i < size(); ++i) ids[i] = static_cast<int>(numberIn(files_[i]));
    if (std::set<int>(ids.begin(), ids.end()).size() < size() || std::count(ids.begin(), ids.end(), -1) > 0)
      throw std::runtime_error("not every image's name has a number of its own, as --ids names needs");
    return ids;
  }
  std::vector<int> lengths() const override { return lengths_; }

 private:
  std::vector<fs::path> files_;
  std::vector<int> lengths_;
  std::unique_ptr<Folders> right_;
};

// Calls f with the image that a message is, raw or compressed. @return whether it is one
template <class F>
bool withImage(const rosbag::MessageInstance& message, const F& f) {
  if (const auto raw = message.instantiate<sensor_msgs::Image>()) {
    f(raw);
  } else if (const auto packed = message.instantiate<sensor_msgs::CompressedImage>()) {
    f(packed);
  } else {
    return false;
  }
  return true;
}

ros::Time stampOf(const rosbag::MessageInstance& message) {
  ros::Time stamp;
  withImage(message, [&stamp](const auto& image) { stamp = image->header.stamp; });
  return stamp;
}

class Bag : public ImageSource {
 public:
  Bag(const std::string& path, const std::string& topic, const std::string& right) : topic_(topic) {
    bag_.open(path, rosbag::bagmode::Read);
    view_.addQuery(bag_, rosbag::TopicQuery(topic));
    for (auto message = view_.begin(); message != view_.end(); ++message) messages_.push_back(message);
    if (messages_.empty()) throw std::runtime_error(path + " has no messages of topic " + topic);
    if (right.empty()) return;
    right_view_ = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(right));
    for (auto message = right_view_->begin(); message != right_view_->end(); ++message)
      right_.emplace(stampOf(*message), message);
    if (right_.empty()) throw std::runtime_error(path + " has no messages of topic " + right);
  }
  std::size_t size() const override { return messages_.size(); }
  cv::Mat image(std::size_t index) const override { return grey(*messages_[index], name(index)); }
  cv::Mat right(std::size_t index) const override {
    if (right_.empty()) return {};
    const auto found = right_.find(stampOf(*messages_[index]));
    return found == right_.end() ? cv::Mat() : grey(*found->second, "the right image of " + name(index));
  }
  std::string name(std::size_t index) const override {
    return topic_ + " at " + std::to_string(messages_[index]->getTime().toSec());
  }
  std::vector<int> ids(bool) const override { return counted(size()); }
  std::vector<int> lengths() const override { return {static_cast<int>(size())}; }

 private:
  static cv::Mat grey(const rosbag::MessageInstance& message, const std::string& name) {
    cv::Mat image;
    try {
      if (withImage(message, [&image](const auto& m) { image = cv_bridge::toCvCopy(m, "mono8")->image; }))
        return image;
    } catch (const std::exception& e) {
      throw std::runtime_error(name + ": " + e.what());
    }
    throw std::runtime_error(message.getTopic() + " is of type " + message.getDataType() +
                             ", expected is sensor_msgs/Image or sensor_msgs/CompressedImage");
  }
  std::string topic_;
  rosbag::Bag bag_;
  rosbag::View view_;
  mutable std::vector<rosbag::View::iterator> messages_;
  std::unique_ptr<rosbag::View> right_view_;
  mutable std::map<ros::Time, rosbag::View::iterator> right_;  // by stamp
};

}  // namespace

std::unique_ptr<ImageSource> openFolders(const std::vector<std::string>& folders,
                                         const std::vector<std::string>& right) {
  return std::make_unique<Folders>(folders, right);
}

std::unique_ptr<ImageSource> openBag(const std::string& bag, const std::string& topic,
                                     const std::string& right) {
  return std::make_unique<Bag>(bag, topic, right);
}

}  // namespace ibuild_loop_closure
