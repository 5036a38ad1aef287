// SPDX-License-Identifier: BSD-3-Clause
//
// Blocks go to a file and come back: nobody may notice, and nothing may get lost.
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>

#include "block_store.h"
#include "random_queries.h"
#include "rtree_occupancy_map/octomap_file.h"
#include "rtree_occupancy_map/window.h"

namespace rtree_occupancy_map {
namespace {

using mapping_common::mentions;
using mapping_common::TempDir;

Options options(FusionStrategy strategy = FusionStrategy::kBlock) {
  Options o;
  o.resolution = 0.1;
  o.threads = 1;
  o.working_set_memory = 0.1;
  o.fusion_strategy = strategy;
  o.reflectivity = strategy == FusionStrategy::kExpansion;
  return o;
}

WindowOptions window(const std::string& file, double distance, double memory) {
  WindowOptions w;
  w.file = file;
  w.distance = distance;
  w.memory = memory;
  return w;
}

Scan withReflectivity(Scan scan, const Options& o) {
  if (!o.reflectivity) return scan;
  for (std::size_t i = 0; i < scan.hits.size(); ++i)
    scan.reflectivity.push_back(0.01F * static_cast<float>(i % 100));
  return scan;
}

std::string exec(const std::string& file, const std::string& sql) {
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  std::string result;
  const auto collect = [](void* to, int count, char** values, char**) {
    for (int i = 0; i < count; ++i)
      *static_cast<std::string*>(to) += values[i] != nullptr ? values[i] : "NULL";
    return 0;
  };
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), collect, &result, nullptr), SQLITE_OK)
      << sqlite3_errmsg(database);
  sqlite3_close(database);
  return result;
}

std::string messageOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "nothing was thrown";
}

// Without a memory, with room for a few blocks, and by distance.
constexpr std::pair<double, double> kWindows[] = {{0.0, 0.0}, {1e6, 0.05}, {3.0, 100.0}};

TEST(RollingWindow, QueriesBetweenScansSeeNoDifference) {
  const Options o = options();
  const TempDir dir;
  OccupancyMap current(o);
  std::vector<OccupancyMap> maps;
  for (const auto& [distance, memory] : kWindows) {
    maps.emplace_back(o);
    maps.back().keepIn(window(dir.path(std::to_string(maps.size()) + ".db"), distance, memory));
  }
  PlainGrid grid(o);
  RandomScans scans(31);
  Asker asker(7 + testSeed());
  std::mt19937 random(8 + testSeed());
  for (int i = 0; i < 25; ++i) {
    const Scan scan = scans.next(i < 20 ? 200 : 30);
    grid.insert(scan);
    const auto report = current.insertScan(scan);
    for (OccupancyMap& map : maps) {
      EXPECT_EQ(map.insertScan(scan).changed_blocks, report.changed_blocks);
      for (unsigned k = random() % 5; k > 0; --k) asker.ask(map, grid, current);
    }
  }
  const auto cells = cellsOf(current);
  for (std::size_t i = 0; i < maps.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_TRUE(cellsOf(maps[i]) == cells);
    for (const OctomapFormat format : {OctomapFormat::kBinary, OctomapFormat::kFull})
      EXPECT_TRUE(toOctomap(maps[i], format).bytes == toOctomap(current, format).bytes);
    maps[i].save(dir.path("a.map"));
    EXPECT_TRUE(cellsOf(OccupancyMap::load(dir.path("a.map"))) == cells);
    maps[i].save(dir.path("copy.db"));
    EXPECT_TRUE(cellsOf(OccupancyMap::load(dir.path("copy.db"))) == cells);
    expectEqual(maps[i], grid);  // all cells are in memory from here on
    EXPECT_TRUE(cellsOf(maps[i]) == cells);
  }
}

// Reflectivities, and cells that depend on those before them; boxes are cleared, and the program ends in
// between.
TEST(RollingWindow, GoesOnWhereItEnded) {
  for (const FusionStrategy strategy : {FusionStrategy::kBlock, FusionStrategy::kExpansion}) {
    for (const auto& [distance, memory] : kWindows) {
      SCOPED_TRACE(distance);
      Options o = options(strategy);
      o.samples_per_metre = 0.0;  // at random, which isn't stored
      const TempDir dir;
      const WindowOptions w = window(dir.path("a.db"), distance, memory);
      OccupancyMap map(o), expected(o);
      RandomScans scans(32);
      for (int i = 0; i < 16; ++i) {
        if (i == 3) map.keepIn(w);  // with what it has
        if (i == 7) map = OccupancyMap();
        if (i == 7) map = OccupancyMap::open(w, o);
        if (i == 11) map.clear();
        if (i == 11) expected.clear();
        const Scan scan = withReflectivity(scans.next(150), o);
        EXPECT_EQ(map.insertScan(scan).changed_blocks, expected.insertScan(scan).changed_blocks);
        const Eigen::Vector3d corner(i % 5 - 3.0, i % 3 - 2.0, -1.0);
        EXPECT_EQ(map.clearBox(corner, corner + Eigen::Vector3d(1.0, 0.5, 2.0)),
                  expected.clearBox(corner, corner + Eigen::Vector3d(1.0, 0.5, 2.0)));
        EXPECT_TRUE(cellsOf(map) == cellsOf(expected)) << i;
      }
      map.flush();
      EXPECT_TRUE(mapping_common::same(OccupancyMap::load(w.file, o).options(), map.options()));
      EXPECT_TRUE(cellsOf(OccupancyMap::load(w.file)) == cellsOf(expected));
    }
  }
}

TEST(RollingWindow, ForgetsWhatIsBeyondItToo) {
  for (const auto& [distance, memory] : kWindows) {
    Options o = options();
    o.decay_time = 3.0;
    const TempDir dir;
    const WindowOptions w = window(dir.path("a.db"), distance, memory);
    OccupancyMap map(o), expected(o);
    RandomScans scans(39);
    map.keepIn(w);
    for (int i = 0; i < 12; ++i) {
      Scan scan = scans.next(i % 4 == 0 ? 150 : 10);
      scan.time = 100.0 + 0.4 * i;
      EXPECT_EQ(map.insertScan(scan).changed_blocks, expected.insertScan(scan).changed_blocks);
      EXPECT_TRUE(cellsOf(map) == cellsOf(expected)) << i;
    }
    Scan last;
    last.origin = {50.0F, 0.0F, 0.0F};
    last.hits = {{51.05F, 0.05F, 0.05F}};
    last.time = 200.0;
    map = OccupancyMap();
    map = OccupancyMap::open(w, o);
    map.insertScan(last);  // time begins anew
    expected.insertScan(last);
    EXPECT_GT(map.statistics().occupied_cells, expected.statistics().occupied_cells);
    last.time = 204.0;
    map.insertScan(last);
    expected.insertScan(last);
    EXPECT_TRUE(cellsOf(map) == cellsOf(expected));
    EXPECT_EQ(map.statistics().occupied_cells, 1U);
  }
}

// A beam of a few metres at each step of a long way.
Scan scanAt(int step) {
  Scan scan;
  scan.origin = {0.05F + 2.0F * static_cast<float>(step), 0.05F, 0.05F};
  for (int i = 0; i < 400; ++i) {
    const float a = 0.0157F * static_cast<float>(i);
    scan.hits.emplace_back(scan.origin + Eigen::Vector3f(4.0F * std::cos(a), 4.0F * std::sin(a),
                                                         0.01F * static_cast<float>(i % 97)));
  }
  return scan;
}

TEST(RollingWindow, MemoryDoesNotGrowWithTheWay) {
  const TempDir dir;
  for (const auto& [distance, memory] : {std::make_pair(6.0, 100.0), std::make_pair(1e6, 0.3)}) {
    Options o = options();
    o.working_set_memory = 0.0;
    OccupancyMap all(o), map(o);
    map.keepIn(window(dir.path("a.db"), distance, memory));
    std::size_t early = 0;
    for (int step = 0; step < 400; ++step) {
      map.insertScan(scanAt(step));
      all.insertScan(scanAt(step));
      if (step == 40) early = map.memoryUsage();
    }
    EXPECT_EQ(map.size(), all.size());
    EXPECT_GT(all.memoryUsage(), 10 * early);
    EXPECT_LT(map.memoryUsage(), early + 100 * map.blocks().size());  // what is kept of each block
    if (distance > 1e3) {
      EXPECT_LT(map.memoryUsage(), 0.5 * (1 << 20) + 200.0 * static_cast<double>(map.blocks().size()));
    }
    // All of it is asked, and read, without staying.
    const std::size_t before = map.memoryUsage();
    EXPECT_TRUE(cellsOf(map) == cellsOf(all));
    EXPECT_LT(map.memoryUsage(), before + (1 << 20) * std::min(30.0, memory));
    EXPECT_EQ(map.castRay({-50.0, 0.05, 0.05}, {1.0, 0.0, 0.0}, 1e4).point,
              all.castRay({-50.0, 0.05, 0.05}, {1.0, 0.0, 0.0}, 1e4).point);
  }
}

// Each block in the store is what it was after one of the scans.
TEST(RollingWindow, IsReadableWheneverItWasKilled) {
  const Options o = options();
  const int count = 12;
  std::vector<Scan> scans;
  OccupancyMap reference(o);
  RandomScans random(33);
  std::set<std::vector<CellBits>> states;  // that blocks have had
  for (int i = 0; i < count; ++i) {
    scans.push_back(random.next(150));
    for (const Block& block : reference.insertScan(scans.back()).changed_blocks)
      states.insert(cellsOf(reference, OccupancyMap::boxOf(block)));
  }
  std::mt19937 generator(34 + testSeed());
  std::size_t blocks = 0, unfinished = 0;
  for (int round = 0; round < 15; ++round) {
    const TempDir dir;
    const WindowOptions w = window(dir.path("a.db"), 0.0, 0.0);
    OccupancyMap(o).save(w.file);
    const pid_t child = fork();
    if (child == 0) {
      OccupancyMap map = OccupancyMap::open(w, o);
      for (const Scan& scan : scans) map.insertScan(scan);
      for (;;) pause();
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(generator() % 150));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    const OccupancyMap map = OccupancyMap::load(w.file);
    for (const Block& block : map.blocks()) {
      EXPECT_EQ(states.count(cellsOf(map, OccupancyMap::boxOf(block))), 1U);
      ++blocks;
    }
    unfinished += map.size() != reference.size();
    EXPECT_EQ(exec(w.file, "PRAGMA integrity_check"), "ok");
    OccupancyMap again = OccupancyMap::open(w, o);  // and goes on
    again.insertScan(scans[0]);
  }
  EXPECT_GT(blocks, 20U);
  EXPECT_GT(unfinished, 3U);
}

TEST(RollingWindow, LosesNothingWhereTheDiskIsFull) {
  const TempDir dir;
  const Options o = options();
  OccupancyMap map(o), expected(o);
  map.keepIn(window(dir.path("a.db"), 0.0, 0.0));
  RandomScans scans(35);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = signal(SIGXFSZ, SIG_IGN);
  int failed = 0;
  for (int i = 0; i < 12; ++i) {
    const Scan scan = scans.next(200);
    expected.insertScan(scan);
    rlimit limit = before;
    if (i >= 4 && i < 8) limit.rlim_cur = 20000;
    setrlimit(RLIMIT_FSIZE, &limit);
    const std::string error = map.insertScan(scan).window_error;
    setrlimit(RLIMIT_FSIZE, &before);
    if (error.empty()) continue;
    ++failed;
    EXPECT_TRUE(mentions(error, {"a.db: "}));
  }
  signal(SIGXFSZ, handler);
  EXPECT_GT(failed, 1);
  EXPECT_TRUE(cellsOf(map) == cellsOf(expected));
  map.flush();
  EXPECT_TRUE(cellsOf(OccupancyMap::load(dir.path("a.db"))) == cellsOf(expected));
}

TEST(RollingWindow, LeavesAStoreAloneThatItOnlyReads) {
  const TempDir dir;
  const Options o = options();
  RandomScans scans(36);
  OccupancyMap map(o);
  for (int i = 0; i < 5; ++i) map.insertScan(scans.next(200));
  map.save(dir.path("a.db"));
  const auto bytes = [&dir] {
    std::ifstream in(dir.path("a.db"), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const std::string before = bytes();
  OccupancyMap loaded = OccupancyMap::load(dir.path("a.db"), o);
  for (int i = 0; i < 5; ++i) {
    const Scan scan = scans.next(200);
    map.insertScan(scan);
    loaded.insertScan(scan);
  }
  EXPECT_TRUE(cellsOf(loaded) == cellsOf(map));
  loaded.flush();
  EXPECT_EQ(bytes(), before);
  // Two at a time: the one that reads sees what was there when it began.
  OccupancyMap writes = OccupancyMap::open(window(dir.path("a.db"), 0.0, 0.0), o);
  const OccupancyMap reads = OccupancyMap::load(dir.path("a.db"), o);
  const auto cells = cellsOf(writes);
  writes.insertScan(scans.next(200));
  writes.flush();
  EXPECT_TRUE(cellsOf(reads) == cells);
}

// As on a medium that can't be written.
TEST(RollingWindow, ReadsWhereNothingCanBeWritten) {
  if (geteuid() == 0) GTEST_SKIP() << "for root all can be written";
  const TempDir dir;
  OccupancyMap map(options());
  RandomScans scans(38);
  map.insertScan(scans.next(200));
  std::filesystem::create_directory(dir.path("50% off?"));
  const std::string path = dir.path("50% off?/a.db");
  map.save(path);
  std::filesystem::permissions(dir.path("50% off?"),
                               std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  EXPECT_TRUE(cellsOf(OccupancyMap::load(path)) == cellsOf(map));
  EXPECT_NE(messageOf([&] { OccupancyMap::open(window(path, 0.0, 0.0)).insertScan(scans.next(200)); }),
            "nothing was thrown");
  std::filesystem::permissions(dir.path("50% off?"), std::filesystem::perms::owner_all);
}

TEST(RollingWindow, RefusesFilesThatAreNoStores) {
  const TempDir dir;
  const auto refusal = [](const std::string& path) {
    return messageOf([&path] {
      const OccupancyMap map = OccupancyMap::load(path);
      map.visitAll([](const Cell&) { return true; });
    });
  };
  EXPECT_TRUE(mentions(refusal("/nowhere/a.db"), {"/nowhere/a.db", "unable to open"}));
  EXPECT_TRUE(mentions(refusal(dir.write("text.db", std::string(5000, 'x'))),
                       {"text.db", "isn't a store of an R-tree"}));
  exec(dir.path("other.db"), "CREATE TABLE t(x)");
  EXPECT_TRUE(mentions(refusal(dir.path("other.db")), {"other.db", "isn't a store of an R-tree"}));
  EXPECT_TRUE(mentions(messageOf([] { OccupancyMap().save("/nowhere/a.db"); }), {"/nowhere/a.db"}));

  OccupancyMap map(options());
  RandomScans scans(37);
  map.insertScan(scans.next(200));
  const std::string path = dir.path("a.db");
  const auto refuses = [&](const std::string& sql, const std::string& message) {
    map.save(path);
    EXPECT_EQ(refusal(path), "nothing was thrown");
    exec(path, sql);
    EXPECT_TRUE(mentions(refusal(path), {path.c_str(), message.c_str()})) << sql;
  };
  refuses("PRAGMA user_version=7", "its version is 7");
  refuses("DELETE FROM cells", "cells are missing");
  refuses("UPDATE cells SET data = substr(data, 1, length(data) - 3)", "odd size");
  refuses("UPDATE cells SET data = data || substr(data, 1, 8)", "cells overlap");
  refuses("UPDATE cells SET data = data || x'0000000000007f7f'", "out of range");
  refuses("UPDATE blocks SET box = x'00'", "a block's box");
  refuses("UPDATE blocks SET x = x + 1", "a block's box");
  refuses("UPDATE options SET value = '-1' WHERE name = 'resolution'", "resolution is -1");
  refuses("INSERT INTO options VALUES('from_the_future', '1')", "from_the_future");
  refuses("DROP TABLE cells", "no such table");
}

}  // namespace
}  // namespace rtree_occupancy_map

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
