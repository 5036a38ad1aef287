// SPDX-License-Identifier: BSD-3-Clause
//
// The tables: `options` by their names, as words; `blocks` with coordinates and summaries; `cells` with one
// blob for each block. A cell takes 8 bytes, with reflectivity 16, little endian: its min corner and the
// voxel at its max corner in the block, 5 bits each (x y z, x y z), log odds as float32, mean reflectivity as
// float32, hits as uint32.
#include "block_store.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "block_index.h"
#include "block_rows.h"
#include "log_odds.h"
#include "machine_options.h"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "cells are written as they are in memory");

namespace rtree_occupancy_map {
namespace {

using mapping_common::Database;

constexpr mapping_common::DatabaseFormat kFormat = {0x52545245, 1,  // "RTRE"
                                                    "a store of an R-tree occupancy map"};

constexpr const char* kTables =
    "CREATE TABLE options(name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE blocks(id INTEGER PRIMARY KEY, x INTEGER NOT NULL, y INTEGER NOT NULL, z INTEGER NOT NULL,"
    " box BLOB NOT NULL, cells INTEGER NOT NULL, occupied_cells INTEGER NOT NULL,"
    " occupied_voxels INTEGER NOT NULL, free_voxels INTEGER NOT NULL);"
    "CREATE TABLE cells(id INTEGER PRIMARY KEY, data BLOB NOT NULL);";

std::uint32_t pack(const VoxelBox& box, const VoxelBox& block) {
  std::uint32_t word = 0;
  for (int i = 0; i < 3; ++i) {
    word |= static_cast<std::uint32_t>(box.min[i] - block.min[i]) << kBlockBits * i;
    word |= static_cast<std::uint32_t>(box.max[i] - 1 - block.min[i]) << kBlockBits * (i + 3);
  }
  return word;
}

VoxelBox unpack(std::uint32_t word, const VoxelBox& block) {
  VoxelBox box;
  for (int i = 0; i < 3; ++i) {
    const auto at = [&](int k) { return static_cast<int>(word >> kBlockBits * k & (kBlockSize - 1)); };
    box.min[i] = static_cast<std::int16_t>(block.min[i] + at(i));
    box.max[i] = static_cast<std::int16_t>(block.min[i] + at(i + 3) + 1);
  }
  return box;
}

std::int64_t idOf(const Block& block) {
  return static_cast<std::int64_t>(keyOf(block));
}

}  // namespace

BlockStore::BlockStore(const std::string& path, Database::Access access)
    : writes_(access != Database::Access::kRead), database_(path, kFormat, access) {}

std::unique_ptr<BlockStore> BlockStore::open(const std::string& path, Access access) {
  std::unique_ptr<BlockStore> store(
      new BlockStore(path, access == Access::kWrite ? Database::Access::kWrite : Database::Access::kRead));
  if (store->writes_) store->database_.execute("PRAGMA synchronous=NORMAL");
  store->prepareAll();
  return store;
}

void BlockStore::prepareAll() {
  const Options o = options();
  occupied_log_odds_ = logOdds(o.occupancy_threshold);
  min_log_odds_ = logOdds(o.clamping_min);
  max_log_odds_ = logOdds(o.clamping_max);
  reflectivity_ = o.reflectivity;
  read_ = database_.prepare("SELECT data FROM cells WHERE id = ?");
  if (!writes_) return;
  write_summary_ = database_.prepare("INSERT OR REPLACE INTO blocks VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?)");
  write_cells_ = database_.prepare("INSERT OR REPLACE INTO cells VALUES(?, ?)");
  erase_summary_ = database_.prepare("DELETE FROM blocks WHERE id = ?");
  erase_cells_ = database_.prepare("DELETE FROM cells WHERE id = ?");
}

void BlockStore::create(const std::string& path, const OccupancyMap& map) {
  if (map.options().color)
    throw std::runtime_error(path + " was not written: color is true, and a store has no colours");
  const std::string part = path + ".part";
  std::remove(part.c_str());
  {
    BlockStore store(part, Database::Access::kCreate);
    const Database& database = store.database_;
    database.execute("PRAGMA journal_mode=OFF");  // of no use before it has its name
    database.createTables(kTables);
    database.execute("BEGIN");
    {
      Options options = withMachine(map.options(), Options());
      const Database::Statement insert = database.prepare("INSERT INTO options VALUES(?, ?)");
      for (const mapping_common::Option& option : optionsInFiles(options)) {
        const std::string name = option.name(), word = option.word();
        (Database::Use(database, insert) << name << word).next();
      }
    }
    store.prepareAll();
    std::vector<Cell> cells;
    for (const Block& block : map.blocks()) {
      cells.clear();
      map.visitBlock(block, [&cells](const Cell& cell) {
        cells.push_back(cell);
        return true;
      });
      store.write(block, cells);
    }
    database.execute("COMMIT; PRAGMA journal_mode=WAL");
  }
  // The log of an older store must not be taken for this one's.
  for (const char* ending : {"-wal", "-shm"}) std::remove((path + ending).c_str());
  std::error_code error;
  std::filesystem::rename(part, path, error);
  if (error) throw std::runtime_error(path + " can't be written: " + error.message());
}

Options BlockStore::options() const {
  Options options;
  mapping_common::OptionList list = mapping_common::optionsOf(options);
  const Database::Statement select = database_.prepare("SELECT name, value FROM options");
  Database::Use rows(database_, select);
  try {
    while (rows.next()) {
      const std::string name = rows.bytes(0);
      mapping_common::Option* option = list.find(name);
      if (option == nullptr)
        database_.fail("it was built with " + name + ", which this program doesn't know");
      option->parse(rows.bytes(1));
    }
    return mapping_common::validate(options);
  } catch (const std::invalid_argument& e) {
    database_.fail(e.what());
  }
}

void BlockStore::visitSummaries(const std::function<void(const Block&, const BlockSummary&)>& visit) const {
  const Database::Statement select = database_.prepare(
      "SELECT x, y, z, box, cells, occupied_cells, occupied_voxels, free_voxels FROM blocks");
  Database::Use rows(database_, select);
  while (rows.next()) {
    const auto count = [&rows](int column) { return static_cast<std::uint32_t>(rows.number(column)); };
    const Block block = {static_cast<int>(rows.number(0)), static_cast<int>(rows.number(1)),
                         static_cast<int>(rows.number(2))};
    BlockSummary s;
    const std::string box = rows.bytes(3);
    if (box.size() == sizeof(s.box)) std::memcpy(&s.box, box.data(), sizeof(s.box));
    if (s.box.isEmpty() || !OccupancyMap::boxOf(block).contains(s.box))
      database_.fail("it is corrupted: a block's box");
    s.cells = count(4);
    s.occupied_cells = count(5);
    s.occupied_volume = count(6);
    s.free_volume = count(7);
    visit(block, s);
  }
}

std::vector<Cell> BlockStore::read(const Block& block) const {
  Database::Use use(database_, read_);
  use << idOf(block);
  const auto corrupted = [this](const char* what) {
    database_.fail(std::string("it is corrupted: ") + what);
  };
  if (!use.next()) corrupted("a block's cells are missing");
  const std::string data = use.bytes(0);
  const std::size_t size = reflectivity_ ? 16 : 8;
  if (data.size() % size != 0) corrupted("a block's cells have an odd size");
  const VoxelBox block_box = OccupancyMap::boxOf(block);
  std::vector<Cell> cells(data.size() / size);
  BlockRows taken{};
  for (std::size_t i = 0; i < cells.size(); ++i) {
    Cell& cell = cells[i];
    std::uint32_t corners;
    std::memcpy(&corners, &data[size * i], 4);
    std::memcpy(&cell.log_odds, &data[size * i + 4], 4);
    if (reflectivity_) std::memcpy(&cell.reflectivity, &data[size * i + 8], 8);
    cell.box = unpack(corners, block_box);
    if (cell.box.isEmpty() || !(cell.log_odds >= min_log_odds_ && cell.log_odds <= max_log_odds_) ||
        (cell.reflectivity.hits > 0 && !std::isfinite(cell.reflectivity.mean)))
      corrupted("a cell is out of range");
    const VoxelBox local = localBox(cell.box, block_box);
    const std::uint32_t column = bits(local.min[2], local.max[2]);
    for (int y = local.min[1]; y < local.max[1]; ++y) {
      for (int x = local.min[0]; x < local.max[0]; ++x) {
        std::uint32_t& row = taken[y * kBlockSize + x];
        if ((row & column) != 0) corrupted("cells overlap");
        row |= column;
      }
    }
  }
  return cells;
}

BlockSummary BlockStore::write(const Block& block, const std::vector<Cell>& cells) {
  if (cells.empty()) {
    for (const Database::Statement* erase : {&erase_summary_, &erase_cells_})
      (Database::Use(database_, *erase) << idOf(block)).next();
    return {};
  }
  const VoxelBox block_box = OccupancyMap::boxOf(block);
  const std::size_t size = reflectivity_ ? 16 : 8;
  std::string data(size * cells.size(), '\0');
  BlockSummary s;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const Cell& cell = cells[i];
    const std::uint32_t corners = pack(cell.box, block_box);
    std::memcpy(&data[size * i], &corners, 4);
    std::memcpy(&data[size * i + 4], &cell.log_odds, 4);
    if (reflectivity_) std::memcpy(&data[size * i + 8], &cell.reflectivity, 8);
    s.box = unite(s.box, cell.box);
    const bool occupied = cell.log_odds >= occupied_log_odds_;
    s.occupied_cells += occupied;
    (occupied ? s.occupied_volume : s.free_volume) += static_cast<std::uint32_t>(cell.box.volume());
  }
  s.cells = static_cast<std::uint32_t>(cells.size());
  {
    Database::Use use(database_, write_summary_);
    use << idOf(block) << block[0] << block[1] << block[2];
    use.blob(&s.box, sizeof(s.box));
    use << s.cells << s.occupied_cells << s.occupied_volume << s.free_volume;
    use.next();
  }
  Database::Use use(database_, write_cells_);
  use << idOf(block);
  use.blob(data.data(), data.size()).next();
  return s;
}

void BlockStore::clear() {
  transaction([this] { database_.execute("DELETE FROM blocks; DELETE FROM cells"); });
}

}  // namespace rtree_occupancy_map
