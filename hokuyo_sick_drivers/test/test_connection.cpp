// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <gtest/gtest.h>
#include <mapping_common/testing/temp_dir.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "hokuyo_sick_drivers/connection.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr std::chrono::seconds kPatience(20);

bool waitFor(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return condition();
}

// Says hello, answers each byte that it gets with the next in the alphabet, says bye at the end.
class Echo : public Protocol {
 public:
  void connected(Nanoseconds now) override {
    output_.push_back({"hello", 0, false});
    deadline_ = now + 20 * kMillisecond;
    ++connections;
  }
  void disconnected(Nanoseconds) override { ++disconnections; }
  void received(std::string_view bytes, Nanoseconds) override {
    std::string answer(bytes);
    for (char& c : answer) ++c;
    if (bytes == "!") return output_.push_back({"", 0, true});
    if (bytes == "?") throw std::logic_error("no answer to that");
    if (bytes == "500000") return output_.push_back({"ok", 500000, false});
    output_.push_back({answer, 0, false});
  }
  void tick(Nanoseconds now) override {
    ++ticks;
    deadline_ = now + 20 * kMillisecond;
  }
  Nanoseconds deadline() const override { return deadline_; }
  Output takeOutput() override {
    if (output_.empty()) return {};
    Output output = output_.front();
    output_.pop_front();
    return output;
  }
  void shutDown(Nanoseconds) override {
    output_.push_back({"bye", 0, false});
    done_ = true;
  }
  bool done() const override { return done_; }

  std::atomic<int> connections{0}, disconnections{0}, ticks{0};

 private:
  std::deque<Output> output_;
  Nanoseconds deadline_ = kNever;
  bool done_ = false;
};

std::string readSome(int fd, std::size_t size) {
  std::string text;
  waitFor([&] {
    char buffer[64];
    const ssize_t got = ::read(fd, buffer, std::min(sizeof(buffer), size - text.size()));
    if (got > 0) text.append(buffer, static_cast<std::size_t>(got));
    return text.size() >= size;
  });
  return text;
}
void writeAll(int fd, const std::string& text) {
  ASSERT_EQ(::write(fd, text.data(), text.size()), static_cast<ssize_t>(text.size()));
}

// The other side of a serial port.
struct Pty {
  Pty() : master(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    grantpt(master.get());
    unlockpt(master.get());
    name = ptsname(master.get());
  }
  FileDescriptor master;
  std::string name;
};

// A device at a TCP port of the machine's choice.
struct Server {
  explicit Server(std::uint16_t port = 0) : listener(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0)) {
    const int on = 1;
    setsockopt(listener.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port);
    socklen_t size = sizeof(address);
    EXPECT_EQ(bind(listener.get(), reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(listen(listener.get(), 1), 0);
    getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &size);
    this->port = ntohs(address.sin_port);
  }
  int accept() {
    int fd = -1;
    waitFor([&] { return (fd = accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK)) >= 0; });
    return fd;
  }
  Endpoint endpoint() const { return {"127.0.0.1", port, "", 0}; }
  FileDescriptor listener;
  std::uint16_t port = 0;
};

struct Log {
  Connection::Events events() {
    const auto add = [this](const std::string& text) {
      const std::lock_guard<std::mutex> lock(mutex);
      lines.push_back(text);
    };
    return {[add] { add("connected"); }, [add](const std::string& why) { add("lost: " + why); },
            [add](const std::string& why) { add("refused: " + why); },
            [add](const std::string& what) { add("failed: " + what); }};
  }
  bool has(const std::string& text) {
    const std::lock_guard<std::mutex> lock(mutex);
    for (const std::string& line : lines) {
      if (line.find(text) != std::string::npos) return true;
    }
    return false;
  }
  std::mutex mutex;
  std::vector<std::string> lines;
};

TEST(ConnectionTest, tcp) {
  Server server;
  Echo protocol;
  Log log;
  {
    Connection connection(server.endpoint(), protocol, log.events());
    const FileDescriptor device(server.accept());
    EXPECT_EQ(readSome(device.get(), 5), "hello");
    writeAll(device.get(), "abc");
    EXPECT_EQ(readSome(device.get(), 3), "bcd");
    EXPECT_TRUE(waitFor([&] { return protocol.ticks > 2; }));
    std::atomic<bool> worked{false};
    connection.post([&](Nanoseconds) { worked = true; });
    EXPECT_TRUE(waitFor([&] { return worked.load(); }));
  }
  EXPECT_EQ(protocol.connections, 1);
}

TEST(ConnectionTest, comesBackWhenTheDeviceDoes) {
  Server server;
  Echo protocol;
  Log log;
  Connection connection(server.endpoint(), protocol, log.events());
  {
    const FileDescriptor device(server.accept());
    EXPECT_EQ(readSome(device.get(), 5), "hello");
  }
  {
    const FileDescriptor device(server.accept());
    EXPECT_EQ(readSome(device.get(), 5), "hello");
    writeAll(device.get(), "!");  // the protocol wants it
    EXPECT_TRUE(waitFor([&] { return protocol.disconnections == 2; }));
  }
  const FileDescriptor device(server.accept());
  EXPECT_EQ(readSome(device.get(), 5), "hello");
  const std::lock_guard<std::mutex> lock(log.mutex);
  EXPECT_EQ(log.lines,
            (std::vector<std::string>{"connected", "lost: the device closed the connection", "connected"}));
}

TEST(ConnectionTest, waitsForADeviceThatIsNotThereYet) {
  std::uint16_t port = 0;
  {
    const Server server;
    port = server.port;
  }
  Echo protocol;
  Log log;
  Connection connection({"127.0.0.1", port, "", 0}, protocol, log.events());
  EXPECT_TRUE(waitFor([&] { return log.has("refused: can't connect to 127.0.0.1:"); }));
  std::atomic<bool> worked{false};
  connection.post([&](Nanoseconds) { worked = true; });
  EXPECT_TRUE(waitFor([&] { return worked.load(); }));
  Server server(port);
  const FileDescriptor device(server.accept());
  EXPECT_EQ(readSome(device.get(), 5), "hello");
}

TEST(ConnectionTest, exceptionsOfTheDriverAreToldAsSuch) {
  Server server;
  Echo protocol;
  Log log;
  Connection connection(server.endpoint(), protocol, log.events());
  {
    const FileDescriptor device(server.accept());
    EXPECT_EQ(readSome(device.get(), 5), "hello");
    connection.post([](Nanoseconds) { throw std::runtime_error("no such work"); });
    EXPECT_TRUE(waitFor([&] { return log.has("failed: no such work"); }));
    writeAll(device.get(), "a");
    EXPECT_EQ(readSome(device.get(), 1), "b");  // goes on
    writeAll(device.get(), "?");
    EXPECT_TRUE(waitFor([&] { return log.has("failed: no answer to that"); }));
  }
  const FileDescriptor device(server.accept());
  EXPECT_EQ(readSome(device.get(), 5), "hello");
  EXPECT_TRUE(log.has("lost: the driver failed"));
  EXPECT_FALSE(log.has("refused"));
  EXPECT_EQ(protocol.disconnections, 1);
}

TEST(ConnectionTest, triesTheNextAddress) {
  Server server;
  std::uint16_t closed_port = 0;
  {
    const Server closed;
    closed_port = closed.port;
  }
  Connection::Options options;
  options.look_up = [&](const Endpoint& endpoint) {
    SocketAddress unknown;  // a family that this machine doesn't have, as IPv6 may be
    unknown.address.ss_family = AF_MAX;
    unknown.size = sizeof(unknown.address);
    std::vector<SocketAddress> addresses = {unknown, lookUp({"127.0.0.1", closed_port, "", 0}).at(0)};
    addresses.push_back(lookUp(endpoint).at(0));
    return addresses;
  };
  Echo protocol;
  Log log;
  const Connection connection(server.endpoint(), protocol, log.events(), options);
  const FileDescriptor device(server.accept());
  EXPECT_EQ(readSome(device.get(), 5), "hello");
  EXPECT_FALSE(log.has("refused"));
}

TEST(ConnectionTest, workIsDoneAndTheEndComesDuringALookUp) {
  std::promise<void> answer;
  const auto answered = answer.get_future().share();
  std::atomic<bool> asked{false};
  Connection::Options options;
  options.look_up = [&asked, answered](const Endpoint&) {
    asked = true;
    answered.wait();
    return std::vector<SocketAddress>();
  };
  Echo protocol;
  Log log;
  auto connection =
      std::make_unique<Connection>(Endpoint{"scanner", 10940, "", 0}, protocol, log.events(), options);
  EXPECT_TRUE(waitFor([&] { return asked.load(); }));
  std::promise<void> worked;
  connection->post([&](Nanoseconds) { worked.set_value(); });
  EXPECT_EQ(worked.get_future().wait_for(kPatience), std::future_status::ready);
  auto ended = std::async(std::launch::async, [&] { connection.reset(); });
  EXPECT_EQ(ended.wait_for(kPatience), std::future_status::ready);
  answer.set_value();
}

TEST(ConnectionTest, tellsANameThatNobodyKnows) {
  Echo protocol;
  Log log;
  const Connection connection({"no-such-host.invalid", 10940, "", 0}, protocol, log.events());
  EXPECT_TRUE(waitFor([&] { return log.has("refused: can't resolve no-such-host.invalid: "); }));
}

TEST(ConnectionTest, serialPort) {
  Pty pty;
  Echo protocol;
  Log log;
  {
    Connection connection({"", 0, pty.name, 38400}, protocol, log.events());
    EXPECT_EQ(readSome(pty.master.get(), 5), "hello");
    std::string all;
    for (int c = 0; c < 255; ++c) all += static_cast<char>(c);
    writeAll(pty.master.get(), all);  // raw: nothing is translated or echoed
    std::string expected = all;
    for (char& c : expected) ++c;
    EXPECT_EQ(readSome(pty.master.get(), all.size()), expected);

    const FileDescriptor slave(open(pty.name.c_str(), O_RDWR | O_NOCTTY));
    termios settings{};
    tcgetattr(slave.get(), &settings);
    EXPECT_EQ(cfgetospeed(&settings), static_cast<speed_t>(B38400));
    writeAll(pty.master.get(), "500000");
    EXPECT_EQ(readSome(pty.master.get(), 2), "ok");
    EXPECT_TRUE(waitFor([&] {
      tcgetattr(slave.get(), &settings);
      return cfgetospeed(&settings) == static_cast<speed_t>(B500000);
    }));
    EXPECT_THROW(openSerialPort(pty.name, 9600), std::runtime_error);  // ours
  }
  EXPECT_EQ(readSome(pty.master.get(), 3), "bye");
}

TEST(ConnectionTest, serialPortIsOpenedByNameAgain) {
  const mapping_common::TempDir folder;
  const std::string link = folder.path("port");
  Echo protocol;
  Log log;
  Connection connection({"", 0, link, 250000}, protocol, log.events());
  EXPECT_TRUE(waitFor([&] { return log.has("refused: can't open " + link); }));
  for (int i = 0; i < 2; ++i) {  // a device that comes and goes, each time under another number
    Pty pty;
    ASSERT_EQ(symlink(pty.name.c_str(), link.c_str()), 0);
    EXPECT_EQ(readSome(pty.master.get(), 5), "hello");
    unlink(link.c_str());
  }
  EXPECT_TRUE(waitFor([&] { return protocol.disconnections == 2; }));
}

TEST(ConnectionTest, whatIsNoSerialPort) {
  EXPECT_THROW(openSerialPort("/dev/null", 9600), std::runtime_error);
  EXPECT_THROW(openSerialPort("/dev/no_such_port", 9600), std::runtime_error);
}

}  // namespace
}  // namespace hokuyo_sick_drivers
