// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <mapping_common/compression.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstring>
#include <iterator>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <unordered_set>
#include <utility>

#include "pose_graph/session.h"
#include "session_tables.h"

namespace pose_graph {
namespace {

using mapping_common::Database;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kBytesAtOnce = std::size_t{4} << 20;  // of data in a transaction

double secondsSince(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

// Of a file: PATH-lock beside it, as a lock on a database itself would be gone when anybody in this process
// closes it. It ends with the process, however that ends.
class Lock {
 public:
  explicit Lock(const std::string& path) : path_(path + "-lock") {
    for (;;) {
      file_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
      if (file_ < 0) throw std::runtime_error(path + " can't be written: " + std::strerror(errno));
      if (flock(file_, LOCK_EX | LOCK_NB) != 0) {
        close(file_);
        throw std::runtime_error(path +
                                 " is being written to by another program or node: give this one a file "
                                 "of its own, or end the other");
      }
      struct stat mine {
      }, there{};
      if (fstat(file_, &mine) == 0 && stat(path_.c_str(), &there) == 0 && mine.st_ino == there.st_ino) return;
      close(file_);  // whoever had it has just removed it
    }
  }
  ~Lock() {
    unlink(path_.c_str());
    close(file_);
  }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

 private:
  std::string path_;
  int file_ = -1;
};

// What waits to be written.
struct Batch {
  std::map<std::string, std::string> settings;
  std::vector<Run> runs;
  std::map<std::int64_t, KeyPose> key_poses;
  std::map<std::int64_t, Pose> poses;  // of others
  std::map<std::int64_t, SessionEdge> edges;
  std::vector<ForeignEdge> foreign_edges;
  std::vector<KeyData> data;
  std::size_t data_bytes = 0;
  Clock::time_point since;  // if it isn't empty

  bool isGraphEmpty() const {
    return settings.empty() && runs.empty() && key_poses.empty() && poses.empty() && edges.empty() &&
           foreign_edges.empty();
  }
  bool isEmpty() const { return isGraphEmpty() && data.empty(); }
  void clearGraph() {
    settings.clear();
    runs.clear();
    key_poses.clear();
    poses.clear();
    edges.clear();
    foreign_edges.clear();
  }
  void set(std::int64_t id, const Pose& pose) {
    const auto key_pose = key_poses.find(id);
    (key_pose != key_poses.end() ? key_pose->second.pose : poses[id]) = pose;
  }
  // What came later.
  void add(Batch&& later) {
    for (auto& [name, value] : later.settings) settings[name] = std::move(value);
    runs.insert(runs.end(), later.runs.begin(), later.runs.end());
    for (const auto& [id, key_pose] : later.key_poses) key_poses[id] = key_pose, poses.erase(id);
    for (const auto& [id, pose] : later.poses) set(id, pose);
    for (auto& [id, edge] : later.edges) edges[id] = std::move(edge);
    std::move(later.foreign_edges.begin(), later.foreign_edges.end(), std::back_inserter(foreign_edges));
    std::move(later.data.begin(), later.data.end(), std::back_inserter(data));
    data_bytes += later.data_bytes;
  }
};

void bind(Database::Use& use, const Pose& pose) {
  for (int i = 0; i < 3; ++i) use << pose.translation[i];
  for (int i = 0; i < 4; ++i) use << pose.rotation.coeffs()[i];
}

Pose checked(Pose pose, const std::string& what) {
  if (!pose.translation.allFinite() || !(std::abs(pose.rotation.norm() - 1.0) < 1e-3))
    throw std::invalid_argument(what + " isn't finite, or its quaternion isn't of length 1");
  pose.rotation.normalize();
  return pose;
}

std::string named(const char* what, std::int64_t id) {
  return what + (' ' + std::to_string(id));
}

// What a graph won't take must not be in a file that is to be read as one.
void requireNode(bool planar, std::int64_t id, const Pose& pose) {
  Graph(planar).addNode({id, 0, pose, false});
}
void requireEdge(bool planar, const SessionEdge& edge) {
  Graph graph(planar);
  graph.addNode({edge.from, 0, {}, false});
  graph.addNode({edge.to, 0, {}, false});
  Edge e;
  e.to = 1;
  e.transform = edge.transform.value_or(Pose());
  e.information = edge.information;
  graph.addEdge(e);
}

}  // namespace

class SessionWriter::Implementation {
 public:
  Implementation(const std::string& path, bool planar, const SessionWriterOptions& options);
  ~Implementation();

  // Changes what waits.
  template <class Change>
  void take(const Change& change) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const bool was_empty = waiting_.isEmpty();
    change(waiting_);
    if (was_empty) waiting_.since = Clock::now();
  }
  void require(const std::unordered_set<std::int64_t>& known, std::int64_t id,
               const std::string& what) const {
    if (known.count(id) == 0) throw std::invalid_argument(what + " isn't in the session");
  }
  void flush();
  Status status() const;

  const SessionWriterOptions options_;
  const bool planar_;
  std::unordered_set<std::int64_t> runs_, key_poses_;
  std::int64_t next_run_ = 0, next_key_pose_ = 0, next_edge_ = 0;
  std::size_t lost_ = 0;
  mutable std::mutex mutex_;  // of all but the database

 private:
  void readIds();
  void work();
  void writeSome(Batch& batch);
  void writeGraph(const Batch& batch);
  void writePoses(const Batch& batch);
  void writeEdge(const SessionEdge& edge);
  void writeForeignEdge(const ForeignEdge& edge);
  void writeData(const KeyData& data);

  Lock lock_;
  Database database_;
  Database::Statement put_setting_, put_run_, put_key_pose_, set_pose_, put_edge_, put_foreign_edge_,
      put_data_;

  Batch waiting_;
  std::size_t writing_bytes_ = 0;  // of the data that are being written
  bool busy_ = false, hurries_ = false, ends_ = false;
  std::size_t attempts_ = 0, commits_ = 0;
  double longest_commit_ = 0.0;
  std::string error_;
  std::condition_variable wake_, written_;
  std::thread thread_;

  friend class SessionWriter;
};

SessionWriter::Implementation::Implementation(const std::string& path, bool planar,
                                              const SessionWriterOptions& options)
    : options_(mapping_common::validate(options)),
      planar_(planar),
      lock_(path),
      database_(path, kSessionFormat, Database::Access::kCreate) {
  // FULL: what was committed outlasts a cut of power, too.
  database_.execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA journal_size_limit=67108864");
  if (database_.isNew())
    database_.createTables(
        (kSessionTables + std::string("INSERT INTO session VALUES(") + (planar ? "1)" : "0)")).c_str());
  if ((database_.number("SELECT planar FROM session") != 0) != planar)
    database_.fail(std::string("its poses are in ") + (planar ? "space" : "the plane") +
                   ": a planar and a spatial graph can't go on in one file, so choose another");
  readIds();
  put_setting_ = database_.prepare("INSERT OR REPLACE INTO settings VALUES(?, ?)");
  put_run_ = database_.prepare("INSERT OR REPLACE INTO runs VALUES(?, ?, ?)");
  put_key_pose_ = database_.prepare(
      "INSERT OR REPLACE INTO key_poses VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  set_pose_ = database_.prepare(
      "UPDATE key_poses SET x = ?, y = ?, z = ?, qx = ?, qy = ?, qz = ?, qw = ? WHERE id = ?");
  put_edge_ =
      database_.prepare("INSERT OR REPLACE INTO edges VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  put_foreign_edge_ =
      database_.prepare("INSERT INTO foreign_edges VALUES(NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  put_data_ = database_.prepare("INSERT INTO data VALUES(NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  thread_ = std::thread([this] { work(); });
}

SessionWriter::Implementation::~Implementation() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ends_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void SessionWriter::Implementation::readIds() {
  const auto read = [this](const char* sql, std::unordered_set<std::int64_t>& ids) {
    const auto select = database_.prepare(sql);
    Database::Use row(database_, select);
    while (row.next()) ids.insert(row.number(0));
  };
  read("SELECT id FROM runs", runs_);
  read("SELECT id FROM key_poses", key_poses_);
  next_run_ = database_.number("SELECT max(id) + 1 FROM runs");
  next_key_pose_ = database_.number("SELECT max(id) + 1 FROM key_poses");
  next_edge_ = database_.number("SELECT max(id) + 1 FROM edges");
}

void SessionWriter::Implementation::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  const auto period = std::chrono::duration<double>(options_.period);
  while (!ends_ || !waiting_.isEmpty()) {
    wake_.wait_for(lock, period, [this] { return ends_ || hurries_; });
    hurries_ = false;
    if (waiting_.isEmpty()) continue;
    Batch batch = std::exchange(waiting_, {});
    writing_bytes_ = batch.data_bytes;
    busy_ = true;
    lock.unlock();
    std::string error;
    double longest = 0.0;
    std::size_t commits = 0;
    try {
      while (!batch.isEmpty()) {
        const Clock::time_point start = Clock::now();
        writeSome(batch);
        longest = std::max(longest, secondsSince(start));
        ++commits;
      }
    } catch (const std::exception& e) {
      error = e.what();
    }
    lock.lock();
    commits_ += commits;
    longest_commit_ = std::max(longest_commit_, longest);
    if (!batch.isEmpty()) {
      batch.add(std::exchange(waiting_, {}));
      waiting_ = std::move(batch);
    }
    writing_bytes_ = 0;
    error_ = error;
    busy_ = false;
    ++attempts_;
    written_.notify_all();
    if (!error.empty() && ends_) return;
    // Not again at once.
    if (!error.empty()) wake_.wait_for(lock, period, [this] { return ends_; });
  }
}

// In one transaction: what isn't data, and some of these. What was written is taken out of the batch.
void SessionWriter::Implementation::writeSome(Batch& batch) {
  std::size_t count = 0, bytes = 0;
  while (count < batch.data.size() && bytes < kBytesAtOnce) bytes += batch.data[count++].data.size();
  try {
    database_.transaction([&] {
      writeGraph(batch);
      for (std::size_t i = 0; i < count; ++i) writeData(batch.data[i]);
    });
  } catch (const std::exception&) {
    // The graph takes little, and may fit where data don't.
    if (count > 0 && !batch.isGraphEmpty()) {
      database_.transaction([&] { writeGraph(batch); });
      batch.clearGraph();
    }
    throw;
  }
  batch.clearGraph();
  batch.data.erase(batch.data.begin(), batch.data.begin() + static_cast<std::ptrdiff_t>(count));
  batch.data_bytes -= bytes;
}

void SessionWriter::Implementation::writeGraph(const Batch& batch) {
  for (const auto& [name, value] : batch.settings)
    (Database::Use(database_, put_setting_) << name << value).next();
  for (const Run& run : batch.runs)
    (Database::Use(database_, put_run_) << run.id << run.stamp << run.name).next();
  writePoses(batch);
  for (const auto& [id, edge] : batch.edges) writeEdge(edge);
  for (const ForeignEdge& edge : batch.foreign_edges) writeForeignEdge(edge);
}

void SessionWriter::Implementation::writePoses(const Batch& batch) {
  for (const auto& [id, k] : batch.key_poses) {
    Database::Use use(database_, put_key_pose_);
    use << id << k.run << k.stamp << std::int64_t{k.fixed};
    bind(use, k.pose);
    bind(use, k.odometry);
    use.next();
  }
  for (const auto& [id, pose] : batch.poses) {
    Database::Use use(database_, set_pose_);
    bind(use, pose);
    (use << id).next();
  }
}

void SessionWriter::Implementation::writeEdge(const SessionEdge& edge) {
  const std::string type = mapping_common::nameOf(edge.type), state = mapping_common::nameOf(edge.state);
  Database::Use use(database_, put_edge_);
  use << edge.id << edge.from << edge.to << type << state << edge.source << edge.similarity;
  if (edge.transform) {
    bind(use, *edge.transform);
  } else {
    for (int i = 0; i < 7; ++i) use.null();
  }
  use.blob(edge.information.data(), sizeof(edge.information)).next();
}

void SessionWriter::Implementation::writeForeignEdge(const ForeignEdge& edge) {
  Database::Use use(database_, put_foreign_edge_);
  use << edge.from_stamp << edge.to_stamp << edge.source << edge.similarity;
  bind(use, edge.transform);
  use.blob(edge.information.data(), sizeof(edge.information)).next();
}

void SessionWriter::Implementation::writeData(const KeyData& data) {
  const std::string stored = mapping_common::compress(data.data);
  Database::Use use(database_, put_data_);
  use << data.key_pose << static_cast<std::int64_t>(data.kind) << data.stamp << data.frame;
  bind(use, data.sensor);
  use << std::int64_t{data.format} << static_cast<std::int64_t>(data.data.size())
      << static_cast<std::int64_t>(stored.size());
  use.blob(stored.data(), stored.size()).next();
}

void SessionWriter::Implementation::flush() {
  std::unique_lock<std::mutex> lock(mutex_);
  // The attempt that runs may have begun before what is to be written came.
  const std::size_t enough = attempts_ + (busy_ && !waiting_.isEmpty() ? 2 : 1);
  while (attempts_ < enough && (busy_ || !waiting_.isEmpty())) {
    hurries_ = true;
    wake_.notify_all();
    written_.wait(lock);
  }
  if (!error_.empty()) throw std::runtime_error(error_);
}

SessionWriter::Status SessionWriter::Implementation::status() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  Status s;
  s.error = error_;
  if (!waiting_.isEmpty()) s.unwritten_since = secondsSince(waiting_.since);
  s.waiting_bytes = waiting_.data_bytes + writing_bytes_;
  s.lost = lost_;
  s.commits = commits_;
  s.longest_commit = longest_commit_;
  return s;
}

void SessionWriterOptions::describe(mapping_common::OptionList& o) {
  o("period", period, "s", "between commits: what is newer is lost where the process is killed")
      .within(0.001, 60.0);
  o("memory", memory, "MiB", "of scans, clouds and images that wait while the file can't be written")
      .within(0.0, 1e6);
}

SessionWriter::SessionWriter(const std::string& path, bool planar, const SessionWriterOptions& options)
    : implementation_(std::make_unique<Implementation>(path, planar, options)) {}
SessionWriter::~SessionWriter() = default;

std::int64_t SessionWriter::beginRun(std::int64_t stamp, const std::string& name) {
  Run run{0, stamp, name};
  implementation_->take([&](Batch& batch) {
    run.id = implementation_->next_run_++;
    implementation_->runs_.insert(run.id);
    batch.runs.push_back(run);
  });
  return run.id;
}

void SessionWriter::put(const KeyPose& key_pose) {
  KeyPose k = key_pose;
  requireNode(implementation_->planar_, k.id, k.pose);
  k.pose.rotation.normalize();
  k.odometry = checked(k.odometry, "the odometry of " + named("key pose", k.id));
  implementation_->take([&](Batch& batch) {
    implementation_->require(implementation_->runs_, k.run, named("run", k.run));
    implementation_->key_poses_.insert(k.id);
    implementation_->next_key_pose_ = std::max(implementation_->next_key_pose_, k.id + 1);
    batch.key_poses[k.id] = k;
    batch.poses.erase(k.id);
  });
}

void SessionWriter::put(const SessionEdge& edge) {
  SessionEdge e = edge;
  requireEdge(implementation_->planar_, e);
  if (e.transform) e.transform->rotation.normalize();
  if (!std::isfinite(e.similarity)) e.similarity = 0.0;
  implementation_->take([&](Batch& batch) {
    for (const std::int64_t id : {e.from, e.to})
      implementation_->require(implementation_->key_poses_, id, named("key pose", id));
    implementation_->next_edge_ = std::max(implementation_->next_edge_, e.id + 1);
    batch.edges[e.id] = std::move(e);
  });
}

void SessionWriter::put(const ForeignEdge& edge) {
  SessionEdge like;
  like.to = 1;
  like.transform = edge.transform;
  like.information = edge.information;
  requireEdge(implementation_->planar_, like);
  implementation_->take([&](Batch& batch) { batch.foreign_edges.push_back(edge); });
}

void SessionWriter::put(KeyData data) {
  data.sensor = checked(data.sensor, "the sensor's pose of data at " + named("key pose", data.key_pose));
  implementation_->take([&](Batch& batch) {
    implementation_->require(implementation_->key_poses_, data.key_pose, named("key pose", data.key_pose));
    const std::size_t waiting = batch.data_bytes + implementation_->writing_bytes_ + data.data.size();
    if (static_cast<double>(waiting) > implementation_->options_.memory * (1 << 20)) {
      ++implementation_->lost_;
      return;
    }
    batch.data_bytes += data.data.size();
    batch.data.push_back(std::move(data));
  });
}

void SessionWriter::setPoses(const std::map<std::int64_t, Pose>& poses) {
  for (const auto& [id, pose] : poses) requireNode(implementation_->planar_, id, pose);
  implementation_->take([&](Batch& batch) {
    for (const auto& [id, pose] : poses)
      implementation_->require(implementation_->key_poses_, id, named("key pose", id));
    for (const auto& [id, pose] : poses) batch.set(id, pose);
  });
}

void SessionWriter::setSetting(const std::string& name, const std::string& value) {
  implementation_->take([&](Batch& batch) { batch.settings[name] = value; });
}

std::int64_t SessionWriter::nextKeyPose() const {
  const std::lock_guard<std::mutex> lock(implementation_->mutex_);
  return implementation_->next_key_pose_;
}
std::int64_t SessionWriter::nextEdge() const {
  const std::lock_guard<std::mutex> lock(implementation_->mutex_);
  return implementation_->next_edge_;
}

void SessionWriter::flush() {
  implementation_->flush();
}
SessionWriter::Status SessionWriter::status() const {
  return implementation_->status();
}

}  // namespace pose_graph
