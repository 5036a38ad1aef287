// SPDX-License-Identifier: BSD-3-Clause
//
// The programs as their users run them, seen by a raw client.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <thread>

#include "emulator_host.h"
#include "faults.h"
#include "mapping_common/testing/temp_dir.h"
#include "program.h"

namespace device_emulators {
namespace {

using mapping_common::TempDir;

// Reads until the text has come.
std::string readUntil(int descriptor, const std::string& end) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(kPatience);
  std::string text;
  while (text.find(end) == std::string::npos && std::chrono::steady_clock::now() < deadline) {
    pollfd readable{descriptor, POLLIN, 0};
    if (poll(&readable, 1, 100) != 1) continue;
    char buffer[4096];
    const ssize_t size = read(descriptor, buffer, sizeof buffer);
    if (size <= 0) break;
    text.append(buffer, size);
  }
  return text;
}

void say(int descriptor, const std::string& bytes) {
  ASSERT_EQ(write(descriptor, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
}

bool eventually(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(kPatience);
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return condition();
}

// What a tool prints on standard output, and its exit status.
std::pair<std::string, int> runTool(const std::vector<std::string>& arguments) {
  Program tool(arguments);
  std::string text = tool.stop(0);
  return {text, tool.status()};
}

int connectTo(int port) {
  const int client = socket(AF_INET, SOCK_STREAM, 0);
  const sockaddr_in address = localAddress(port);
  if (connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return client;
  close(client);
  return -1;
}

int openTerminal(const std::string& link, speed_t rate) {
  const int terminal = open(link.c_str(), O_RDWR | O_NOCTTY);
  if (terminal < 0) return -1;
  termios settings;
  tcgetattr(terminal, &settings);
  cfmakeraw(&settings);
  cfsetspeed(&settings, rate);
  tcsetattr(terminal, TCSANOW, &settings);
  return terminal;
}

TEST(HokuyoEmulator, OverTcp) {
  const TempDir folder;
  const int port = freePort();
  Program program({HOKUYO_EMULATOR, "--tcp", std::to_string(port), "--truth", folder.path("truth.csv"),
                   "--packet-size", "64", "--outage-time", "0.1"});
  ASSERT_TRUE(program.isReady());
  const int client = connectTo(port);
  ASSERT_GE(client, 0);
  say(client, "PP\n");
  EXPECT_NE(readUntil(client, "\n\n").find("AMAX:1080;Z\n"), std::string::npos);

  const int second = connectTo(port);
  char byte;
  EXPECT_EQ(read(second, &byte, 1), 0) << "a second client is turned away";
  close(second);

  say(client, "MD0000108001003\n");
  const std::string stream = readUntil(client, "MD0000108001000\n99b\n");
  EXPECT_EQ(stream.find("MD0000108001003\n00P\n\nMD0000108001002\n99b\n"), 0u);
  EXPECT_NE(readUntil(client, "\n\n"), "");
  close(client);
  const std::string counts = program.stop(SIGTERM);
  EXPECT_NE(counts.find("scans 3\n"), std::string::npos) << counts;

  std::ifstream truth(folder.path("truth.csv"));
  std::string line;
  int lines = 0;
  while (std::getline(truth, line)) ++lines;
  EXPECT_EQ(lines, 1 + 3);
}

TEST(HokuyoEmulator, PulledCableOverTcp) {
  const int port = freePort();
  Program program(
      {HOKUYO_EMULATOR, "--tcp", std::to_string(port), "--disconnect", "1", "--outage-time", "0.1"});
  ASSERT_TRUE(program.isReady());
  const int client = connectTo(port);
  say(client, "PP\n");
  char byte;
  EXPECT_EQ(read(client, &byte, 1), -1);
  EXPECT_EQ(errno, ECONNRESET);
  close(client);
  int again = -1;
  EXPECT_TRUE(eventually([&] { return (again = connectTo(port)) >= 0; }));
  close(again);
  EXPECT_NE(program.stop().find("injected disconnect 1\n"), std::string::npos);
}

// Closed with bytes unread, a connection ends in an error, and the next may come before that is read.
TEST(HokuyoEmulator, TakesAHostThatComesBackAtOnce) {
  const int port = freePort();
  Program program({HOKUYO_EMULATOR, "--tcp", std::to_string(port), "--keep-streaming"});
  ASSERT_TRUE(program.isReady());
  int client = connectTo(port);
  say(client, "MD0000108001000\n");
  for (int i = 0; i < 20; ++i) {
    EXPECT_NE(readUntil(client, "99b"), "");
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    close(client);
    client = connectTo(port);
    char byte;
    ASSERT_EQ(read(client, &byte, 1), 1) << i;
  }
  close(client);
}

TEST(HokuyoEmulator, CablePulledWhileThereIsNoHost) {
  const int port = freePort();
  Program program(
      {HOKUYO_EMULATOR, "--tcp", std::to_string(port), "--inject", "disconnect@0", "--outage-time", "0.3"});
  ASSERT_TRUE(program.isReady());
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(kPatience);
  bool answers = false;
  while (!answers && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    const int client = connectTo(port);
    if (client < 0) continue;
    send(client, "BM\n", 3, MSG_NOSIGNAL);
    answers = readUntil(client, "\n\n") == "BM\n00P\n\n";
    close(client);
  }
  EXPECT_TRUE(answers) << "a host that came during the outage is kept and never heard";
  EXPECT_EQ(program.stop().find("connects 1\n"), 0u);
}

TEST(HokuyoEmulator, OnAPseudoTerminal) {
  const TempDir folder;
  const std::string link = folder.path("hokuyo");
  Program program({HOKUYO_EMULATOR, "--pty", link});
  ASSERT_TRUE(program.isReady());
  // Without any settings by the host: nothing is echoed or changed.
  const int terminal = open(link.c_str(), O_RDWR | O_NOCTTY);
  ASSERT_GE(terminal, 0);
  say(terminal, "BM\n");
  EXPECT_EQ(readUntil(terminal, "\n\n"), "BM\n00P\n\n");
  close(terminal);
  const int reopened = open(link.c_str(), O_RDWR | O_NOCTTY);
  ASSERT_GE(reopened, 0);
  say(reopened, "BM\n");
  EXPECT_EQ(readUntil(reopened, "\n\n"), "BM\n02R\n\n");
  close(reopened);
  EXPECT_NE(program.stop(), "");
  EXPECT_FALSE(std::filesystem::is_symlink(link));
}

TEST(HokuyoEmulator, PulledCableOnAPseudoTerminal) {
  const TempDir folder;
  const std::string link = folder.path("hokuyo");
  Program program({HOKUYO_EMULATOR, "--pty", link, "--outage-time", "0.1", "--disconnect", "1"});
  ASSERT_TRUE(program.isReady());
  for (int i = 0; i < 2; ++i) {
    int terminal = -1;
    ASSERT_TRUE(eventually([&] { return (terminal = open(link.c_str(), O_RDWR | O_NOCTTY)) >= 0; }));
    say(terminal, "BM\n");
    char byte;
    EXPECT_LE(read(terminal, &byte, 1), 0);
    close(terminal);
  }
  EXPECT_NE(program.stop().find("injected disconnect 2\n"), std::string::npos);
  EXPECT_FALSE(std::filesystem::is_symlink(link));
}

TEST(SickEmulator, OnAPseudoTerminal) {
  const TempDir folder;
  const std::string link = folder.path("sick");
  Program program({SICK_EMULATOR, "--pty", link, "--baud", "38400"});
  ASSERT_TRUE(program.isReady());
  const int terminal = openTerminal(link, B9600);
  ASSERT_GE(terminal, 0);
  say(terminal, fromHex("02 00 02 00 20 25 35 08"));
  pollfd readable{terminal, POLLIN, 0};
  EXPECT_EQ(poll(&readable, 1, 300), 0) << "a host at another rate isn't understood";
  close(terminal);
  const int matching = openTerminal(link, B38400);
  say(matching, fromHex("02 00 02 00 20 25 35 08"));
  EXPECT_EQ(toHex(readUntil(matching, fromHex("16 0A"))), "06 02 80 03 00 A0 00 10 16 0A");
  say(matching, fromHex("02 00 02 00 20 24 34 08"));
  const auto start = std::chrono::steady_clock::now();
  std::string stream;
  while (stream.size() < 10 + 5 * 372) {
    const std::string part = readUntil(matching, "\x02\x80");
    ASSERT_NE(part, "");
    stream += part;
  }
  EXPECT_GT(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(400)) << "paced";
  close(matching);
  EXPECT_NE(program.stop().find("configuration writes 0\n"), std::string::npos);
}

TEST(HokuyoEmulator, InjectsEveryFaultThatIsAskedFor) {
  const int port = freePort();
  std::vector<std::string> arguments = {HOKUYO_EMULATOR,
                                        "--tcp",
                                        std::to_string(port),
                                        "--silence-time",
                                        "0",
                                        "--stall-time",
                                        "0",
                                        "--outage-time",
                                        "0",
                                        "--boot-delay",
                                        "0"};
  const std::vector<Fault> faults = {Fault::kBytesLost, Fault::kBitsFlipped, Fault::kCut,
                                     Fault::kGarbage,   Fault::kSilence,     Fault::kStall};
  for (const Fault fault : faults) {
    arguments.push_back("--" + std::string(faultName(fault)));
    arguments.push_back("1");
  }
  Program program(arguments);
  ASSERT_TRUE(program.isReady());
  const int client = connectTo(port);
  say(client, "VV\n");
  pollfd readable{client, POLLIN, 0};
  EXPECT_EQ(poll(&readable, 1, kPatience * 1000), 1);
  close(client);
  const std::string counts = program.stop();
  for (const Fault fault : faults)
    EXPECT_NE(counts.find("injected " + std::string(faultName(fault)) + " 1\n"), std::string::npos) << counts;
}

TEST(Tools, GetId) {
  const int port = freePort();
  Program emulator({HOKUYO_EMULATOR, "--tcp", std::to_string(port), "--streaming"});
  ASSERT_TRUE(emulator.isReady());
  const std::string at = "127.0.0.1:" + std::to_string(port);
  EXPECT_EQ(runTool({GET_ID, at, "q"}), std::pair(std::string("00902676\n"), 0));
  EXPECT_EQ(runTool({GET_ID, at}), std::pair("Device at " + at + " has ID 00902676\n", 0));
  emulator.stop();
  EXPECT_EQ(runTool({GET_ID, at, "--patience", "0.3"}), std::pair(std::string(), 1));
  EXPECT_EQ(runTool({GET_ID}), std::pair(std::string(), 2));
  EXPECT_EQ(runTool({GET_ID, "127.0.0.1:x"}), std::pair(std::string(), 2));
  EXPECT_EQ(runTool({GET_ID, "--help"}).first.find("Usage: getID"), 0u);

  const TempDir folder;
  const std::string link = folder.path("port");
  Program serial({HOKUYO_EMULATOR, "--pty", link});
  ASSERT_TRUE(serial.isReady());
  EXPECT_EQ(runTool({GET_ID, link, "q"}), std::pair(std::string("00902676\n"), 0));
}

TEST(Tools, SetUrgIp) {
  const int port = freePort();
  Program emulator({HOKUYO_EMULATOR, "--tcp", std::to_string(port), "--model", "UST-10LX"});
  ASSERT_TRUE(emulator.isReady());
  const std::vector<std::string> at = {"--ip", "127.0.0.1", "--port", std::to_string(port)};
  const auto set = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), SET_URG_IP);
    arguments.insert(arguments.end(), at.begin(), at.end());
    return runTool(arguments);
  };
  const auto [text, status] = set({"192.168.0.11", "192.168.0.1"});
  EXPECT_EQ(status, 0);
  EXPECT_NE(text.find("has been told the address 192.168.0.11. Switch it off and on."), std::string::npos)
      << text;
  EXPECT_EQ(set({"192.168.0.11", "192.168.1.1"}).second, 2);
  EXPECT_EQ(set({"192.168.0.11"}).second, 2);
  emulator.stop();
  EXPECT_EQ(set({"192.168.0.11", "192.168.0.1", "--patience", "0.3"}).second, 1);
  EXPECT_EQ(runTool({SET_URG_IP, "--help"}).first.find("Usage: set_urg_ip"), 0u);
}

TEST(Emulators, WrongArguments) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{HOKUYO_EMULATOR},
                                             {HOKUYO_EMULATOR, "--tcp", "0"},
                                             {SICK_EMULATOR, "--pty", "x", "--baud", "4800"}}) {
    Program program(arguments);
    program.stop(0);
    EXPECT_EQ(program.status(), 2);
  }
  Program program({HOKUYO_EMULATOR, "--tcp", std::to_string(freePort()), "--bag", "/nowhere.bag"});
  program.stop(0);
  EXPECT_EQ(program.status(), 1);
  Program help({SICK_EMULATOR, "--help"});
  const std::string text = help.stop(0);
  for (const char* option : {"--pty", "--bits-flipped", "--truth", "--boot-delay"})
    EXPECT_NE(text.find(option), std::string::npos) << option;
}

}  // namespace
}  // namespace device_emulators
