// SPDX-License-Identifier: BSD-3-Clause
//
// Feeds the parser of SICK LMS 2xx telegrams with streams of bytes, and the decoders with data. Build with
//   clang++-14 -std=c++17 -g -O2 -fsanitize=fuzzer,address,undefined -Iinclude fuzz/fuzz_lms_telegram.cpp
//     src/lms_telegram.cpp -o fuzz_lms_telegram
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "hokuyo_sick_drivers/lms_telegram.h"

namespace {

using namespace hokuyo_sick_drivers;

void require(bool condition) {
  if (!condition) std::abort();
}

template <class Decode>
void tryTo(const Decode& decode) {
  try {
    decode();
  } catch (const lms::DecodeError&) {
  }
}

void checkValues(const lms::Values& values) {
  require(static_cast<int>(values.ranges.size()) == values.stop - values.start + 1);
  require(values.intensities.empty() || values.intensities.size() == values.ranges.size());
}

void decode(const lms::Telegram& telegram) {
  tryTo([&] { checkValues(lms::decodeRanges(telegram)); });
  tryTo([&] { checkValues(lms::decodeReflectivities(telegram)); });
  tryTo([&] {
    const auto groups = lms::decodeIntensities(telegram);
    require(!groups.empty() && groups.size() <= lms::kMaxGroups);
    for (const lms::Values& group : groups) checkValues(group);
  });
  tryTo([&] { lms::decodeVariant(telegram).variant.valid(); });
  tryTo([&] { lms::decodeStatus(telegram).variant.valid(); });
  tryTo([&] { require(lms::decodeConfiguration(telegram).size() >= 32); });
  tryTo([&] { lms::decodeConfigured(telegram); });
  tryTo([&] { lms::decodeModeChange(telegram); });
  lms::decodeType(telegram);
}

// In chunks, the first byte of each tells how long it is.
void parseStream(std::string_view stream) {
  lms::Parser parser;
  lms::Telegram telegram;
  while (!stream.empty()) {
    const std::size_t size =
        std::min<std::size_t>(1 + static_cast<std::uint8_t>(stream[0]), stream.size() - 1);
    parser.add(stream.substr(1, size));
    stream.remove_prefix(1 + size);
    for (auto event = parser.next(telegram); event != lms::Parser::Event::kNone;
         event = parser.next(telegram)) {
      if (event == lms::Parser::Event::kTelegram) decode(telegram);
    }
    require(parser.pending() < lms::kMaxTelegram + lms::kMaxGroups);
  }
  while (parser.pending() > 0) {
    const std::size_t before = parser.pending();
    parser.endOfTelegram();
    while (parser.next(telegram) != lms::Parser::Event::kNone) decode(telegram);
    require(parser.pending() < before);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] >= 0x80) {
    parseStream(bytes);
  } else {
    decode({data[0], std::string(bytes), 0x10});
  }
  return 0;
}
