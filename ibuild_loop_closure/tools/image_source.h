// SPDX-License-Identifier: BSD-3-Clause
//
// The images of folders or of a bag, one after the other.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace ibuild_loop_closure {

class ImageSource {
 public:
  virtual ~ImageSource() = default;
  virtual std::size_t size() const = 0;
  /// @throws std::runtime_error that names the image, if it can't be read
  virtual cv::Mat image(std::size_t index) const = 0;
  /// Of a stereo camera's right camera; empty if there is none. @throws as image
  virtual cv::Mat right(std::size_t index) const = 0;
  virtual std::string name(std::size_t index) const = 0;
  /// The number that ground truth has for the image: that in its file's name, if all have one of their own
  /// and `from_names`, otherwise the index.
  virtual std::vector<int> ids(bool from_names) const = 0;
  /// Numbers of images of each folder.
  virtual std::vector<int> lengths() const = 0;
};

/// By name, numbers in names by value.
/// @param right folders of right images, as many of them and with as many images in each; empty: none
/// @throws std::runtime_error if a folder isn't there or holds no image, or left and right don't go together
std::unique_ptr<ImageSource> openFolders(const std::vector<std::string>& folders,
                                         const std::vector<std::string>& right = {});
/// sensor_msgs/Image or CompressedImage.
/// @param right topic of right images, which belong to those of the same stamp; empty: none
/// @throws std::runtime_error if there is no such topic
std::unique_ptr<ImageSource> openBag(const std::string& bag, const std::string& topic,
                                     const std::string& right = "");

}  // namespace ibuild_loop_closure
