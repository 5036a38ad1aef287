// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/session.h"

#include <mapping_common/compression.h>

#include <cstring>
#include <fstream>
#include <stdexcept>
#include <utility>

#include "session_tables.h"

namespace pose_graph {
namespace {

using mapping_common::Database;

constexpr const char* kDataColumns =
    "SELECT key_pose, kind, stamp, frame, x, y, z, qx, qy, qz, qw, format, size, data FROM data";

Pose readPose(const Database::Use& row, int column) {
  Pose pose;
  for (int i = 0; i < 3; ++i) pose.translation[i] = row.real(column + i);
  for (int i = 0; i < 4; ++i) pose.rotation.coeffs()[i] = row.real(column + 3 + i);
  return pose;
}

Matrix6 readInformation(const Database& database, const std::string& bytes) {
  Matrix6 information;
  if (bytes.size() != sizeof(information)) database.fail("it is corrupted: the information of an edge");
  std::memcpy(information.data(), bytes.data(), sizeof(information));  // symmetric
  return information;
}

// Names are the file's own, not the program's numbers.
template <class Enum>
Enum readName(const Database& database, const std::string& name) {
  try {
    return mapping_common::valueOf<Enum>(name);
  } catch (const std::invalid_argument& e) {
    database.fail(std::string("it is corrupted or of a newer program: ") + e.what());
  }
}

}  // namespace

bool isSession(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  unsigned char header[72] = {};
  in.read(reinterpret_cast<char*>(header), sizeof(header));
  std::int32_t application = 0;
  for (int i = 68; i < 72; ++i) application = application << 8 | header[i];
  return in && std::memcmp(header, "SQLite format 3", 16) == 0 && application == kSessionFormat.application;
}

Session::Session(const std::string& path)
    : database_(std::make_unique<Database>(path, kSessionFormat, Database::Access::kRead)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;

const std::string& Session::path() const {
  return database_->path();
}

bool Session::planar() const {
  return database_->number("SELECT planar FROM session") != 0;
}

std::map<std::string, std::string> Session::settings() const {
  std::map<std::string, std::string> settings;
  const auto select = database_->prepare("SELECT name, value FROM settings");
  Database::Use row(*database_, select);
  while (row.next()) settings[row.bytes(0)] = row.bytes(1);
  return settings;
}

std::vector<Run> Session::runs() const {
  std::vector<Run> runs;
  const auto select = database_->prepare("SELECT id, stamp, name FROM runs ORDER BY id");
  Database::Use row(*database_, select);
  while (row.next()) runs.push_back({row.number(0), row.number(1), row.bytes(2)});
  return runs;
}

std::vector<KeyPose> Session::keyPoses() const {
  std::vector<KeyPose> key_poses;
  key_poses.reserve(static_cast<std::size_t>(database_->number("SELECT count(*) FROM key_poses")));
  const auto select = database_->prepare(
      "SELECT id, run, stamp, fixed, x, y, z, qx, qy, qz, qw, odometry_x, odometry_y, odometry_z,"
      " odometry_qx, odometry_qy, odometry_qz, odometry_qw FROM key_poses ORDER BY id");
  Database::Use row(*database_, select);
  while (row.next()) {
    key_poses.push_back({row.number(0), row.number(1), row.number(2), readPose(row, 4), readPose(row, 11),
                         row.number(3) != 0});
  }
  return key_poses;
}

std::vector<ForeignEdge> Session::foreignEdges() const {
  std::vector<ForeignEdge> edges;
  const auto select = database_->prepare(
      "SELECT from_stamp, to_stamp, source, similarity, x, y, z, qx, qy, qz, qw, information"
      " FROM foreign_edges ORDER BY id");
  Database::Use row(*database_, select);
  while (row.next()) {
    edges.push_back({row.number(0), row.number(1), row.bytes(2), readPose(row, 4),
                     readInformation(*database_, row.bytes(11)), row.real(3)});
  }
  return edges;
}

std::vector<SessionEdge> Session::edges() const {
  std::vector<SessionEdge> edges;
  const auto select = database_->prepare(
      "SELECT id, from_id, to_id, type, state, source, similarity, information, x, y, z, qx, qy, qz, qw"
      " FROM edges ORDER BY id");
  Database::Use row(*database_, select);
  while (row.next()) {
    SessionEdge edge;
    edge.id = row.number(0), edge.from = row.number(1), edge.to = row.number(2);
    edge.type = readName<EdgeType>(*database_, row.bytes(3));
    edge.state = readName<EdgeState>(*database_, row.bytes(4));
    edge.source = row.bytes(5);
    edge.similarity = row.real(6);
    edge.information = readInformation(*database_, row.bytes(7));
    if (!row.isNull(8)) edge.transform = readPose(row, 8);
    edges.push_back(std::move(edge));
  }
  return edges;
}

KeyData Session::readData(const Database::Use& row) const {
  KeyData data;
  data.key_pose = row.number(0);
  data.kind = static_cast<DataKind>(row.number(1));
  data.stamp = row.number(2);
  data.frame = row.bytes(3);
  data.sensor = readPose(row, 4);
  data.format = static_cast<std::uint32_t>(row.number(11));
  try {
    data.data = mapping_common::decompress(row.bytes(13), static_cast<std::size_t>(row.number(12)));
  } catch (const std::runtime_error& e) {
    database_->fail("it is corrupted at key pose " + std::to_string(data.key_pose) + ": " + e.what());
  }
  return data;
}

void Session::visitData(DataKind kind, const std::function<bool(KeyData&&)>& visit) const {
  const auto select =
      database_->prepare((std::string(kDataColumns) + " WHERE kind = ? ORDER BY stamp, id").c_str());
  Database::Use row(*database_, select);
  row << static_cast<std::int64_t>(kind);
  while (row.next() && visit(readData(row))) {
  }
}

std::vector<KeyData> Session::dataAt(std::int64_t key_pose, DataKind kind) const {
  const auto select = database_->prepare(
      (std::string(kDataColumns) + " WHERE key_pose = ? AND kind = ? ORDER BY stamp, id").c_str());
  Database::Use row(*database_, select);
  row << key_pose << static_cast<std::int64_t>(kind);
  std::vector<KeyData> data;
  while (row.next()) data.push_back(readData(row));
  return data;
}

std::map<DataKind, Session::Amount> Session::amounts() const {
  std::map<DataKind, Amount> amounts;
  const auto select =
      database_->prepare("SELECT kind, count(*), sum(size), sum(stored) FROM data GROUP BY kind");
  Database::Use row(*database_, select);
  const auto size = [&row](int column) { return static_cast<std::size_t>(row.number(column)); };
  while (row.next()) amounts[static_cast<DataKind>(row.number(0))] = {size(1), size(2), size(3)};
  return amounts;
}

SessionGraph readGraph(const Session& session) {
  SessionGraph read{Graph(session.planar()), {}, {}};
  try {
    for (const KeyPose& k : session.keyPoses()) read.graph.addNode({k.id, k.stamp, k.pose, k.fixed});
    for (SessionEdge& edge : session.edges()) {
      const auto from = read.graph.find(edge.from), to = read.graph.find(edge.to);
      if (!from || !to)
        throw std::invalid_argument("a key pose of edge " + std::to_string(edge.id) + " is missing");
      if (!edge.transform || edge.state == EdgeState::kDeleted) {
        read.others.push_back(std::move(edge));
        continue;
      }
      read.graph.addEdge(
          {*from, *to, edge.type, *edge.transform, edge.information, edge.state == EdgeState::kAccepted});
      read.edges.push_back(std::move(edge));
    }
  } catch (const std::invalid_argument& e) {
    throw std::runtime_error(session.path() + ": it is corrupted: " + e.what());
  }
  return read;
}

}  // namespace pose_graph
