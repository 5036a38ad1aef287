// SPDX-License-Identifier: BSD-3-Clause
#include "laser_intensity_calib/ros/bag_samples.h"

#include <pcl/point_types.h>
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_line.h>
#include <pcl/sample_consensus/sac_model_plane.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <tf2/buffer_core.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <stdexcept>

#include "laser_intensity_calib/ros/conversions.h"

namespace laser_intensity_calib {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

// The measurements whose normals are estimated together; `points` are in the frame of the region.
struct Batch {
  Eigen::Matrix3Xf points, viewpoints;
  Eigen::ArrayXf ranges, incidence, intensities;
  std::vector<int> scans, beams, lasers;

  void append(const Batch& other) {
    const auto join = [](auto& a, const auto& b) {
      const Eigen::Index before = a.cols();
      a.conservativeResize(Eigen::NoChange, before + b.cols());
      a.rightCols(b.cols()) = b;
    };
    const auto extend = [](Eigen::ArrayXf& a, const Eigen::ArrayXf& b) {
      const Eigen::Index before = a.size();
      a.conservativeResize(before + b.size());
      a.tail(b.size()) = b;
    };
    join(points, other.points);
    join(viewpoints, other.viewpoints);
    extend(ranges, other.ranges);
    extend(intensities, other.intensities);
    scans.insert(scans.end(), other.scans.begin(), other.scans.end());
    beams.insert(beams.end(), other.beams.begin(), other.beams.end());
    lasers.insert(lasers.end(), other.lasers.begin(), other.lasers.end());
  }
};

bool isInside(const Region& region, const Batch& batch, Eigen::Index i) {
  return batch.points.col(i).allFinite() && batch.beams[i] >= region.first_beam &&
         batch.beams[i] <= region.last_beam &&
         (!region.box || region.box->contains(batch.points.col(i).cast<double>()));
}

// Those of the points that are on the largest plane, or line.
std::vector<int> largestPlane(const Batch& batch, const std::vector<int>& candidates, bool is_line,
                              double tolerance) {
  Cloud::Ptr cloud(new Cloud);
  for (const int i : candidates)
    cloud->emplace_back(batch.points(0, i), batch.points(1, i), batch.points(2, i));
  if (cloud->size() < 3) return {};
  pcl::SampleConsensusModel<pcl::PointXYZ>::Ptr model;
  if (is_line) {
    model.reset(new pcl::SampleConsensusModelLine<pcl::PointXYZ>(cloud));
  } else {
    model.reset(new pcl::SampleConsensusModelPlane<pcl::PointXYZ>(cloud));
  }
  pcl::RandomSampleConsensus<pcl::PointXYZ> ransac(model, tolerance);
  if (!ransac.computeModel()) return {};
  std::vector<int> inliers, result;
  ransac.getInliers(inliers);
  for (const int i : inliers) result.push_back(candidates[i]);
  return result;
}

class Collector {
 public:
  Collector(const std::string& file, const BagSamplesOptions& options, BagSamplesReport& report)
      : options_(options), report_(report), scan_incidence_(options.scan) {
    mapping_common::validate(options);
    if (options.accumulate > 0 && options.region.frame.empty()) {
      throw std::invalid_argument("to put messages together takes a frame that doesn't move with the sensor");
    }
    try {
      bag_.open(file, rosbag::bagmode::Read);
    } catch (const rosbag::BagException& e) {
      throw std::runtime_error(file + " can't be read: " + e.what());
    }
    const auto rooted = [](const std::string& topic) { return topic[0] == '/' ? topic : '/' + topic; };
    view_.addQuery(bag_, [topic = rooted(options.topic), rooted](const rosbag::ConnectionInfo* c) {
      return rooted(c->topic) == topic;
    });
    const auto connections = view_.getConnections();
    if (connections.empty()) throw std::runtime_error(file + " has no topic " + options.topic + topics());
    const std::string type = connections[0]->datatype;
    is_scan_ = type == "sensor_msgs/LaserScan";
    if (!is_scan_ && type != "sensor_msgs/PointCloud2") {
      throw std::runtime_error("topic " + options.topic + " is a " + type +
                               ", expected sensor_msgs/LaserScan or PointCloud2");
    }
    if (!options.region.frame.empty()) readTransforms();
  }

  std::vector<Sample> collect(const std::function<void(double)>& progress) {
    const double size = std::max<double>(1.0, view_.size());
    std::size_t index = 0;
    int pending = 0;
    Batch batch;
    for (const rosbag::MessageInstance& message : view_) {
      if (progress) progress(static_cast<double>(index) / size);
      if (index++ % options_.step != 0) continue;
      ++report_.messages;
      Batch part;
      if (!read(message, static_cast<int>(report_.messages) - 1, part)) continue;
      if (options_.accumulate == 0) {
        add(part);
        continue;
      }
      batch.append(part);
      if (++pending < options_.accumulate) continue;
      addAccumulated(batch);
      batch = Batch();
      pending = 0;
    }
    if (pending > 0) addAccumulated(batch);
    return std::move(samples_);
  }

 private:
  std::string topics() {
    std::string text = "; it has";
    rosbag::View all(bag_);
    for (const rosbag::ConnectionInfo* c : all.getConnections())
      text += " " + c->topic + " (" + c->datatype + ")";
    return text;
  }

  void readTransforms() {
    for (const char* name : {"/tf", "/tf_static"}) {
      rosbag::View view(bag_, rosbag::TopicQuery(name));
      for (const rosbag::MessageInstance& message : view) {
        const auto transforms = message.instantiate<tf2_msgs::TFMessage>();
        if (!transforms) continue;
        for (const auto& t : transforms->transforms)
          tf_.setTransform(t, "bag", name == std::string("/tf_static"));
      }
    }
  }

  // False if the message had to be left out.
  bool read(const rosbag::MessageInstance& message, int scan, Batch& batch) {
    try {
      if (const auto laser = message.instantiate<sensor_msgs::LaserScan>()) {
        readInto(*laser, batch);
        transform(laser->header, batch);
      } else if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
        readInto(*cloud, batch);
        transform(cloud->header, batch);
      }
    } catch (const tf2::TransformException& e) {
      ++report_.without_transform;
      report_.last_problem = e.what();
      return false;
    } catch (const std::exception& e) {
      ++report_.malformed;
      report_.last_problem = e.what();
      return false;
    }
    batch.scans.assign(batch.points.cols(), scan);
    batch.lasers.resize(batch.points.cols());  // all 0 unless there are several
    batch.beams.resize(batch.points.cols());
    for (std::size_t i = 0; i < batch.beams.size(); ++i) batch.beams[i] = static_cast<int>(i);
    return true;
  }

  void readInto(const sensor_msgs::LaserScan& scan, Batch& batch) {
    const ScanArrays arrays = readScan(scan);
    const Eigen::Index n = arrays.ranges.size();
    const Eigen::ArrayXf angles =
        scan.angle_min + scan.angle_increment * Eigen::ArrayXf::LinSpaced(n, 0.0F, static_cast<float>(n - 1));
    batch.points.resize(3, n);
    batch.points.row(0) = arrays.ranges * angles.cos();
    batch.points.row(1) = arrays.ranges * angles.sin();
    batch.points.row(2) = 0.0F * arrays.ranges;  // NaN stays
    batch.viewpoints = Eigen::Matrix3Xf::Zero(3, n);
    batch.ranges = arrays.ranges;
    batch.intensities = arrays.intensities;
    if (options_.accumulate == 0) {
      batch.incidence = scan_incidence_.estimate(arrays.ranges, scan.angle_min, scan.angle_increment);
    }
  }

  void readInto(const sensor_msgs::PointCloud2& cloud, Batch& batch) {
    CloudArrays arrays = readCloud(cloud);
    batch.points = std::move(arrays.points);
    batch.viewpoints = arrays.viewpoints.cols() == 1
                           ? Eigen::Matrix3Xf(arrays.viewpoints.replicate(1, batch.points.cols()))
                           : std::move(arrays.viewpoints);
    batch.ranges = cloudRanges(batch.points, batch.viewpoints);
    batch.intensities = std::move(arrays.intensities);
    batch.lasers.assign(arrays.lasers.data(), arrays.lasers.data() + arrays.lasers.size());
    if (options_.accumulate == 0) {
      batch.incidence = cloudIncidence(batch.points, batch.viewpoints, options_.cloud, arrays.width);
    }
  }

  void transform(const std_msgs::Header& header, Batch& batch) const {
    if (options_.region.frame.empty()) return;
    const Eigen::Isometry3f pose =
        tf2::transformToEigen(tf_.lookupTransform(options_.region.frame, header.frame_id, header.stamp))
            .cast<float>();
    batch.points = (pose * batch.points).eval();
    batch.viewpoints = (pose * batch.viewpoints).eval();
  }

  void addAccumulated(Batch& batch) {
    batch.incidence = cloudIncidence(batch.points, batch.viewpoints, options_.cloud);
    add(batch);
  }

  void add(const Batch& batch) {
    std::vector<int> chosen;
    for (Eigen::Index i = 0; i < batch.points.cols(); ++i) {
      if (isInside(options_.region, batch, i)) chosen.push_back(static_cast<int>(i));
    }
    if (options_.region.plane) {
      chosen =
          largestPlane(batch, chosen, is_scan_ && options_.accumulate == 0, options_.region.plane_tolerance);
    }
    report_.in_region += chosen.size();
    for (const int i : chosen) {
      if (std::isnan(batch.incidence[i])) {
        ++report_.without_incidence;
      } else {
        samples_.push_back(
            {batch.ranges[i], batch.incidence[i], batch.intensities[i], batch.scans[i], batch.lasers[i]});
      }
    }
  }

  const BagSamplesOptions& options_;
  BagSamplesReport& report_;
  ScanIncidence scan_incidence_;
  rosbag::Bag bag_;
  rosbag::View view_;
  bool is_scan_ = false;
  tf2::BufferCore tf_{ros::Duration(1e8)};  // s, all of the bag
  std::vector<Sample> samples_;
};

}  // namespace

std::vector<Sample> collectSamples(const std::string& bag, const BagSamplesOptions& options,
                                   BagSamplesReport& report, const std::function<void(double)>& progress) {
  return Collector(bag, options, report).collect(progress);
}

}  // namespace laser_intensity_calib
