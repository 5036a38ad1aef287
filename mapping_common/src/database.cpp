// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/database.h"

#include <sqlite3.h>

#include <stdexcept>

namespace mapping_common {
namespace {

constexpr int kBusy = 10000;  // ms that another program may hold the file

}  // namespace

void Database::Statement::Finalize::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}
void Database::Close::operator()(sqlite3* database) const {
  sqlite3_close_v2(database);
}

void Database::fail(const std::string& what) const {
  throw std::runtime_error(path_ + ": " + what);
}

void Database::failForeign() const {
  fail(std::string("it isn't ") + format_.what + ": choose another file");
}

void Database::failSql() const {
  const int error = sqlite3_errcode(database_.get());
  const std::string text = sqlite3_errmsg(database_.get());
  if (error == SQLITE_NOTADB) failForeign();
  if (error == SQLITE_CORRUPT)
    fail("it is corrupted (" + text +
         "); what can still be read of it, sqlite3's command .recover writes anew");
  fail(text);
}

Database::Database(const std::string& path, const DatabaseFormat& format, Access access)
    : path_(path), format_(format) {
  open(SQLITE_OPEN_READWRITE | (access == Access::kCreate ? SQLITE_OPEN_CREATE : 0), "");
  if (access == Access::kRead && !isAccessible()) {
    // In a folder where nothing can be written there is no place for a log, and nobody else who writes.
    std::string uri = "file:";
    for (const char c : path) {
      const bool special = c == '%' || c == '?' || c == '#';
      uri += !special ? std::string(1, c) : c == '%' ? "%25" : c == '?' ? "%3f" : "%23";
    }
    open(SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, uri + "?immutable=1");
  }
  if (access != Access::kRead && sqlite3_db_readonly(database_.get(), "main") != 0)
    fail("it can't be written: it is read-only");
  if (access == Access::kCreate && isNew()) return;
  check();
  // A reader doesn't see what others write after it has begun.
  if (access == Access::kRead) execute("PRAGMA query_only=1; BEGIN; SELECT 1 FROM sqlite_master");
}

void Database::open(int flags, const std::string& uri) {
  sqlite3* database = nullptr;
  const int result = sqlite3_open_v2((uri.empty() ? path_ : uri).c_str(), &database, flags, nullptr);
  database_.reset(database);
  if (result != SQLITE_OK) fail(database != nullptr ? sqlite3_errmsg(database) : "there is no memory for it");
  sqlite3_busy_timeout(database, kBusy);
}

bool Database::isAccessible() const {
  const int result = sqlite3_exec(database_.get(), "SELECT 1 FROM sqlite_master", nullptr, nullptr, nullptr);
  return result != SQLITE_CANTOPEN && result != SQLITE_READONLY;
}

void Database::check() const {
  if (number("PRAGMA application_id") != format_.application) failForeign();
  const std::int64_t version = number("PRAGMA user_version");
  if (version != format_.version) {
    fail("its version is " + std::to_string(version) + ", this program reads " +
         std::to_string(format_.version) + (version > format_.version ? ": a newer release reads it" : ""));
  }
}

bool Database::isNew() const {
  return number("PRAGMA application_id") == 0 && number("SELECT count(*) FROM sqlite_master") == 0;
}

void Database::createTables(const char* sql) const {
  transaction([&] {
    execute(("PRAGMA application_id=" + std::to_string(format_.application) +
             "; PRAGMA user_version=" + std::to_string(format_.version))
                .c_str());
    execute(sql);
  });
}

Database::Statement Database::prepare(const char* sql) const {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(database_.get(), sql, -1, &statement, nullptr) != SQLITE_OK) failSql();
  return Statement(statement);
}

void Database::execute(const char* sql) const {
  if (sqlite3_exec(database_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) failSql();
}

std::int64_t Database::number(const char* sql) const {
  const Statement statement = prepare(sql);
  Use use(*this, statement);
  return use.next() ? use.number(0) : 0;
}

void Database::transaction(const std::function<void()>& work) const {
  execute("BEGIN IMMEDIATE");
  try {
    work();
    execute("COMMIT");
  } catch (...) {
    sqlite3_exec(database_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

Database::Use::~Use() {
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
}

Database::Use& Database::Use::check(int result) {
  if (result != SQLITE_OK) database_.failSql();
  return *this;
}

Database::Use& Database::Use::integer(std::int64_t value) {
  return check(sqlite3_bind_int64(statement_, ++bound_, value));
}
Database::Use& Database::Use::operator<<(double value) {
  return check(sqlite3_bind_double(statement_, ++bound_, value));
}
Database::Use& Database::Use::operator<<(const std::string& text) {
  return check(
      sqlite3_bind_text(statement_, ++bound_, text.data(), static_cast<int>(text.size()), SQLITE_TRANSIENT));
}
Database::Use& Database::Use::null() {
  return check(sqlite3_bind_null(statement_, ++bound_));
}
Database::Use& Database::Use::blob(const void* data, std::size_t size) {
  return check(sqlite3_bind_blob64(statement_, ++bound_, data, size, SQLITE_STATIC));
}

bool Database::Use::next() {
  const int result = sqlite3_step(statement_);
  if (result != SQLITE_ROW && result != SQLITE_DONE) database_.failSql();
  return result == SQLITE_ROW;
}

bool Database::Use::isNull(int column) const {
  return sqlite3_column_type(statement_, column) == SQLITE_NULL;
}
std::int64_t Database::Use::number(int column) const {
  return sqlite3_column_int64(statement_, column);
}
double Database::Use::real(int column) const {
  return sqlite3_column_double(statement_, column);
}
std::string Database::Use::bytes(int column) const {
  const void* data = sqlite3_column_blob(statement_, column);
  const int size = sqlite3_column_bytes(statement_, column);
  return size == 0 ? std::string()
                   : std::string(static_cast<const char*>(data), static_cast<std::size_t>(size));
}

}  // namespace mapping_common
