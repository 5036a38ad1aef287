// SPDX-License-Identifier: BSD-3-Clause
//
// Whatever a Hokuyo, or something in its place, may send. The input is a program for the other side: bytes to
// send, answers to what was asked (some of them damaged), time that passes, connections that break, settings
// that change.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>

#include "hokuyo_sick_drivers/hokuyo.h"

using namespace hokuyo_sick_drivers;

namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

std::string summed(const std::string& line) {
  return line + scip::sum(line) + "\n";
}

// The other side.
class Device {
 public:
  explicit Device(std::string_view program)
      : program_(program),
        driver_(makeOptions(program.empty() ? '\0' : program[0]), settings_,
                {[this](const HokuyoScan& scan) { check(scan); }, [](Hokuyo::Level, const std::string&) {}}) {
  }

  void run() {
    driver_.connected(now_);
    while (!program_.empty()) {
      const auto code = static_cast<unsigned char>(take());
      const std::size_t length = code >> 3;
      switch (code & 7) {
        case 0:
          driver_.received(takeBytes(length), now_);
          break;
        case 1:
          now_ += static_cast<Nanoseconds>(length * length) * kMillisecond;
          break;
        case 2:
          answer();
          break;
        case 3:
          driver_.received(scan(length), now_);
          break;
        case 4: {
          std::string bytes = scan(1);
          if (!bytes.empty())
            bytes[static_cast<unsigned char>(take()) % bytes.size()] ^= static_cast<char>(1 << (length & 7));
          driver_.received(bytes, now_);
          break;
        }
        case 5:
          configure(length);
          break;
        case 6:
          driver_.received(command_ + "\n" + summed(std::string(takeBytes(2))) + "\n", now_);
          break;
        case 7:
          if (length == 0) {
            driver_.disconnected(now_);
            driver_.connected(now_);
          } else {
            driver_.updateStatus(now_);
          }
          break;
      }
      turn();
    }
    driver_.shutDown(now_);
    for (int i = 0; i < 10 && !driver_.done(); ++i) {
      now_ = driver_.deadline();
      turn();
    }
    require(driver_.done());
  }

 private:
  static Hokuyo::Options makeOptions(char c) {
    Hokuyo::Options options;
    options.synchronize_clock = (c & 1) == 0;
    options.reset = (c & 2) != 0;
    options.clock_probes = 12;
    if ((c & 4) != 0) options.baud_rates = {115200, 19200};
    return options;
  }
  char take() {
    if (program_.empty()) return 0;
    const char c = program_[0];
    program_.remove_prefix(1);
    return c;
  }
  std::string_view takeBytes(std::size_t length) {
    const std::string_view bytes = program_.substr(0, length);
    program_.remove_prefix(bytes.size());
    return bytes;
  }

  void turn() {
    if (now_ >= driver_.deadline()) driver_.tick(now_);
    int outputs = 0;
    for (auto output = driver_.takeOutput(); !output.empty(); output = driver_.takeOutput()) {
      require(++outputs < 10);
      if (!output.bytes.empty()) command_ = output.bytes.substr(0, output.bytes.size() - 1);
      if (output.reconnect) {
        driver_.disconnected(now_);
        driver_.connected(now_);
      }
    }
  }

  std::string clock() const { return summed(encoded(static_cast<std::uint32_t>(now_ / kMillisecond), 4)); }
  static std::string encoded(std::uint32_t value, int width) {
    std::string text;
    for (int shift = 6 * (width - 1); shift >= 0; shift -= 6)
      text += static_cast<char>((value >> shift & 63) + 48);
    return text;
  }

  void answer() {
    std::string text = command_ + "\n" + summed("00");
    if (command_ == "PP") {
      for (const char* line :
           {"DMIN:23;", "DMAX:60000;", "ARES:1440;", "AMIN:520;", "AMAX:560;", "AFRT:540;", "SCAN:2400;"}) {
        text += summed(line);
      }
    } else if (command_ == "TM1") {
      text += clock();
    }
    driver_.received(text + "\n", now_);
  }

  // As asked for, but of `extra` echoes more.
  std::string scan(std::size_t extra) {
    if (command_.size() != 15) return {};
    now_ += 25 * kMillisecond;
    const int first = std::atoi(command_.substr(2, 4).c_str()),
              last = std::atoi(command_.substr(6, 4).c_str());
    const int cluster = std::atoi(command_.substr(10, 2).c_str());
    require(first >= 0 && first <= last && last <= 560 && cluster >= 1);
    const int rays = (last - first + 1) / cluster;
    const std::string value = command_[1] == 'E' ? "0?X0LA" : "0?X";
    std::string data;
    for (int ray = 0; ray < rays; ++ray) {
      data += value;
      if (command_[0] == 'N' && ray % 5 == 0) data += "&" + value;
    }
    for (std::size_t i = 1; i < extra; ++i) data += "&" + value;
    std::string message = command_ + "\n" + summed("99") + clock();
    for (std::size_t i = 0; i < data.size(); i += 64) message += summed(data.substr(i, 64));
    return message + "\n";
  }

  void configure(std::size_t bits) {
    HokuyoSettings settings = settings_;
    settings.intensity = (bits & 1) != 0;
    settings.multi_echo = (bits & 2) != 0;
    settings.cluster = 1 + static_cast<unsigned char>(take()) % 99;
    settings.skip = static_cast<unsigned char>(take()) % 10;
    settings.angle_min = -0.2 + 0.002 * static_cast<unsigned char>(take());
    try {
      driver_.configure(settings, now_);
      settings_ = settings;
    } catch (const std::invalid_argument&) {  // no such rays
    }
  }

  void check(const HokuyoScan& scan) {
    const Hokuyo::Status status = driver_.status();
    require(status.geometry.has_value() && status.measuring);
    const auto& settings = status.settings;
    const HokuyoRequest request = HokuyoRequest::make(settings, *status.geometry);
    require(scan.rays() == static_cast<std::size_t>(request.rays()));
    require(scan.first_echo.back() == scan.ranges.size());
    require(scan.intensities.size() == (settings.intensity ? scan.ranges.size() : 0));
    for (std::size_t ray = 0; ray < scan.rays(); ++ray) {
      const auto echoes = scan.first_echo[ray + 1] - scan.first_echo[ray];
      require(echoes >= 1 && echoes <= (settings.multi_echo ? 3u : 1u));
    }
    require(scan.angle_min >= settings.angle_min - 1e-6 && scan.angle_max <= settings.angle_max + 1e-6);
    require(scan.stamp <= now_ + kSecond);
  }

  std::string_view program_;
  HokuyoSettings settings_;
  Nanoseconds now_ = 100 * kSecond;
  std::string command_;
  Hokuyo driver_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Device({reinterpret_cast<const char*>(data), size}).run();
  return 0;
}
