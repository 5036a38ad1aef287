// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <mapping_common/files.h>
#include <mapping_common/testing/temp_dir.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <thread>

#include "graphs.h"
#include "pose_graph/session.h"

namespace pose_graph {
namespace {

using mapping_common::mentions;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <class Work>
std::string refusal(const Work& work) {
  try {
    work();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

KeyPose keyPose(std::int64_t id, std::int64_t run, const Pose& pose) {
  return {id, run, 1000 + id, pose, pose, false};
}

std::string randomFloats(int count, int seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(5.0F, 1.0F);
  std::string bytes(4 * count, '\0');
  for (int i = 0; i < count; ++i) {
    const float value = normal(random);
    std::memcpy(&bytes[4 * i], &value, 4);
  }
  return bytes;
}

class SessionTest : public testing::Test {
 protected:
  mapping_common::TempDir dir_;
  const std::string path_ = dir_.path("drive.session");
};

// A graph with poses and edges of a run.
void put(SessionWriter& writer, const Graph& graph, std::int64_t run) {
  for (const Node& node : graph.nodes()) writer.put(keyPose(node.id, run, node.pose));
  for (std::size_t i = 0; i < graph.edges().size(); ++i) {
    const Edge& e = graph.edges()[i];
    SessionEdge edge;
    edge.id = static_cast<std::int64_t>(i);
    edge.from = graph.nodes()[e.from].id, edge.to = graph.nodes()[e.to].id;
    edge.type = e.type;
    edge.source = "laser";
    edge.transform = e.transform;
    edge.information = e.information;
    writer.put(edge);
  }
}

TEST_F(SessionTest, ReadsWhatWasWritten) {
  const Graph graph = rounds(false, 60, 20, 0.02, 1);
  const std::string scan = randomFloats(1001, 1), image = "\xff\xd8 a picture";
  {
    SessionWriter writer(path_, false);
    EXPECT_EQ(0, writer.beginRun(17, "morning"));
    put(writer, graph, 0);
    writer.put(KeyData{7, DataKind::kScan, 2000, "laser", planarPose(0.1, 0.2, 0.3), 3, scan});
    writer.put(KeyData{7, DataKind::kScan, 1500, "laser", {}, 3, ""});
    writer.put(KeyData{8, DataKind::kThumbnail, 900, "camera", {}, 1, image});
    writer.setSetting("resolution", "0.05");
    EXPECT_EQ(60, writer.nextKeyPose());
    EXPECT_EQ(static_cast<std::int64_t>(graph.edges().size()), writer.nextEdge());
  }
  ASSERT_TRUE(isSession(path_));
  const Session session(path_);
  EXPECT_FALSE(session.planar());
  ASSERT_EQ(1U, session.runs().size());
  EXPECT_EQ("morning", session.runs()[0].name);
  EXPECT_EQ(17, session.runs()[0].stamp);
  EXPECT_EQ("0.05", session.settings()["resolution"]);
  const SessionGraph read = readGraph(session);
  ASSERT_EQ(graph.nodes().size(), read.graph.nodes().size());
  ASSERT_EQ(graph.edges().size(), read.graph.edges().size());
  EXPECT_NEAR(graph.chi2(), read.graph.chi2(), 1e-12 * graph.chi2());
  EXPECT_EQ(1007, read.graph.nodes()[7].stamp);
  EXPECT_EQ(graph.edges()[9].type, read.graph.edges()[9].type);
  EXPECT_EQ("laser", read.edges[9].source);

  const auto scans = session.dataAt(7, DataKind::kScan);
  ASSERT_EQ(2U, scans.size());
  EXPECT_EQ("", scans[0].data);
  EXPECT_EQ(scan, scans[1].data);
  EXPECT_EQ(3U, scans[1].format);
  EXPECT_EQ(2000, scans[1].stamp);
  EXPECT_EQ("laser", scans[1].frame);
  EXPECT_NEAR(0.3, scans[1].sensor.yaw(), 1e-12);
  EXPECT_EQ(image, session.dataAt(8, DataKind::kThumbnail).at(0).data);
  EXPECT_TRUE(session.dataAt(8, DataKind::kCloud).empty());
  auto amounts = session.amounts();
  EXPECT_EQ(2U, amounts[DataKind::kScan].count);
  EXPECT_EQ(scan.size(), amounts[DataKind::kScan].bytes);
  EXPECT_LT(amounts[DataKind::kScan].stored_bytes, 0.95 * scan.size());
}

TEST_F(SessionTest, GoesOnWhereItWas) {
  {
    SessionWriter writer(path_, true);
    writer.put(keyPose(5, writer.beginRun(0, "one"), {}));
  }
  SessionWriter writer(path_, true);
  EXPECT_EQ(6, writer.nextKeyPose());
  EXPECT_EQ(1, writer.beginRun(0, "two"));
  writer.put(keyPose(6, 1, planarPose(1, 0, 0)));
  SessionEdge edge;
  edge.id = writer.nextEdge();
  edge.from = 5, edge.to = 6;
  edge.type = EdgeType::kPlace;
  edge.state = EdgeState::kPending;
  writer.put(edge);
  writer.flush();
  EXPECT_EQ(1U, readGraph(Session(path_)).others.size()) << "it has no transform";
  edge.transform = planarPose(1, 0, 0);
  writer.put(edge);
  writer.flush();
  EXPECT_FALSE(readGraph(Session(path_)).graph.edges().at(0).active);
  edge.state = EdgeState::kAccepted;
  writer.put(edge);
  writer.setPoses({{6, planarPose(2, 0, 0)}});
  writer.flush();
  const SessionGraph read = readGraph(Session(path_));
  EXPECT_TRUE(read.graph.edges().at(0).active);
  EXPECT_EQ(2.0, read.graph.nodes()[1].pose.translation.x());
  EXPECT_EQ(1.0, Session(path_).keyPoses()[1].odometry.translation.x());
  edge.state = EdgeState::kDeleted;
  writer.put(edge);
  writer.flush();
  EXPECT_TRUE(readGraph(Session(path_)).graph.edges().empty());
  EXPECT_EQ(EdgeState::kDeleted, Session(path_).edges().at(0).state);
}

TEST_F(SessionTest, ReadersSeeWhatWasThereWhenTheyBegan) {
  SessionWriter writer(path_, true);
  writer.put(keyPose(0, writer.beginRun(0, ""), {}));
  writer.flush();
  const Session before(path_);
  writer.put(keyPose(1, 0, {}));
  writer.flush();
  EXPECT_EQ(1U, before.keyPoses().size());
  EXPECT_EQ(2U, Session(path_).keyPoses().size());
}

TEST_F(SessionTest, TakesOnlyWhatAGraphTakes) {
  SessionWriter writer(path_, true);
  const std::int64_t run = writer.beginRun(0, "");
  writer.put(keyPose(0, run, {}));
  writer.put(keyPose(1, run, {}));
  Pose raised;
  raised.translation.z() = 1.0;
  EXPECT_TRUE(mentions(refusal([&] { writer.put(keyPose(2, run, raised)); }), {"isn't in the plane"}));
  EXPECT_TRUE(mentions(refusal([&] { writer.put(keyPose(2, 4, {})); }), {"run 4 isn't in the session"}));
  EXPECT_TRUE(mentions(refusal([&] { writer.setPoses({{3, {}}}); }), {"key pose 3 isn't in the session"}));
  SessionEdge edge;
  edge.to = 9;
  EXPECT_TRUE(mentions(refusal([&] { writer.put(edge); }), {"key pose 9 isn't in the session"}));
  edge.to = 0;
  EXPECT_NE("", refusal([&] { writer.put(edge); }));
  edge.to = 1;
  edge.information(0, 0) = -1.0;
  EXPECT_NE("", refusal([&] { writer.put(edge); }));
  writer.flush();
  EXPECT_EQ(2U, readGraph(Session(path_)).graph.nodes().size());
}

TEST_F(SessionTest, RefusesWhatIsNone) {
  const auto refuses = [&](std::initializer_list<const char*> why) {
    return mentions(refusal([&] { Session session(path_); }), why) &&
           mentions(refusal([&] { SessionWriter writer(path_, true); }), why);
  };
  EXPECT_FALSE(isSession(path_));
  EXPECT_NE("", refusal([&] { Session session(path_); }));
  dir_.write("drive.session", std::string(5000, 'x'));
  EXPECT_TRUE(refuses({path_.c_str(), "it isn't a session of pose_graph", "choose another"}));
  EXPECT_EQ(std::string(5000, 'x'), mapping_common::readFile(path_));
  EXPECT_FALSE(isSession(path_));
  std::filesystem::remove(path_);
  {
    SessionWriter writer(path_, true);
    const std::int64_t run = writer.beginRun(0, "");
    for (int i = 0; i < 1000; ++i) writer.put(keyPose(i, run, {}));
  }
  EXPECT_TRUE(mentions(refusal([&] { SessionWriter writer(path_, false); }), {"its poses are in the plane"}));
  const std::string whole = mapping_common::readFile(path_);
  std::string newer = whole;
  newer[63] = 2;  // user_version
  dir_.write("drive.session", newer);
  EXPECT_TRUE(refuses({"its version is 2, this program reads 1", "newer"}));
  std::string foreign = whole;
  foreign[68] = 'x';  // application_id
  dir_.write("drive.session", foreign);
  EXPECT_TRUE(refuses({"it isn't a session of pose_graph"}));
  for (std::size_t i = 0; i < whole.size() / 4096; ++i) {
    std::string damaged = whole;
    std::fill_n(damaged.begin() + static_cast<std::ptrdiff_t>(4096 * i + (i == 0 ? 100 : 0)), 2000, '\x7f');
    dir_.write("drive.session", damaged);
    const std::string error =
        refusal([&] { EXPECT_EQ(1000U, readGraph(Session(path_)).graph.nodes().size()); });
    EXPECT_TRUE((error.empty() && i > 0) || mentions(error, {path_.c_str(), "it is corrupted"})) << i;
  }
}

TEST_F(SessionTest, OneWriterAtATime) {
  auto writer = std::make_unique<SessionWriter>(path_, true);
  EXPECT_TRUE(mentions(refusal([&] { SessionWriter other(path_, true); }),
                       {path_.c_str(), "another program or node"}));
  writer.reset();
  EXPECT_EQ("", refusal([&] { SessionWriter other(path_, true); }));
  EXPECT_FALSE(std::filesystem::exists(path_ + "-lock"));
}

TEST_F(SessionTest, ReadsWhereNothingCanBeWritten) {
  if (geteuid() == 0) GTEST_SKIP() << "for root all can be written";
  {
    SessionWriter writer(path_, true);
    writer.put(keyPose(0, writer.beginRun(0, ""), {}));
  }
  namespace fs = std::filesystem;
  fs::permissions(path_, fs::perms::owner_read);
  EXPECT_TRUE(mentions(refusal([&] { SessionWriter writer(path_, true); }), {path_.c_str(), "read-only"}));
  fs::permissions(dir_.path(), fs::perms::owner_read | fs::perms::owner_exec);
  EXPECT_EQ(1U, readGraph(Session(path_)).graph.nodes().size());
  EXPECT_TRUE(
      mentions(refusal([&] { SessionWriter writer(path_, true); }), {path_.c_str(), "can't be written"}));
  fs::permissions(dir_.path(), fs::perms::owner_all);
}

TEST_F(SessionTest, FindsDamagedData) {
  {
    SessionWriter writer(path_, true);
    writer.put(keyPose(0, writer.beginRun(0, ""), {}));
    writer.put(KeyData{0, DataKind::kScan, 1, "", {}, 1, randomFloats(20000, 2)});
  }
  std::string bytes = mapping_common::readFile(path_);
  bytes[bytes.size() - 3000] ^= 1;
  dir_.write("drive.session", bytes);
  EXPECT_TRUE(mentions(refusal([&] { Session(path_).dataAt(0, DataKind::kScan); }),
                       {"corrupted at key pose 0", "damaged"}));
}

TEST_F(SessionTest, BoundsWhatWaits) {
  SessionWriterOptions options;
  options.period = 60.0;
  options.memory = 1.0;
  SessionWriter writer(path_, true, options);
  writer.put(keyPose(0, writer.beginRun(0, ""), {}));
  for (int i = 0; i < 5; ++i) writer.put(KeyData{0, DataKind::kCloud, i, "", {}, 1, randomFloats(100000, 3)});
  EXPECT_EQ(3U, writer.status().lost);
  EXPECT_EQ(800000U, writer.status().waiting_bytes);
  writer.flush();
  EXPECT_EQ(0U, writer.status().waiting_bytes);
  EXPECT_EQ(2U, Session(path_).amounts()[DataKind::kCloud].count);
}

// Files of this process can't grow beyond a size, as on a full disk, until this ends.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() { setrlimit(RLIMIT_FSIZE, &before_); }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit before_{};
};

TEST_F(SessionTest, GoesOnAfterAFullDisk) {
  SessionWriterOptions options;
  options.period = 0.05;
  options.memory = 8.0;
  SessionWriter writer(path_, true, options);
  writer.put(keyPose(0, writer.beginRun(0, ""), {}));
  writer.flush();
  const std::string scan = randomFloats(50000, 4);
  {
    const FullDisk full(1 << 20);
    for (int i = 1; i <= 100; ++i) {
      writer.put(keyPose(i, 0, planarPose(i, 0, 0)));
      writer.put(KeyData{i, DataKind::kScan, i, "", {}, 1, scan});
      if (i % 10 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_NE("", refusal([&] { writer.flush(); }));
    EXPECT_TRUE(mentions(writer.status().error, {path_.c_str()}));
    EXPECT_GT(writer.status().lost, 30U);
    EXPECT_LT(writer.status().lost, 90U);
    EXPECT_GT(writer.status().unwritten_since, 0.0);
    EXPECT_EQ(101U, readGraph(Session(path_)).graph.nodes().size()) << "there is room for key poses";
  }
  writer.flush();
  const auto status = writer.status();
  EXPECT_EQ("", status.error);
  EXPECT_EQ(0U, status.waiting_bytes);
  EXPECT_EQ(101U, readGraph(Session(path_)).graph.nodes().size()) << "no key pose is lost";
  EXPECT_EQ(100U - status.lost, Session(path_).amounts()[DataKind::kScan].count);
}

// What a child process has put, and when.
struct Shared {
  std::atomic<int> count;
  double times[1 << 20];
};

// A process that is killed while it writes loses what it has put within the last moment, and no more. The
// environment variable SESSION_KILLS says how often.
TEST_F(SessionTest, OutlivesBeingKilled) {
  void* memory = mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(MAP_FAILED, memory);
  auto* shared = new (memory) Shared;
  std::mt19937 random(1);
  constexpr double kLoses = 1.0;  // s
  int key_poses = 0;
  const char* asked_for = std::getenv("SESSION_KILLS");
  const int kills = asked_for != nullptr ? std::atoi(asked_for) : 12;
  for (int kill_number = 0; kill_number < kills; ++kill_number) {
    shared->count = 0;
    const pid_t child = fork();
    if (child == 0) {
      SessionWriterOptions options;
      options.period = 0.05;
      SessionWriter writer(path_, true, options);
      const std::int64_t first = writer.nextKeyPose(), run = writer.beginRun(first, "");
      for (int i = 0; i < 1 << 20; ++i) {
        writer.put(keyPose(first + i, run, planarPose(i, 0, 0)));
        if (i > 0) {
          SessionEdge edge;
          edge.id = writer.nextEdge();
          edge.from = first + i - 1, edge.to = first + i;
          edge.transform = planarPose(1, 0, 0);
          writer.put(edge);
        }
        writer.put(KeyData{first + i, DataKind::kScan, i, "laser", {}, 1, randomFloats(500, i)});
        shared->times[i] = now();
        shared->count = i + 1;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      _exit(0);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(
        std::uniform_int_distribution<int>(0, kill_number % 4 == 3 ? 1500 : 300)(random)));
    kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(child, waitpid(child, &status, 0));
    ASSERT_TRUE(WIFSIGNALED(status)) << "it ended by itself";
    const double end = now();
    if (shared->count == 0 && !std::filesystem::exists(path_)) continue;
    { SessionWriter writer(path_, true); }  // also where it was killed before it had a table
    const Session session(path_);
    const SessionGraph read = readGraph(session);
    const int there = static_cast<int>(read.graph.nodes().size()) - key_poses;
    int must = shared->count;
    while (must > 0 && shared->times[must - 1] > end - kLoses) --must;
    EXPECT_GE(there, must);
    key_poses += there;
    const int scans = static_cast<int>(session.amounts()[DataKind::kScan].count);
    EXPECT_LE(scans, key_poses);
    EXPECT_GE(scans, key_poses - kill_number - 1) << "at most the last of each process came alone";
  }
  EXPECT_GT(key_poses, 100);
  Session(path_).visitData(DataKind::kScan, [](KeyData&& data) {
    EXPECT_EQ(randomFloats(500, static_cast<int>(data.stamp)), data.data);
    return !HasFailure();
  });
  munmap(memory, sizeof(Shared));
}

}  // namespace
}  // namespace pose_graph
