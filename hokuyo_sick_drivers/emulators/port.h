// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace device_emulators {

/// Where a host finds the emulated device.
class Port {
 public:
  virtual ~Port() = default;
  /// Makes it reachable. @throws std::runtime_error
  virtual void open() = 0;
  /// As if the cable had been pulled: the host's connection breaks, and there is nothing to connect to.
  virtual void close() = 0;
  virtual bool isOpen() const = 0;
  /// Looks for a host that came or went.
  virtual void update() = 0;
  /// Number of the connection with the present host; 0: there is none.
  virtual int connection() const = 0;
  /// To be watched for input: the host's; that by which a new host comes. -1: none.
  virtual int hostDescriptor() const = 0;
  virtual int listenDescriptor() const { return -1; }
  /// What came; empty if nothing.
  virtual std::string read() = 0;
  /// @return how many bytes went
  virtual std::size_t write(std::string_view bytes) = 0;
  /// Set by the host; 0 if the port has none.
  virtual int baudRate() const { return 0; }
};

/// A pseudo terminal, raw, under a name of its own.
class PtyPort : public Port {
 public:
  /// @param link made to point to the terminal, gone when closed; a link that is there is replaced
  explicit PtyPort(const std::string& link) : link_(link) {}
  ~PtyPort() override { close(); }
  void open() override;
  void close() override;
  bool isOpen() const override { return master_ >= 0; }
  void update() override;
  int connection() const override { return host_ ? connections_ : 0; }
  int hostDescriptor() const override { return host_ ? master_ : -1; }
  std::string read() override;
  std::size_t write(std::string_view bytes) override;
  int baudRate() const override;

 private:
  const std::string link_;
  std::string terminal_;
  int master_ = -1;
  bool host_ = false;
  int connections_ = 0;
};

/// A TCP server for one client.
class TcpPort : public Port {
 public:
  /// @param replace whether a second client takes the place of the first; otherwise it is turned away
  TcpPort(const std::string& address, int port, bool replace)
      : address_(address), port_(port), replace_(replace) {}
  ~TcpPort() override { close(); }
  void open() override;
  void close() override;
  bool isOpen() const override { return listener_ >= 0; }
  void update() override;
  int connection() const override { return client_ >= 0 ? connections_ : 0; }
  int hostDescriptor() const override { return client_; }
  int listenDescriptor() const override { return listener_; }
  std::string read() override;
  std::size_t write(std::string_view bytes) override;

 private:
  void dropClient(bool reset);

  const std::string address_;
  const int port_;
  const bool replace_;
  int listener_ = -1, client_ = -1;
  int connections_ = 0;
};

}  // namespace device_emulators
