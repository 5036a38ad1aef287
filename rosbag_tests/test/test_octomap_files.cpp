// SPDX-License-Identifier: BSD-3-Clause
//
// Files of the R-tree map's own reader and writer against OctoMap's library: each reads what the other wrote.
#include <gtest/gtest.h>
#include <mapping_common/testing/recordings.h>
#include <mapping_common/testing/temp_dir.h>
#include <octomap/ColorOcTree.h>
#include <octomap/OcTree.h>
#include <pcl/io/pcd_io.h>
#include <rtree_occupancy_map/octomap_file.h>
#include <rtree_occupancy_map/pcd_file.h>

#include <cmath>
#include <fstream>
#include <map>
#include <memory>
#include <random>
#include <string>

#include "voxels.h"

namespace rosbag_tests {
namespace {

using mapping_common::TempDir;
using rtree_occupancy_map::OccupancyMap;
using rtree_occupancy_map::OctomapFormat;
using rtree_occupancy_map::Options;
using rtree_occupancy_map::Scan;
using rtree_occupancy_map::Voxel;

constexpr int kOctomapOrigin = 32768;  // OctoMap's key of voxel 0

template <class Tree>
std::map<Voxel, float> voxelsOf(const Tree& tree) {
  std::map<Voxel, float> voxels;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    const int width = 1 << (tree.getTreeDepth() - leaf.getDepth());
    // The key of a leaf above the voxels is that of its middle.
    const octomap::OcTreeKey key = leaf.getIndexKey();
    for (int x = 0; x < width; ++x)
      for (int y = 0; y < width; ++y)
        for (int z = 0; z < width; ++z)
          voxels[{key[0] - kOctomapOrigin + x, key[1] - kOctomapOrigin + y, key[2] - kOctomapOrigin + z}] =
              leaf->getLogOdds();
  }
  return voxels;
}

std::map<Voxel, float> voxelsOf(const OccupancyMap& map) {
  std::map<Voxel, float> voxels;
  for (const KnownVoxel& v : knownVoxels(map)) voxels[v.voxel] = v.log_odds;
  return voxels;
}

/// A wall that turns around the sensor, and noise.
Scan scanOf(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> noise(-0.2F, 0.2F), angle(-3.14F, 3.14F);
  Scan scan;
  scan.origin = {noise(random), noise(random), noise(random)};
  for (int i = 0; i < 800; ++i) {
    const float a = angle(random), b = 0.4F * angle(random), r = 3.0F + noise(random);
    scan.hits.emplace_back(r * std::cos(a) * std::cos(b), r * std::sin(a) * std::cos(b), r * std::sin(b));
  }
  return scan;
}

void insert(const Scan& scan, octomap::OcTree& tree) {
  octomap::Pointcloud cloud;
  for (const Eigen::Vector3f& p : scan.hits) cloud.push_back(p.x(), p.y(), p.z());
  tree.insertPointCloud(cloud, {scan.origin.x(), scan.origin.y(), scan.origin.z()}, -1.0, false, true);
}

/// Cubes and voxels of any log odds that the thresholds allow, near the origin and far.
void scatter(unsigned seed, octomap::OcTree& tree) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> log_odds(-2.0F, 3.5F);
  std::uniform_int_distribution<int> place(-40, 40);
  for (int i = 0; i < 60; ++i) {
    const int edge = 1 << random() % 4, far = i % 20 == 0 ? 20000 : 0;
    const float value = i % 3 == 0 ? tree.getClampingThresMaxLog() : log_odds(random);
    const int at[3] = {edge * (place(random) / edge) + far, edge * (place(random) / edge) - far,
                       edge * (place(random) / edge)};
    for (int x = 0; x < edge; ++x)
      for (int y = 0; y < edge; ++y)
        for (int z = 0; z < edge; ++z) {
          const auto key = [](int c) { return static_cast<octomap::key_type>(c + kOctomapOrigin); };
          tree.setNodeValue(octomap::OcTreeKey(key(at[0] + x), key(at[1] + y), key(at[2] + z)), value);
        }
  }
}

std::unique_ptr<octomap::OcTree> readByOctomap(const std::string& path) {
  octomap::AbstractOcTree* any = octomap::AbstractOcTree::read(path);
  std::unique_ptr<octomap::OcTree> tree(dynamic_cast<octomap::OcTree*>(any));
  if (!tree) delete any;
  return tree;
}

class OctomapFiles : public testing::Test {
 protected:
  void expectSame(octomap::OcTree& tree) {
    ASSERT_TRUE(tree.write(path("theirs.ot")));
    const OccupancyMap full = rtree_occupancy_map::readOctomap(path("theirs.ot"));
    EXPECT_EQ(tree.getResolution(), full.options().resolution);
    EXPECT_EQ(voxelsOf(tree), voxelsOf(full));

    ASSERT_TRUE(tree.writeBinaryConst(path("theirs.bt")));
    octomap::OcTree binary(path("theirs.bt"));
    EXPECT_EQ(voxelsOf(binary), voxelsOf(rtree_occupancy_map::readOctomap(path("theirs.bt"))));
  }

  void expectSame(const OccupancyMap& map) {
    rtree_occupancy_map::writeOctomap(map, path("ours.ot"), OctomapFormat::kFull);
    std::unique_ptr<octomap::OcTree> full = readByOctomap(path("ours.ot"));
    ASSERT_TRUE(full);
    EXPECT_EQ(map.options().resolution, full->getResolution());
    EXPECT_EQ(voxelsOf(map), voxelsOf(*full));
    const std::size_t nodes = full->calcNumNodes();
    full->prune();
    EXPECT_EQ(full->calcNumNodes(), nodes) << "it was written with nodes that could be pruned";
    rtree_occupancy_map::writeOctomap(map, path("ours.bt"), OctomapFormat::kBinary);
    octomap::OcTree binary(0.1);
    ASSERT_TRUE(binary.readBinary(path("ours.bt")));
    std::map<Voxel, float> expected = voxelsOf(map);
    for (auto& [voxel, log_odds] : expected) {
      log_odds =
          log_odds >= std::log(map.options().occupancy_threshold / (1.0 - map.options().occupancy_threshold))
              ? binary.getClampingThresMaxLog()
              : binary.getClampingThresMinLog();
    }
    EXPECT_EQ(expected, voxelsOf(binary));
  }

  std::string path(const std::string& name) const { return dir_.path(name); }
  TempDir dir_;
};

TEST_F(OctomapFiles, TheirsBecomeOurs) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    octomap::OcTree scanned(seed == 1 ? 0.1 : seed == 2 ? 0.25 : 0.3), scattered(0.05);
    for (unsigned i = 0; i < 6; ++i) insert(scanOf(10 * seed + i), scanned);
    expectSame(scanned);
    scatter(seed, scattered);
    expectSame(scattered);
    scattered.prune();
    expectSame(scattered);
  }
  octomap::OcTree empty(0.3), one(0.3);
  expectSame(empty);
  one.updateNode(octomap::point3d(-0.1F, 0.1F, 0.1F), true);
  expectSame(one);
}

TEST_F(OctomapFiles, OursBecomeTheirs) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Options options;
    options.resolution = seed == 1 ? 1.0 / 3.0 : 0.1 * seed;
    options.clamping_max = seed == 2 ? 0.999 : 0.97;
    options.occupancy_threshold = seed == 3 ? 0.6 : 0.5;
    OccupancyMap map(options);
    for (unsigned i = 0; i < 6; ++i) map.insertScan(scanOf(10 * seed + i));
    expectSame(map);
  }
  expectSame(OccupancyMap());
}

// octomap_server's parameters: the same scans give the same file.
TEST_F(OctomapFiles, TheSameScansGiveTheSameBytes) {
  Options options;
  OccupancyMap map(options);
  octomap::OcTree tree(options.resolution);
  tree.setProbHit(options.prob_hit);
  tree.setProbMiss(options.prob_miss);
  tree.setClampingThresMin(options.clamping_min);
  tree.setClampingThresMax(options.clamping_max);
  for (unsigned i = 0; i < 10; ++i) {
    map.insertScan(scanOf(i));
    insert(scanOf(i), tree);
  }
  tree.updateInnerOccupancy();
  tree.prune();
  const auto bytes = [this](const std::string& name) {
    std::ifstream in(path(name), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  ASSERT_TRUE(tree.write(path("theirs.ot")));
  rtree_occupancy_map::writeOctomap(map, path("ours.ot"), OctomapFormat::kFull);
  EXPECT_TRUE(bytes("theirs.ot") == bytes("ours.ot"));
  ASSERT_TRUE(tree.writeBinary(path("theirs.bt")));
  rtree_occupancy_map::writeOctomap(map, path("ours.bt"), OctomapFormat::kBinary);
  EXPECT_TRUE(bytes("theirs.bt") == bytes("ours.bt"));
}

using rtree_occupancy_map::Color;

/// Of occupied leaves that have one.
std::map<Voxel, Color> colorsOf(const octomap::ColorOcTree& tree) {
  std::map<Voxel, Color> colors;
  for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
    const int width = 1 << (tree.getTreeDepth() - leaf.getDepth());
    const octomap::OcTreeKey key = leaf.getIndexKey();
    const octomap::ColorOcTreeNode::Color c = leaf->getColor();
    if (!leaf->isColorSet() || !tree.isNodeOccupied(*leaf)) continue;
    for (int x = 0; x < width; ++x)
      for (int y = 0; y < width; ++y)
        for (int z = 0; z < width; ++z)
          colors[{key[0] - kOctomapOrigin + x, key[1] - kOctomapOrigin + y, key[2] - kOctomapOrigin + z}] = {
              c.r, c.g, c.b};
  }
  return colors;
}

std::map<Voxel, Color> colorsOf(const OccupancyMap& map) {
  std::map<Voxel, Color> colors;
  for (const auto& c : map.coloredVoxels()) colors[c.voxel] = c.color.mean();
  return colors;
}

TEST_F(OctomapFiles, TheirColoursBecomeOurs) {
  for (const bool prune : {false, true}) {
    octomap::ColorOcTree tree(0.2);
    for (int i = 0; i < 400; ++i) {
      const octomap::point3d p(0.1F + 0.2F * static_cast<float>(i * i % 37),
                               0.1F + 0.2F * static_cast<float>(i % 5),
                               0.1F + 0.2F * static_cast<float>(i % 3));
      const bool occupied = i % 7 != 0;
      tree.updateNode(p, occupied);
      if (i % 4 != 0) tree.setNodeColor(p.x(), p.y(), p.z(), static_cast<std::uint8_t>(i), 7, 200);
    }
    for (int i = 0; i < 64; ++i) {  // a cube that is pruned
      const octomap::point3d p(8.1F + 0.2F * static_cast<float>(i % 4),
                               0.1F + 0.2F * static_cast<float>(i / 4 % 4),
                               0.1F + 0.2F * static_cast<float>(i / 16));
      tree.updateNode(p, true);
      tree.setNodeColor(p.x(), p.y(), p.z(), static_cast<std::uint8_t>(3 * i), 50, 100);
    }
    tree.updateInnerOccupancy();
    if (prune) tree.prune();
    ASSERT_TRUE(tree.write(path("theirs.ot")));
    const OccupancyMap read = rtree_occupancy_map::readOctomap(path("theirs.ot"));
    EXPECT_EQ(voxelsOf(tree), voxelsOf(read));
    EXPECT_GT(colorsOf(tree).size(), 150u);
    EXPECT_EQ(colorsOf(tree), colorsOf(read));
    const OccupancyMap without = rtree_occupancy_map::readOctomap(path("theirs.ot"), {});
    EXPECT_EQ(voxelsOf(tree), voxelsOf(without));
    EXPECT_TRUE(without.coloredVoxels().empty());
  }
}

TEST_F(OctomapFiles, OurColoursBecomeTheirs) {
  Options options;
  options.color = true;
  OccupancyMap map(options);
  std::mt19937 random(3);
  for (unsigned i = 0; i < 6; ++i) {
    Scan scan = scanOf(i);
    for (std::size_t k = 0; k < scan.hits.size(); ++k) {
      const auto byte = [&random] { return static_cast<std::uint8_t>(random()); };
      scan.colors.push_back({byte(), byte(), byte()});
    }
    map.insertScan(scan);
  }
  rtree_occupancy_map::writeOctomap(map, path("ours.ot"), OctomapFormat::kFull);
  octomap::AbstractOcTree* any = octomap::AbstractOcTree::read(path("ours.ot"));
  std::unique_ptr<octomap::ColorOcTree> tree(dynamic_cast<octomap::ColorOcTree*>(any));
  ASSERT_TRUE(tree);
  EXPECT_EQ(voxelsOf(map), voxelsOf(*tree));
  const auto ours = colorsOf(map), theirs = colorsOf(*tree);
  ASSERT_GT(ours.size(), 1000u);
  ASSERT_EQ(ours.size(), theirs.size());
  std::size_t pruned = 0;
  for (const auto& [voxel, color] : ours) pruned += theirs.at(voxel) != color;
  EXPECT_LT(pruned, ours.size() / 20);
  // Inner nodes have what OctoMap gives them, and nothing is left for it to prune.
  const std::size_t nodes = tree->calcNumNodes();
  tree->prune();
  EXPECT_EQ(nodes, tree->calcNumNodes());
  const auto bytes = [this](const std::string& name) {
    std::ifstream in(path(name), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  tree->updateInnerOccupancy();
  ASSERT_TRUE(tree->write(path("again.ot")));
  EXPECT_TRUE(bytes("ours.ot") == bytes("again.ot"));
}

TEST_F(OctomapFiles, TheSampleOfOctomap) {
  const std::string sample = mapping_common::findRecording("octomap_samples/geb079.bt");
  if (sample.empty()) GTEST_SKIP() << mapping_common::withoutRecording("octomap_samples/geb079.bt");
  octomap::OcTree tree(sample);
  const OccupancyMap map = rtree_occupancy_map::readOctomap(sample);
  EXPECT_EQ(voxelsOf(tree), voxelsOf(map));
  EXPECT_LT(map.tree().size(), tree.getNumLeafNodes());
  rtree_occupancy_map::writeOctomap(map, path("again.bt"), OctomapFormat::kBinary);
  octomap::OcTree again(path("again.bt"));
  EXPECT_EQ(voxelsOf(tree), voxelsOf(again));
}

TEST_F(OctomapFiles, PclReadsOurColours) {
  Options options;
  options.color = true;
  OccupancyMap map(options);
  Scan scan = scanOf(1);
  for (std::size_t k = 0; k < scan.hits.size(); ++k)
    scan.colors.push_back({static_cast<std::uint8_t>(k), 100, 255});
  map.insertScan(scan);
  const std::size_t written = rtree_occupancy_map::writePcd(map, path("a.pcd"));
  pcl::PointCloud<pcl::PointXYZRGB> cloud;
  ASSERT_EQ(0, pcl::io::loadPCDFile(path("a.pcd"), cloud));
  ASSERT_EQ(written, cloud.size());
  for (const pcl::PointXYZRGB& p : cloud)
    EXPECT_EQ((Color{p.r, p.g, p.b}), map.colorAt(p.getVector3fMap().cast<double>()));
}

TEST_F(OctomapFiles, PclReadsOurClouds) {
  OccupancyMap map;
  for (unsigned i = 0; i < 4; ++i) map.insertScan(scanOf(i));
  const std::size_t written = rtree_occupancy_map::writePcd(map, path("a.pcd"));
  pcl::PointCloud<pcl::PointXYZ> cloud;
  ASSERT_EQ(0, pcl::io::loadPCDFile(path("a.pcd"), cloud));
  EXPECT_EQ(written, cloud.size());
  std::map<Voxel, float> occupied;
  for (const KnownVoxel& v : knownVoxels(map))
    if (v.occupied) occupied[v.voxel] = 0.0F;
  ASSERT_EQ(occupied.size(), cloud.size());
  for (const pcl::PointXYZ& p : cloud) {
    EXPECT_EQ(rtree_occupancy_map::VoxelState::kOccupied, map.stateAt(p.getVector3fMap().cast<double>()));
    for (int k = 0; k < 3; ++k) {
      const double in_voxel = p.getVector3fMap()[k] / 0.2 - std::floor(p.getVector3fMap()[k] / 0.2);
      EXPECT_NEAR(0.5, in_voxel, 1e-4);
    }
  }
}

}  // namespace
}  // namespace rosbag_tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
