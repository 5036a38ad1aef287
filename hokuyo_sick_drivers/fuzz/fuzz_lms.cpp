// SPDX-License-Identifier: BSD-3-Clause
//
// Feeds the driver of the SICK LMS 2xx with the worst: each input is a little program of what a device and a
// line may do, in virtual time. Build with
//   clang++-14 -std=c++17 -g -O2 -fsanitize=fuzzer,address,undefined -Iinclude -Itest fuzz/fuzz_lms.cpp
//   src/lms*.cpp
//     src/device_clock.cpp -o fuzz_lms
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "fake_lms.h"

namespace {

using namespace hokuyo_sick_drivers;

void require(bool condition) {
  if (!condition) std::abort();
}

// Reads the program; zeros behind its end.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  bool atEnd() const { return at_ >= size_; }
  int byte() { return atEnd() ? 0 : data_[at_++]; }
  std::string bytes(std::size_t count) {
    count = std::min(count, size_ - at_);
    at_ += count;
    return {reinterpret_cast<const char*>(data_) + at_ - count, count};
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_, at_ = 0;
};

LmsOptions optionsOf(int choice) {
  LmsOptions options;
  options.baud_rate = choice & 1 ? 500000 : 38400;
  options.restore_on_exit = choice & 2;
  options.real_time_index = (choice & 4) != 0;
  switch (choice >> 3 & 7) {
    case 0:
      options.intensity = LmsOptions::Intensity::kNormalised;
      options.intensity_range = LmsOptions::IntensityRange::kFlags;
      break;
    case 1:
      options.intensity = LmsOptions::Intensity::kDirect;
      options.first_index = 7;
      options.last_index = 12;
      break;
    case 2:
      options.variant = lms::Variant{180, 25};
      options.interlaced = true;
      break;
    case 3:
      options.variant = lms::Variant{180, 50};
      options.interlaced = true;
      break;
    case 4:
      options.variant = lms::Variant{100, 25};
      options.unit = lms::Unit::kMillimetre;
      break;
    case 5:
      options.intensity = LmsOptions::Intensity::kNormalised;
      options.intensity_range = LmsOptions::IntensityRange::kSixteen;
      break;
    default:
      break;
  }
  return options;
}

class Run {
 public:
  Run(const LmsOptions& options, int device)
      : options_(options), lms_(options, [this](const lms::Scan& scan) { check(scan); }) {
    if (device & 1) device_.type = "LMS291;S14;V02.30   ";
    if (device & 1) device_.angle = 90, device_.resolution = 50;
    if (device & 2) device_.configuration.resize(32);
    if (device & 4) device_.refuses_write = true;
    if (device & 8) device_.configuration[lms::kMeasuringMode] = 0x0D;
    lms_.connected(now_);
    drain();
  }

  void step(Input& input) {
    switch (input.byte() % 10) {
      case 0:
        return pass(input.byte() * kMillisecond);
      case 1:
        return pass(input.byte() * 20 * kMillisecond);
      case 2:
        return receive(input.bytes(input.byte()));
      case 3:
        return receive(answer(input.bytes(input.byte() * 4) + "\x90", input.byte()));
      case 4:
        return reply(input.byte());
      case 5:
        return scan(input.byte());
      case 6:
        for (int i = input.byte() % 8; i > 0; --i) scan(0);
        return;
      case 7:
        for (int i = input.byte() % 16; i > 0; --i) reply(0);
        return;
      case 8:
        if (input.byte() % 8 == 0) return stop();
        return receive(answer("\x90LMS291"));
      default:
        lms_.disconnected(now_);
        pass(input.byte() * kMillisecond);
        lms_.connected(now_);
        return drain();
    }
  }

  void stop() {
    lms_.shutDown(now_);
    drain();
    pass(Lms2xx::kRestoreTime + kMillisecond);
    require(lms_.done());
    require(lms_.deadline() == kNever);
  }

 private:
  void pass(Nanoseconds time) {
    const Nanoseconds end = now_ + time;
    while (lms_.deadline() <= end) {
      now_ = std::max(now_, lms_.deadline());
      lms_.tick(now_);
      require(lms_.deadline() > now_);
      drain();
    }
    now_ = end;
  }
  void receive(const std::string& bytes) {
    now_ += kMillisecond;
    lms_.received(bytes, now_);
    drain();
  }
  // What the device says to the oldest command, a bit of it flipped if `fault` says so.
  void reply(int fault) {
    if (commands_.empty()) return;
    const std::string bytes = device_.execute(commands_.front()).first;
    commands_.erase(commands_.begin());
    deliver("\x06" + bytes, fault);
  }
  void scan(int fault) {
    if (device_.stream.empty()) return;
    turn_ += device_.turns();
    now_ += device_.turns() * kSecond / 75;
    deliver(device_.scan(turn_), fault);
  }
  void deliver(std::string bytes, int fault) {
    if (fault >= 128)
      bytes[static_cast<std::size_t>(fault) * 7919 % bytes.size()] ^= static_cast<char>(1 << fault % 8);
    receive(bytes);
  }
  void drain() {
    int count = 0;
    for (auto output = lms_.takeOutput(); !output.empty(); output = lms_.takeOutput()) {
      require(++count < 64);
      require(output.bytes.empty() || output.bytes.size() >= 7);
      if (!output.bytes.empty()) commands_.push_back(output.bytes.substr(4, output.bytes.size() - 6));
      if (commands_.size() > 32) commands_.clear();
      if (output.reconnect) {
        lms_.disconnected(now_);
        require(lms_.deadline() == kNever);
        lms_.connected(now_);
      }
    }
  }
  void check(const lms::Scan& scan) {
    const std::size_t count = scan.ranges.size();
    const bool intensities = options_.intensity != LmsOptions::Intensity::kNone;
    const std::size_t most = options_.last_index > 0 ? options_.last_index - options_.first_index + 1 : 401;
    require(count > 0 && count <= most);
    require(scan.flags.size() == count);
    require(scan.intensities.size() == (intensities ? count : 0));
    require(scan.angle_min >= -M_PI_2 - 1e-6 &&
            scan.angle_min + (count - 1) * scan.angle_increment < M_PI_2 + 0.02);
    for (float r : scan.ranges) {
      require(std::isnan(r) || r == std::numeric_limits<float>::infinity() ||
              (r >= 0.0f && r <= scan.range_max * 1.0001));
    }
    require(scan.stamp <= now_ + kSecond);
    require(lms_.report().phase == LmsReport::Phase::kStreaming);
  }

  const LmsOptions options_;
  Nanoseconds now_ = 1000 * kSecond;
  FakeLms device_;
  std::vector<std::string> commands_;
  std::int64_t turn_ = 0;
  Lms2xx lms_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Input input(data, size);
  const int options = input.byte();
  Run run(optionsOf(options), input.byte());
  while (!input.atEnd()) run.step(input);
  run.stop();
  return 0;
}
