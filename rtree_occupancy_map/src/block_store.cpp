// SPDX-License-Identifier: BSD-3-Clause
//
// The tables: `options` by their names, as words; `blocks` with coordinates and summaries; `cells` with one
// blob for each block. A cell takes 8 bytes, with reflectivity 16, little endian: its min corner and the
// voxel at its max corner in the block, 5 bits each (x y z, x y z), log odds as float32, mean reflectivity as
// float32, hits as uint32.
#include "block_store.h"

#include <sqlite3.h>

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

constexpr std::int64_t kApplication = 0x52545245;  // "RTRE", in SQLite's header
constexpr std::int64_t kVersion = 1;
constexpr int kBusy = 10000;  // ms that another program may hold the file

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

// A statement from its first value to its end.
class BlockStore::Use {
 public:
  Use(const BlockStore& store, const Statement& statement) : store_(store), statement_(statement.get()) {}
  ~Use() {
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
  }
  Use(const Use&) = delete;
  Use& operator=(const Use&) = delete;

  Use& operator<<(std::int64_t value) { return check(sqlite3_bind_int64(statement_, ++bound_, value)); }
  Use& operator<<(const std::string& text) {
    return check(
        sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()), nullptr));
  }
  /// Valid until the end.
  Use& blob(const void* data, std::size_t size) {
    return check(sqlite3_bind_blob64(statement_, ++bound_, data, size, nullptr));
  }
  bool next() {
    const int result = sqlite3_step(statement_);
    if (result != SQLITE_ROW && result != SQLITE_DONE) store_.failSql();
    return result == SQLITE_ROW;
  }
  std::int64_t number(int column) const { return sqlite3_column_int64(statement_, column); }
  std::string bytes(int column) const {
    const void* data = sqlite3_column_blob(statement_, column);
    const int size = sqlite3_column_bytes(statement_, column);
    return size == 0 ? std::string()
                     : std::string(static_cast<const char*>(data), static_cast<std::size_t>(size));
  }

 private:
  Use& check(int result) {
    if (result != SQLITE_OK) store_.failSql();
    return *this;
  }
  const BlockStore& store_;
  sqlite3_stmt* statement_;
  int bound_ = 0;
};

void BlockStore::Finalize::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}
void BlockStore::Close::operator()(sqlite3* database) const {
  sqlite3_close(database);
}

void BlockStore::fail(const std::string& what) const {
  throw std::runtime_error(path_ + ": " + what);
}
void BlockStore::failSql() const {
  fail(sqlite3_errmsg(database_.get()));
}

BlockStore::Statement BlockStore::prepare(const char* sql) const {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(database_.get(), sql, -1, &statement, nullptr) != SQLITE_OK) failSql();
  return Statement(statement);
}

void BlockStore::execute(const char* sql) const {
  if (sqlite3_exec(database_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) failSql();
}

std::int64_t BlockStore::number(const char* sql) const {
  const Statement statement = prepare(sql);
  Use use(*this, statement);
  return use.next() ? use.number(0) : 0;
}

BlockStore::BlockStore(const std::string& path, int flags, const std::string& uri) : path_(path) {
  sqlite3* database = nullptr;
  const int result = sqlite3_open_v2((uri.empty() ? path : uri).c_str(), &database,
                                     flags | (uri.empty() ? 0 : SQLITE_OPEN_URI), nullptr);
  database_.reset(database);
  if (result != SQLITE_OK) fail(database != nullptr ? sqlite3_errmsg(database) : "there is no memory for it");
  sqlite3_busy_timeout(database, kBusy);
}

std::unique_ptr<BlockStore> BlockStore::open(const std::string& path, Access access) {
  std::unique_ptr<BlockStore> store(new BlockStore(path, SQLITE_OPEN_READWRITE, ""));
  store->writes_ = access == Access::kWrite;
  if (!store->writes_ && !store->isAccessible()) {
    // In a folder where nothing can be written there is no place for a log, and nobody else who writes.
    std::string uri = "file:";
    for (const char c : path) {
      const bool special = c == '%' || c == '?' || c == '#';
      uri += !special ? std::string(1, c) : c == '%' ? "%25" : c == '?' ? "%3f" : "%23";
    }
    store.reset(new BlockStore(path, SQLITE_OPEN_READONLY, uri + "?immutable=1"));
  }
  store->start();
  return store;
}

bool BlockStore::isAccessible() const {
  const int result = sqlite3_exec(database_.get(), "SELECT 1 FROM sqlite_master", nullptr, nullptr, nullptr);
  return result != SQLITE_CANTOPEN && result != SQLITE_READONLY;
}

void BlockStore::start() {
  if (number("PRAGMA application_id") != kApplication) fail("it isn't a store of an R-tree occupancy map");
  const std::int64_t version = number("PRAGMA user_version");
  if (version != kVersion) {
    fail("its version is " + std::to_string(version) + ", this program reads " + std::to_string(kVersion));
  }
  // A reader doesn't see what others write after it has begun.
  execute(writes_ ? "PRAGMA synchronous=NORMAL" : "PRAGMA query_only=1; BEGIN");
  prepareAll();
}

void BlockStore::prepareAll() {
  const Options o = options();
  occupied_log_odds_ = logOdds(o.occupancy_threshold);
  min_log_odds_ = logOdds(o.clamping_min);
  max_log_odds_ = logOdds(o.clamping_max);
  reflectivity_ = o.reflectivity;
  read_ = prepare("SELECT data FROM cells WHERE id = ?");
  if (!writes_) return;
  write_summary_ = prepare("INSERT OR REPLACE INTO blocks VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?)");
  write_cells_ = prepare("INSERT OR REPLACE INTO cells VALUES(?, ?)");
  erase_summary_ = prepare("DELETE FROM blocks WHERE id = ?");
  erase_cells_ = prepare("DELETE FROM cells WHERE id = ?");
}

void BlockStore::create(const std::string& path, const OccupancyMap& map) {
  const std::string part = path + ".part";
  std::remove(part.c_str());
  {
    BlockStore store(part, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, "");
    store.writes_ = true;
    store.execute("PRAGMA journal_mode=OFF");  // of no use before it has its name
    store.execute("PRAGMA application_id=1381257797; PRAGMA user_version=1; BEGIN");
    static_assert(kApplication == 1381257797 && kVersion == 1);
    store.execute(kTables);
    {
      Options options = withMachine(map.options(), Options());
      const Statement insert = store.prepare("INSERT INTO options VALUES(?, ?)");
      for (const auto& [option, section] : mapping_common::optionsOf(options)) {
        const std::string name = option.name(), word = option.word();
        (Use(store, insert) << name << word).next();
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
    store.execute("COMMIT; PRAGMA journal_mode=WAL");
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
  const Statement select = prepare("SELECT name, value FROM options");
  Use rows(*this, select);
  try {
    while (rows.next()) {
      const std::string name = rows.bytes(0);
      mapping_common::Option* option = list.find(name);
      if (option == nullptr) fail("it was built with " + name + ", which this program doesn't know");
      option->parse(rows.bytes(1));
    }
    return mapping_common::validate(options);
  } catch (const std::invalid_argument& e) {
    fail(e.what());
  }
}

void BlockStore::visitSummaries(const std::function<void(const Block&, const BlockSummary&)>& visit) const {
  const Statement select =
      prepare("SELECT x, y, z, box, cells, occupied_cells, occupied_voxels, free_voxels FROM blocks");
  Use rows(*this, select);
  while (rows.next()) {
    const auto count = [&rows](int column) { return static_cast<std::uint32_t>(rows.number(column)); };
    const Block block = {static_cast<int>(rows.number(0)), static_cast<int>(rows.number(1)),
                         static_cast<int>(rows.number(2))};
    BlockSummary s;
    const std::string box = rows.bytes(3);
    if (box.size() == sizeof(s.box)) std::memcpy(&s.box, box.data(), sizeof(s.box));
    if (s.box.isEmpty() || !OccupancyMap::boxOf(block).contains(s.box))
      fail("it is corrupted: a block's box");
    s.cells = count(4);
    s.occupied_cells = count(5);
    s.occupied_volume = count(6);
    s.free_volume = count(7);
    visit(block, s);
  }
}

std::vector<Cell> BlockStore::read(const Block& block) const {
  Use use(*this, read_);
  use << idOf(block);
  const auto corrupted = [this](const char* what) { fail(std::string("it is corrupted: ") + what); };
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

void BlockStore::transaction(const std::function<void()>& work) {
  execute("BEGIN IMMEDIATE");
  try {
    work();
    execute("COMMIT");
  } catch (...) {
    sqlite3_exec(database_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

BlockSummary BlockStore::write(const Block& block, const std::vector<Cell>& cells) {
  if (cells.empty()) {
    for (const Statement* erase : {&erase_summary_, &erase_cells_})
      (Use(*this, *erase) << idOf(block)).next();
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
    Use use(*this, write_summary_);
    use << idOf(block) << block[0] << block[1] << block[2];
    use.blob(&s.box, sizeof(s.box));
    use << s.cells << s.occupied_cells << s.occupied_volume << s.free_volume;
    use.next();
  }
  Use use(*this, write_cells_);
  use << idOf(block);
  use.blob(data.data(), data.size()).next();
  return s;
}

void BlockStore::clear() {
  transaction([this] { execute("DELETE FROM blocks; DELETE FROM cells"); });
}

}  // namespace rtree_occupancy_map
