// SPDX-License-Identifier: BSD-3-Clause
//
// From points to clouds, PCD files and bags, by zf_convert, too.
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/tool_test.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cmath>
#include <filesystem>
#include <random>
#include <sstream>

#include "hokuyo_sick_drivers/zf/scan_cloud.h"
#include "zf/ros/cloud_bag.h"
#include "zf/ros/scan_message.h"

namespace hokuyo_sick_drivers {
namespace {

using mapping_common::errorOf;
using mapping_common::mentions;
using mapping_common::TempDir;

ScanInfo gridInfo(std::uint32_t rows, std::uint32_t columns) {
  ScanInfo info;
  info.rows = rows;
  info.columns = columns;
  info.points = std::uint64_t{rows} * columns;
  info.has_intensity = true;
  return info;
}

ScanPoint point(double x, double y, double z, std::uint32_t row = 0, std::uint32_t column = 0) {
  ScanPoint p;
  p.x = x;
  p.y = y;
  p.z = z;
  p.intensity = static_cast<float>(x);
  p.row = row;
  p.column = column;
  return p;
}

ScanCloud build(const ScanInfo& info, const std::vector<ScanPoint>& points,
                const CloudOptions& options = {}) {
  CloudBuilder builder(info, options);
  builder.add(points);
  return builder.finish();
}

std::vector<float> valuesOf(const ScanCloud& cloud, std::size_t i) {
  std::vector<float> values(cloud.pointStep() / 4);
  std::memcpy(values.data(), cloud.data.data() + i * cloud.pointStep(), cloud.pointStep());
  return values;
}

TEST(CloudBuilder, KeepsTheGrid) {
  ScanPoint missing = point(0, 0, 0, 0, 0);
  missing.valid = false;
  const ScanCloud cloud =
      build(gridInfo(2, 3), {point(1, 2, 3, 1, 2), missing, point(4, 5, 6, 0, 1), point(7, 8, 9, 1, 2),
                             point(7, 8, 9, 2, 0), point(7, 8, 9, 0, 3)});
  EXPECT_EQ(3u, cloud.width);
  EXPECT_EQ(2u, cloud.height);
  EXPECT_EQ(2u, cloud.points);
  EXPECT_EQ(1u, cloud.missing);
  EXPECT_EQ(1u, cloud.duplicates);
  EXPECT_EQ(2u, cloud.outside);
  EXPECT_EQ((std::vector<float>{1, 2, 3, 1}), valuesOf(cloud, 5));
  EXPECT_EQ((std::vector<float>{4, 5, 6, 4}), valuesOf(cloud, 1));
  for (const std::size_t empty : {0, 2, 3, 4}) {
    for (const float value : valuesOf(cloud, empty)) EXPECT_TRUE(std::isnan(value));
  }
}

TEST(CloudBuilder, LeavesTheGridIfToldTo) {
  CloudOptions options;
  options.grid = false;
  ScanPoint missing = point(0, 0, 0);
  missing.valid = false;
  const ScanCloud cloud = build(gridInfo(2, 3), {point(1, 2, 3, 9, 9), missing, point(4, 5, 6)}, options);
  EXPECT_EQ(2u, cloud.width);
  EXPECT_EQ(1u, cloud.height);
  EXPECT_EQ(32u, cloud.data.size());
}

TEST(CloudBuilder, RefusesGridsThatHardlyHoldAPoint) {
  ScanInfo info = gridInfo(100000, 100000);
  info.points = 10;
  EXPECT_TRUE(mentions(errorOf([&] { CloudBuilder(info, {}); }), {"100000 x 100000", "10 points"}));
  info.points = std::uint64_t{1} << 40U;
  info.rows = 0;
  EXPECT_TRUE(mentions(errorOf([&] { CloudBuilder(info, {}); }), {"4 GiB", "voxels"}));
}

TEST(CloudBuilder, OffsetKeepsMillimetresAndThePoseMakesUpForIt) {
  ScanInfo info;
  info.points = 2;
  info.pose.translation() = Eigen::Vector3d(0, 0, 100);
  info.pose.linear() = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d far(637012.241, 849028.312, 431.663);
  for (const bool apply_pose : {false, true}) {
    CloudOptions options;
    options.apply_pose = apply_pose;
    const ScanCloud cloud = build(info, {point(far.x(), far.y(), far.z()), point(1, 2, 3)}, options);
    EXPECT_FALSE(cloud.offset.isZero());
    const auto v = valuesOf(cloud, 0);
    EXPECT_LT((cloud.pose * Eigen::Vector3d(v[0], v[1], v[2]) - info.pose * far).norm(), 1e-4);
  }
  CloudOptions none, given;
  none.offset_mode = CloudOptions::Offset::kNone;
  EXPECT_EQ(static_cast<float>(far.x()),
            valuesOf(build(info, {point(far.x(), far.y(), far.z())}, none), 0)[0]);
  given.offset_mode = CloudOptions::Offset::kGiven;
  given.offset = Eigen::Vector3d(1, 2, 3);
  EXPECT_EQ((std::vector<float>{0, 0, 0}), valuesOf(build(info, {point(1, 2, 3)}, given), 0));
}

TEST(CloudBuilder, VoxelsAreMeans) {
  ScanInfo info = gridInfo(1, 4);
  info.has_colour = true;
  CloudOptions options;
  options.voxel = 1.0;
  std::vector<ScanPoint> points = {point(0.25, 0.5, -0.5), point(0.75, 0.5, -0.25), point(-0.25, 0, 0),
                                   point(1e18, 0, 0)};
  points[0].r = 10;
  points[1].r = 21;
  points[1].intensity = std::numeric_limits<float>::quiet_NaN();
  options.offset_mode = CloudOptions::Offset::kNone;
  const ScanCloud cloud = build(info, points, options);
  ASSERT_EQ(2u, cloud.width);
  EXPECT_EQ(1u, cloud.height);
  EXPECT_EQ(3u, cloud.points);
  EXPECT_EQ(1u, cloud.outside);
  const auto first = valuesOf(cloud, 0);
  EXPECT_EQ((std::vector<float>{0.5F, 0.5F, -0.375F, 0.25F}),
            std::vector<float>(first.begin(), first.begin() + 4));
  std::uint32_t rgb;
  std::memcpy(&rgb, &first[4], 4);
  EXPECT_EQ(16u << 16U, rgb);
  EXPECT_EQ(-0.25F, valuesOf(cloud, 1)[0]);
}

// ----------------------------------------------------------------------------------------------------
// files

ScanCloud smallCloud() {
  ScanInfo info = gridInfo(2, 3);
  info.has_colour = true;
  info.pose.translation() = Eigen::Vector3d(1.5, -2.25, 3);
  info.pose.linear() = Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5).toRotationMatrix();
  ScanPoint coloured = point(1, 2, 3, 1, 2);
  coloured.r = 255;
  coloured.g = 128;
  coloured.b = 1;
  return build(info, {coloured, point(4, 5, 6, 0, 1)});
}

TEST(PcdFile, IsWhatPclReads) {
  const TempDir dir;
  mapping_common::writeFile(dir.path("a.pcd"), [](std::ostream& out) { writePcd(out, smallCloud()); });
  pcl::PointCloud<pcl::PointXYZRGB> colours;
  pcl::PointCloud<pcl::PointXYZI> intensities;
  ASSERT_EQ(0, pcl::io::loadPCDFile(dir.path("a.pcd"), colours));
  ASSERT_EQ(0, pcl::io::loadPCDFile(dir.path("a.pcd"), intensities));
  ASSERT_EQ(3u, colours.width);
  ASSERT_EQ(2u, colours.height);
  EXPECT_EQ(3.0F, colours.at(2, 1).z);
  EXPECT_EQ(255, colours.at(2, 1).r);
  EXPECT_EQ(128, colours.at(2, 1).g);
  EXPECT_EQ(4.0F, intensities.at(1, 0).intensity);
  EXPECT_TRUE(std::isnan(intensities.at(0, 0).x));
  EXPECT_EQ(Eigen::Vector4f(1.5, -2.25, 3, 0), intensities.sensor_origin_);
  EXPECT_TRUE(intensities.sensor_orientation_.isApprox(Eigen::Quaternionf(0.5, 0.5, 0.5, 0.5)));
}

TEST(BagFile, IsWhatRosbagReads) {
  const TempDir dir;
  std_msgs::Header header;
  header.frame_id = "scanner";
  header.stamp = ros::Time(12.5);
  const sensor_msgs::PointCloud2 cloud = toMessage(smallCloud(), header);
  tf2_msgs::TFMessage pose;
  pose.transforms.push_back(toMessage(smallCloud().pose, header, "map"));
  mapping_common::writeFile(dir.path("a.bag"), [&](std::ostream& out) {
    CloudBag bag(out);
    bag.write("/tf_static", header.stamp, pose);
    bag.write("cloud", header.stamp, cloud);
    bag.write("cloud", ros::Time(14.0), cloud);
    bag.close();
  });
  const rosbag::Bag bag(dir.path("a.bag"));
  rosbag::View clouds(bag, rosbag::TopicQuery("cloud")), poses(bag, rosbag::TopicQuery("/tf_static"));
  ASSERT_EQ(2u, clouds.size());
  ASSERT_EQ(1u, poses.size());
  EXPECT_EQ(14.0, clouds.getEndTime().toSec());
  const auto read = clouds.begin()->instantiate<sensor_msgs::PointCloud2>();
  ASSERT_TRUE(read);
  EXPECT_EQ(cloud.data, read->data);
  EXPECT_EQ(cloud.fields, read->fields);
  EXPECT_EQ("scanner", read->header.frame_id);
  EXPECT_EQ(3u, read->width);
  EXPECT_EQ(2u, read->height);
  EXPECT_EQ(60u, read->row_step);
  EXPECT_FALSE(read->is_dense);
  const auto transform = poses.begin()->instantiate<tf2_msgs::TFMessage>()->transforms.at(0);
  EXPECT_EQ("map", transform.header.frame_id);
  EXPECT_EQ("scanner", transform.child_frame_id);
  EXPECT_EQ(-2.25, transform.transform.translation.y);
  EXPECT_NEAR(0.5, transform.transform.rotation.w, 1e-9);
}

// ----------------------------------------------------------------------------------------------------
// zf_convert

const char* const kPtx =
    "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n"
    "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.25\n7 8 9 1\n";

class ZfConvert : public ::testing::Test {
 protected:
  int run(const std::string& arguments) {
    const mapping_common::Ran ran =
        mapping_common::run("cd " + dir_.path() + " && " + ZF_CONVERT + " -q " + arguments);
    output_ = ran.said();
    return ran.code;
  }
  bool exists(const std::string& name) { return std::filesystem::exists(dir_.path(name)); }

  TempDir dir_;
  std::string output_;
};

TEST_F(ZfConvert, WritesTheGridToAPcdFile) {
  dir_.write("a.ptx", kPtx);
  ASSERT_EQ(0, run("a.ptx a.pcd")) << output_;
  pcl::PointCloud<pcl::PointXYZI> cloud;
  ASSERT_EQ(0, pcl::io::loadPCDFile(dir_.path("a.pcd"), cloud));
  ASSERT_EQ(2u, cloud.width);
  ASSERT_EQ(2u, cloud.height);
  EXPECT_EQ(1.0F, cloud.at(0, 0).x);
  EXPECT_TRUE(std::isnan(cloud.at(0, 1).x));
  EXPECT_EQ(0.25F, cloud.at(1, 0).intensity);
  EXPECT_EQ(Eigen::Vector4f(5, 6, 7, 0), cloud.sensor_origin_);
}

TEST_F(ZfConvert, SeveralScansBecomeSeveralFilesOrOneBag) {
  dir_.write("a.ptx", std::string(kPtx) + kPtx);
  ASSERT_EQ(0, run("a.ptx b.pcd")) << output_;
  EXPECT_TRUE(exists("b_1.pcd") && exists("b_2.pcd") && !exists("b.pcd"));
  ASSERT_EQ(0, run("a.ptx one.pcd --scan 2")) << output_;
  EXPECT_TRUE(exists("one.pcd"));
  ASSERT_EQ(0, run("a.ptx b.bag --frame f --stamp 100 --topic points")) << output_;
  const rosbag::Bag bag(dir_.path("b.bag"));
  rosbag::View clouds(bag, rosbag::TopicQuery("points"));
  ASSERT_EQ(2u, clouds.size());
  EXPECT_EQ("f_1", clouds.begin()->instantiate<sensor_msgs::PointCloud2>()->header.frame_id);
  EXPECT_EQ(100.0, clouds.getBeginTime().toSec());
}

TEST_F(ZfConvert, Options) {
  dir_.write("a.ptx", kPtx);
  ASSERT_EQ(0, run("a.ptx a.pcd --voxel 100 --intensity limits --intensity-limits 0 2")) << output_;
  pcl::PointCloud<pcl::PointXYZI> cloud;
  ASSERT_EQ(0, pcl::io::loadPCDFile(dir_.path("a.pcd"), cloud));
  ASSERT_EQ(1u, cloud.size());
  EXPECT_EQ(4.0F, cloud[0].x);
  EXPECT_NEAR((0.5 + 0.25 + 1) / 3 / 2, cloud[0].intensity, 1e-6);
  ASSERT_EQ(0, run("a.ptx a.pcd --no-grid --apply-pose --offset=-1,0,2")) << output_;
  ASSERT_EQ(0, pcl::io::loadPCDFile(dir_.path("a.pcd"), cloud));
  ASSERT_EQ(3u, cloud.size());
  EXPECT_EQ(1.0F + 5 + 1, cloud[0].x);
  EXPECT_EQ(3.0F + 7 - 2, cloud[0].z);
  ASSERT_EQ(0, run("--list a.ptx")) << output_;
  EXPECT_TRUE(mentions(output_, {"PTX", "4 points", "grid of 2 x 2"}));
}

TEST_F(ZfConvert, FailsWithoutLeavingAnything) {
  dir_.write("a.ptx", std::string(kPtx).substr(0, 80));
  dir_.write("b.ptx", kPtx);
  dir_.write("c.zfs", "ZFS");
  dir_.write("old.pcd", "old");
  EXPECT_EQ(1, run("a.ptx old.pcd"));
  EXPECT_TRUE(mentions(output_, {"a.ptx", "line "}));
  EXPECT_EQ("old", mapping_common::readFile(dir_.path("old.pcd")));
  EXPECT_EQ(1, run("c.zfs c.pcd"));
  EXPECT_TRUE(mentions(output_, {"c.zfs", "LaserControl"}));
  EXPECT_EQ(1, run("none.e57 c.pcd"));
  EXPECT_TRUE(mentions(output_, {"none.e57", "No such file"}));
  EXPECT_EQ(1, run("b.ptx c.pcd --scan 2"));
  EXPECT_TRUE(mentions(output_, {"no scan \"2\"", "there are 1"}));
  for (const char* wrong :
       {"", "b.ptx", "b.ptx c.txt", "b.ptx c.pcd --offset 1,2", "b.ptx c.pcd --voxel -1",
        "b.ptx c.pcd --intensity loud", "b.ptx c.pcd --intensity limits", "b.ptx c.pcd --what"}) {
    EXPECT_EQ(2, run(wrong)) << wrong;
    EXPECT_TRUE(mentions(output_, {"--help"})) << wrong;
  }
  EXPECT_EQ(1, run("b.ptx /does/not/exist/c.pcd"));
  EXPECT_FALSE(exists("c.pcd") || exists("c.bag"));
}

}  // namespace
}  // namespace hokuyo_sick_drivers
