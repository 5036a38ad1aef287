// SPDX-License-Identifier: BSD-3-Clause
//
// Blocks stay taken apart between scans: nobody may notice.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <tuple>

#include "plain_grid.h"
#include "random_queries.h"
#include "row_kernels.h"
#include "worker_pool.h"

namespace rtree_occupancy_map {
namespace {

Options options(double working_set_memory = Options().working_set_memory) {
  Options o;
  o.resolution = 0.1;
  o.working_set_memory = working_set_memory;
  return o;
}

// With all memory, with what a block or two take, and with none.
TEST(WorkingSet, QueriesBetweenScansSeeAndChangeNothing) {
  const Options reference = options();
  OccupancyMap silent(reference), current(reference);
  std::vector<OccupancyMap> asked;
  for (const double memory : {reference.working_set_memory, 0.04, 0.0}) asked.emplace_back(options(memory));
  PlainGrid grid(reference);
  RandomScans scans(21);
  Asker asker(5 + testSeed());
  std::mt19937 random(6 + testSeed());
  for (int i = 0; i < 30; ++i) {
    const Scan scan = scans.next(i < 20 ? 200 : 30);
    grid.insert(scan);
    silent.insertScan(scan);
    current.insertScan(scan);
    EXPECT_GT(current.tree().size(), 0U);
    for (OccupancyMap& map : asked) {
      map.insertScan(scan);
      for (unsigned k = random() % 4; k > 0; --k) asker.ask(map, grid, current);
    }
  }
  const auto cells = cellsOf(silent);
  expectEqual(silent, grid);
  for (const OccupancyMap& map : asked) {
    EXPECT_TRUE(cellsOf(map) == cells);
    expectEqual(map, grid);
  }
}

TEST(WorkingSet, TakesNoMoreMemoryThanAllowed) {
  OccupancyMap all(options()), some(options(0.1)), none(options(0));
  RandomScans scans(22);
  for (int i = 0; i < 12; ++i) {
    const Scan scan = scans.next(300);
    for (OccupancyMap* map : {&all, &some, &none}) map->insertScan(scan);
    const std::size_t overhead = 20000;  // of the tables
    EXPECT_LE(some.memoryUsage(), 104858 + some.tree().memoryUsage() + overhead);
    EXPECT_LE(none.memoryUsage(), none.tree().memoryUsage() + overhead);
    EXPECT_GT(all.memoryUsage(), 200000 + all.tree().memoryUsage());
  }
}

TEST(WorkingSet, LetsGoOfBlocksThatAreLeftBehind) {
  OccupancyMap map(options());
  RandomScans scans(23);
  map.insertScan(scans.next(300));
  const std::size_t before = map.memoryUsage();
  Scan elsewhere;
  elsewhere.origin = {100.05F, 0.05F, 0.05F};
  elsewhere.hits = {{100.55F, 0.05F, 0.05F}};
  for (int i = 0; i < 10; ++i) map.insertScan(elsewhere);
  EXPECT_LT(map.memoryUsage(), before);
}

TEST(WorkingSet, ClearsWhatHasNotGoneBackYet) {
  OccupancyMap map(options());
  Scan scan;
  scan.origin = {0.05F, 0.05F, 0.05F};
  scan.hits = {{1.05F, 0.05F, 0.05F}};
  map.insertScan(scan);
  EXPECT_EQ(map.clearBox({1.0, 0.0, 0.0}, {1.1, 0.1, 0.1}).size(), 1U);
  EXPECT_EQ(map.stateAt({1.05, 0.05, 0.05}), VoxelState::kFree);
  EXPECT_EQ(map.stateAt({0.55, 0.05, 0.05}), VoxelState::kFree);
  map.insertScan(scan);
  map.clear();
  EXPECT_EQ(map.tree().size(), 0U);
  map.insertScan(scan);
  EXPECT_EQ(map.statistics().occupied_cells, 1U);
}

// The same cells in the same nodes, and the same reports.
TEST(WorkerPool, AnyNumberOfThreadsMakesTheSameMap) {
  for (const bool expansion : {false, true}) {
    std::vector<OccupancyMap> maps;
    for (const int threads : {1, 2, 3, 8}) {
      Options o = options(expansion ? 0.2 : 0.06);
      o.threads = threads;
      o.reflectivity = expansion;
      if (expansion) o.fusion_strategy = FusionStrategy::kExpansion;
      maps.emplace_back(o);
    }
    RandomScans scans(24);
    for (int i = 0; i < 15; ++i) {
      Scan scan = scans.next(expansion ? 300 : 3000);
      if (expansion) scan.reflectivity.assign(scan.hits.size(), 0.1F * static_cast<float>(i));
      std::vector<std::vector<Block>> changed;
      for (OccupancyMap& map : maps) changed.push_back(map.insertScan(scan).changed_blocks);
      for (const auto& blocks : changed) EXPECT_EQ(blocks, changed[0]);
      if (i % 4 != 3) continue;
      std::vector<std::vector<Cell>> cells(maps.size());
      for (std::size_t k = 0; k < maps.size(); ++k) {
        maps[k].tree().visitAll([&](const Cell& c) {
          cells[k].push_back(c);
          return true;
        });
      }
      for (const auto& other : cells) {
        ASSERT_EQ(other.size(), cells[0].size());
        for (std::size_t c = 0; c < other.size(); ++c) {
          EXPECT_TRUE(other[c].box == cells[0][c].box);
          EXPECT_EQ(other[c].log_odds, cells[0][c].log_odds);
          EXPECT_EQ(other[c].reflectivity.hits, cells[0][c].reflectivity.hits);
        }
      }
    }
  }
}

TEST(WorkerPool, DoesAllWorkOnceAndPassesExceptionsOn) {
  WorkerPool pool(3);
  EXPECT_EQ(pool.size(), 3);
  for (int round = 0; round < 20; ++round) {
    std::vector<int> done(100);
    pool.run(done.size(), 2, [&done](std::size_t i, int) { ++done[i]; });
    EXPECT_EQ(done, std::vector<int>(100, 1));
  }
  EXPECT_THROW(pool.run(10, 2,
                        [](std::size_t i, int) {
                          if (i == 7) throw std::runtime_error("seven");
                        }),
               std::runtime_error);
  pool.run(0, 2, [](std::size_t, int) { FAIL(); });
  EXPECT_GE(WorkerPool(0).size(), 1);
}

// Where the processor has no vector instructions, both are the portable ones.
TEST(RowKernels, SayTheSameWithVectorInstructions) {
  constexpr int kVoxels = kBlockRows * kBlockSize;
  const LogOddsModel model{Options()};
  const RowKernels &portable = portableRowKernels(), &chosen = rowKernels();
  std::mt19937 random(31 + testSeed());
  const auto number = [&] { return model.min + 0.25F * static_cast<float>(1 + random() % 16); };
  for (int round = 0; round < 20; ++round) {
    BlockRows rows;
    for (std::uint32_t& row : rows) row = round % 4 == 0 ? ~0u : random() % 4 == 0 ? 0 : random() & random();
    std::vector<float> packed(kVoxels + 1);
    std::generate(packed.begin(), packed.end(), number);
    std::vector<float> dense(kVoxels + kRowOverhang, -1.0F), expected(dense);
    portable.unpack(rows, packed.data(), expected.data());
    chosen.unpack(rows, packed.data(), dense.data());
    for (int i = 0; i < kVoxels; ++i) {
      if ((rows[i / kBlockSize] >> i % kBlockSize & 1) != 0) {
        ASSERT_EQ(dense[i], expected[i]);
      }
    }
    std::array<BlockRows, 3> linked{}, expected_linked{};
    portable.link(rows, expected.data(), expected_linked);
    chosen.link(rows, dense.data(), linked);
    EXPECT_EQ(linked, expected_linked);

    for (int row = 0; row < kBlockRows; ++row) {
      const std::uint32_t low = random() & ~rows[row], high = random() & ~(rows[row] | low), a = random();
      const std::uint32_t hit = a & random() & ~high, miss = ~a & random() & ~low;
      float out[kBlockSize + kRowOverhang], expected_out[kBlockSize + kRowOverhang];
      RowUpdate r{low, high, rows[row], packed.data(), out},
          e{low, high, rows[row], packed.data(), expected_out};
      chosen.update(r, hit, miss, model);
      portable.update(e, hit, miss, model);
      ASSERT_EQ(std::make_tuple(r.low, r.high, r.between, r.in - packed.data()),
                std::make_tuple(e.low, e.high, e.between, e.in - packed.data()));
      ASSERT_EQ(std::vector<float>(out, r.out), std::vector<float>(expected_out, e.out));
    }
  }
}

TEST(RowKernels, FindTheSameVoxels) {
  std::mt19937 random(7 + testSeed());
  std::vector<float> coordinates = {0.0F,   -0.0F,         1e-45F,    -1e-45F,   1e38F,
                                    -1e38F, std::nanf(""), HUGE_VALF, -HUGE_VALF};
  std::uniform_real_distribution<float> near(-10.0F, 10.0F), far(-20000.0F, 20000.0F);
  for (const double resolution : {0.05, 0.2, 1.0 / 3.0, 0.25}) {
    for (const int limit : {kMinVoxel, kMaxVoxel, -1, 0, 1}) {  // borders of voxels, and their neighbours
      const auto border = static_cast<float>(limit * resolution);
      coordinates.insert(coordinates.end(),
                         {border, std::nextafter(border, HUGE_VALF), std::nextafter(border, -HUGE_VALF)});
    }
    for (int i = 0; i < 1000; ++i) coordinates.push_back(i % 2 == 0 ? near(random) : far(random));
    for (int i = 0; i < 200; ++i)
      coordinates.push_back(static_cast<float>((static_cast<int>(random() % 2000) - 1000) * resolution));
    for (const std::size_t count : {coordinates.size(), std::size_t{5}, std::size_t{8}}) {
      std::vector<int> expected(count + 1, 77), actual(count + 1, 77);
      portableRowKernels().to_voxels(coordinates.data(), count, 1.0 / resolution, expected.data());
      rowKernels().to_voxels(coordinates.data(), count, 1.0 / resolution, actual.data());
      EXPECT_EQ(expected, actual);
      EXPECT_EQ(77, actual.back());
      for (std::size_t i = 0; i < count; ++i) {
        const double c = std::floor(static_cast<double>(coordinates[i]) * (1.0 / resolution));
        ASSERT_EQ(c >= kMinVoxel && c < kMaxVoxel ? static_cast<int>(c) : kMaxVoxel, actual[i])
            << coordinates[i];
      }
    }
  }
}

// Where a beam meets edges and corners of voxels, the order of the steps decides what it crosses.
TEST(BeamTracer, EqualsAPlainGridAtEdgesAndCorners) {
  for (const float offset : {0.0F, 0.125F, 0.25F}) {  // corner, in between, centre
    Options o = options();
    o.resolution = 0.5;
    OccupancyMap map(o);
    PlainGrid grid(o);
    std::mt19937 random(3 + testSeed());
    std::uniform_int_distribution<int> cell(-60, 60);
    for (int i = 0; i < 4; ++i) {
      Scan scan;
      scan.origin = Eigen::Vector3f(0.5F * cell(random), 0.5F * cell(random), 0.5F * cell(random)) +
                    Eigen::Vector3f::Constant(offset);
      for (int k = 0; k < 300; ++k) {
        const Eigen::Vector3f step(cell(random), cell(random), k % 3 == 0 ? 0.0F : cell(random));
        scan.hits.push_back(scan.origin + (k % 2 == 0 ? 0.25F : 0.5F) * step);
      }
      for (const float far : {-40.0F, -3.0F, 7.0F, 33.0F}) {  // along axes and diagonals
        scan.hits.push_back(scan.origin + Eigen::Vector3f(far, 0.0F, 0.0F));
        scan.hits.push_back(scan.origin + Eigen::Vector3f(0.0F, far, far));
        scan.hits.push_back(scan.origin + Eigen::Vector3f(far, -far, far));
      }
      map.insertScan(scan);
      grid.insert(scan);
    }
    expectEqual(map, grid);
  }
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
