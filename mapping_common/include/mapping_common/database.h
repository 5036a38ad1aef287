// SPDX-License-Identifier: BSD-3-Clause
//
// SQLite files of this workspace's own formats. Their write-ahead log keeps them whole whenever the program
// ends: what a transaction changes is all there, or nothing of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>

struct sqlite3;
struct sqlite3_stmt;

namespace mapping_common {

struct DatabaseFormat {
  std::int32_t application;  ///< four characters in the file's header
  std::int32_t version;      ///< the one that is read and written
  const char* what;          ///< that such a file is, e.g. "a store of an R-tree occupancy map"
};

/// A connection. All functions throw std::runtime_error that names the file and says what is wrong with it.
/// One thread at a time may use it.
class Database {
 public:
  /// A statement that can be run again and again.
  class Statement {
   public:
    Statement() = default;
    explicit Statement(sqlite3_stmt* statement) : statement_(statement) {}

   private:
    friend class Database;
    struct Finalize {
      void operator()(sqlite3_stmt* statement) const;
    };
    std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  };
  class Use;

  enum class Access {
    kRead,   ///< also where nothing can be written; what others write from now on isn't seen
    kWrite,  ///< a file that there is
    kCreate  ///< one that there is, or a new one
  };
  Database(const std::string& path, const DatabaseFormat& format, Access access);

  /// Whether there is nothing in it, not even its format.
  bool isNew() const;
  /// Gives a new file its format and tables.
  void createTables(const char* sql) const;

  Statement prepare(const char* sql) const;
  void execute(const char* sql) const;
  /// The first value that a query gives; 0 without any.
  std::int64_t number(const char* sql) const;
  /// Does all that `work` does, or nothing.
  void transaction(const std::function<void()>& work) const;

  const std::string& path() const { return path_; }
  [[noreturn]] void fail(const std::string& what) const;

 private:
  struct Close {
    void operator()(sqlite3* database) const;
  };
  void open(int flags, const std::string& uri);
  bool isAccessible() const;
  void check() const;
  [[noreturn]] void failForeign() const;
  [[noreturn]] void failSql() const;

  std::string path_;
  DatabaseFormat format_;
  std::unique_ptr<sqlite3, Close> database_;  // closes when the last statement is gone
};

/// A statement from its first value to its end:
///
///     Database::Use row(database, select);
///     row << id;
///     while (row.next()) visit(row.number(0), row.bytes(1));
class Database::Use {
 public:
  Use(const Database& database, const Statement& statement)
      : database_(database), statement_(statement.statement_.get()) {}
  ~Use();
  Use(const Use&) = delete;
  Use& operator=(const Use&) = delete;

  template <class Integer, class = std::enable_if_t<std::is_integral_v<Integer>>>
  Use& operator<<(Integer value) {
    return integer(static_cast<std::int64_t>(value));
  }
  Use& operator<<(double value);
  Use& operator<<(const std::string& text);
  Use& null();
  /// Valid until the end.
  Use& blob(const void* data, std::size_t size);
  /// Runs it to its next row. @return whether there is one
  bool next();

  bool isNull(int column) const;
  std::int64_t number(int column) const;
  double real(int column) const;
  std::string bytes(int column) const;  ///< of a text or a blob

 private:
  Use& integer(std::int64_t value);
  Use& check(int result);
  const Database& database_;
  sqlite3_stmt* statement_;
  int bound_ = 0;
};

}  // namespace mapping_common
