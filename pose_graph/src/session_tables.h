// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/database.h>

namespace pose_graph {

constexpr mapping_common::DatabaseFormat kSessionFormat = {0x50475253, 1,
                                                           "a session of pose_graph"};  // "PGRS"

/// Poses are seven numbers, quaternions x y z w; information is 36 float64, row by row.
constexpr const char* kSessionTables =
    "CREATE TABLE session(planar INTEGER NOT NULL);"
    "CREATE TABLE settings(name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE runs(id INTEGER PRIMARY KEY, stamp INTEGER NOT NULL, name TEXT NOT NULL);"
    "CREATE TABLE key_poses(id INTEGER PRIMARY KEY, run INTEGER NOT NULL, stamp INTEGER NOT NULL,"
    " fixed INTEGER NOT NULL, x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,"
    " qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL, qw REAL NOT NULL,"
    " odometry_x REAL NOT NULL, odometry_y REAL NOT NULL, odometry_z REAL NOT NULL,"
    " odometry_qx REAL NOT NULL, odometry_qy REAL NOT NULL, odometry_qz REAL NOT NULL,"
    " odometry_qw REAL NOT NULL);"
    "CREATE TABLE edges(id INTEGER PRIMARY KEY, from_id INTEGER NOT NULL, to_id INTEGER NOT NULL,"
    " type TEXT NOT NULL, state TEXT NOT NULL, source TEXT NOT NULL, similarity REAL NOT NULL,"
    " x REAL, y REAL, z REAL, qx REAL, qy REAL, qz REAL, qw REAL, information BLOB NOT NULL);"
    "CREATE TABLE foreign_edges(id INTEGER PRIMARY KEY, from_stamp INTEGER NOT NULL,"
    " to_stamp INTEGER NOT NULL, source TEXT NOT NULL, similarity REAL NOT NULL,"
    " x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,"
    " qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL, qw REAL NOT NULL, information BLOB NOT NULL);"
    "CREATE TABLE data(id INTEGER PRIMARY KEY, key_pose INTEGER NOT NULL, kind INTEGER NOT NULL,"
    " stamp INTEGER NOT NULL, frame TEXT NOT NULL,"
    " x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,"
    " qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL, qw REAL NOT NULL,"
    " format INTEGER NOT NULL, size INTEGER NOT NULL, stored INTEGER NOT NULL, data BLOB NOT NULL);"
    "CREATE INDEX data_by_stamp ON data(kind, stamp);"
    "CREATE INDEX data_by_key_pose ON data(key_pose, kind, stamp);";

}  // namespace pose_graph
