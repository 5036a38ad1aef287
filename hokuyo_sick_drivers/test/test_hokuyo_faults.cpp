// SPDX-License-Identifier: BSD-3-Clause
//
// What befalls a scanner that measures. HokuyoDialogue checks each scan that comes out.
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "hokuyo_dialogue.h"

namespace hokuyo_sick_drivers {
namespace {

constexpr std::uint64_t kAt = 40;  // the scan that something happens to

// Runs a dialogue in which scan kAt is damaged. @return how many scans the driver didn't publish until the
// end
std::uint64_t runDamaged(HokuyoDialogue& dialogue,
                         const std::function<std::string(std::string, std::uint64_t)>& damage) {
  dialogue.device.damage = damage;
  dialogue.connect();
  dialogue.run(3.0);
  dialogue.device.damage = nullptr;
  const std::uint64_t before = dialogue.scans;
  dialogue.run(1.0);
  EXPECT_GE(dialogue.scans, before + 39);
  return dialogue.device.scans - dialogue.scans;
}

std::uint64_t damageOne(HokuyoDialogue& dialogue, const std::function<std::string(std::string)>& damage) {
  return runDamaged(dialogue, [damage](std::string message, std::uint64_t number) {
    return number == kAt ? damage(std::move(message)) : message;
  });
}

TEST(HokuyoFaultTest, wrongSumInARow) {
  HokuyoDialogue dialogue;
  const std::uint64_t missing = damageOne(dialogue, [](std::string message) {
    message.replace(500, 1, message.substr(500, 1) == "0" ? "1" : "0");
    return message;
  });
  EXPECT_LE(missing, 2u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kLostScan), 1u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kRestart), 0u);
}

TEST(HokuyoFaultTest, anyByteFlippedOrLost) {
  std::mt19937 random(1);
  for (const bool is_lost : {false, true}) {
    HokuyoDialogue dialogue;
    std::uint64_t faults = 0;
    runDamaged(dialogue, [&](std::string message, std::uint64_t) {
      if (random() % 8 != 0) return message;
      ++faults;
      const std::size_t at = random() % message.size();
      if (is_lost) {
        message.erase(at, 1);
      } else {
        message[at] = static_cast<char>(message[at] ^ (1 << random() % 8));
      }
      return message;
    });
    EXPECT_GT(faults, 5u);
    EXPECT_GE(dialogue.fault(HokuyoFault::kLostScan) + 1, faults);
  }
}

TEST(HokuyoFaultTest, cutMessageCostsOneScan) {
  for (const std::size_t at : {0, 3, 14, 15, 18, 22, 24, 25, 90, 2000, 6710, 6716}) {
    HokuyoDialogue dialogue;
    const std::uint64_t missing =
        damageOne(dialogue, [at](const std::string& message) { return message.substr(0, at); });
    EXPECT_LE(missing, at < 16 ? 3u : 2u) << at;
    EXPECT_EQ(dialogue.fault(HokuyoFault::kRestart), 0u) << at;
  }
}

TEST(HokuyoFaultTest, garbageBetweenScans) {
  HokuyoDialogue dialogue;
  damageOne(dialogue, [](const std::string& message) {
    return std::string(70000, '~') + message + "what\n00P\n\n" + std::string(10, '\n');
  });
  EXPECT_GE(dialogue.fault(HokuyoFault::kBroken), 1u);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kForeign), 2u);  // the scan without its echo is one
}

TEST(HokuyoFaultTest, statusInTheStream) {
  HokuyoDialogue unstable;
  damageOne(unstable, [](const std::string& message) { return message.substr(0, 16) + "0Mm\n\n"; });
  EXPECT_EQ(unstable.fault(HokuyoFault::kUnstable), 1u);
  EXPECT_EQ(unstable.fault(HokuyoFault::kRestart), 0u);

  HokuyoDialogue resumed;
  damageOne(resumed, [](const std::string& message) { return message.substr(0, 16) + "98a\n\n"; });
  EXPECT_EQ(resumed.fault(HokuyoFault::kRestart), 0u);

  HokuyoDialogue trouble;
  damageOne(trouble, [](const std::string& message) { return message.substr(0, 16) + "50U\n\n"; });
  EXPECT_EQ(trouble.fault(HokuyoFault::kErrorStatus), 1u);
  EXPECT_EQ(trouble.fault(HokuyoFault::kRestart), 1u);
  EXPECT_TRUE(trouble.wasSaid("status 50"));
}

TEST(HokuyoFaultTest, scansThatAreAllBad) {
  HokuyoDialogue dialogue;
  dialogue.device.damage = [](std::string message, std::uint64_t number) {
    if (number >= kAt) message.replace(100, 1, "\r");
    return message;
  };
  dialogue.connect();
  dialogue.run(6.0);
  EXPECT_GE(dialogue.fault(HokuyoFault::kRestart), 4u);
  EXPECT_GE(dialogue.reconnects, 1);
  EXPECT_EQ(dialogue.scans, kAt);
  EXPECT_TRUE(dialogue.wasSaid("4 bad scans in a row: 4 wrong sums"));
  dialogue.device.damage = nullptr;
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, kAt + 10);
}

TEST(HokuyoFaultTest, moreRaysThanAskedFor) {
  HokuyoDialogue dialogue;
  damageOne(dialogue, [](std::string message) {
    message.insert(message.size() - 1, "000000P\n");  // the row before isn't full
    return message;
  });
  EXPECT_EQ(dialogue.fault(HokuyoFault::kLength), 1u);
}

// As old firmware of the UTM-30LX.
TEST(HokuyoFaultTest, stallsWithIntensitiesOverAWideAngle) {
  HokuyoDialogue dialogue;
  dialogue.device.stalls_beyond = 381;
  dialogue.connect();
  dialogue.run(20.0);
  EXPECT_EQ(dialogue.fault(HokuyoFault::kRestart), 3u);
  EXPECT_EQ(dialogue.reconnects, 0);
  const std::uint64_t before = dialogue.scans;
  dialogue.run(10.0);
  EXPECT_GE(dialogue.scans, before + 399);
  EXPECT_TRUE(dialogue.last.intensities.empty());
  for (const char* advice :
       {"over 270 degrees", "Set cluster to 3", "at most 95 degrees", "publish_intensity"}) {
    EXPECT_NE(dialogue.driver.status().warning.find(advice), std::string::npos) << advice;
    EXPECT_TRUE(dialogue.wasSaid(advice));
  }
  HokuyoSettings settings;
  settings.cluster = 3;
  dialogue.driver.configure(settings, dialogue.now);
  dialogue.run(10.0);
  EXPECT_EQ(dialogue.last.intensities.size(), 360u);
  EXPECT_EQ(dialogue.driver.status().warning, "");
  EXPECT_EQ(dialogue.fault(HokuyoFault::kRestart), 3u);
}

TEST(HokuyoFaultTest, stallsOfAnotherKindLeaveTheIntensities) {
  HokuyoSettings settings;
  settings.angle_min = -0.8;
  settings.angle_max = 0.8;
  HokuyoDialogue dialogue({}, settings);
  dialogue.device.stalls_beyond = 100;
  dialogue.connect();
  dialogue.run(20.0);
  EXPECT_GT(dialogue.fault(HokuyoFault::kRestart), 5u);
  EXPECT_FALSE(dialogue.last.intensities.empty());
  EXPECT_TRUE(dialogue.wasSaid("no scan for"));
}

TEST(HokuyoFaultTest, stall) {
  HokuyoDialogue dialogue;
  dialogue.connect();
  dialogue.run(2.0);
  dialogue.device.silent = true;
  dialogue.device.damage = [](const std::string&, std::uint64_t) { return std::string(); };
  dialogue.run(5.0);
  EXPECT_GE(dialogue.fault(HokuyoFault::kTimeout), 1u);
  EXPECT_GE(dialogue.reconnects, 1);
  dialogue.device.silent = false;
  dialogue.device.damage = nullptr;
  const std::uint64_t before = dialogue.scans;
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, before);
}

TEST(HokuyoFaultTest, lostProbesDoNotSpoilTheClock) {
  HokuyoDialogue dialogue;
  dialogue.device.jitter = 5 * kMillisecond;
  dialogue.connect();
  for (int i = 0; i < 3; ++i) {  // every now and then the device is deaf while it is asked for the time
    dialogue.run(0.7);
    dialogue.device.silent = true;
    dialogue.run(0.02);
    dialogue.device.silent = false;
    dialogue.driver.updateStatus(dialogue.now);
  }
  dialogue.warm_up_end = dialogue.now + 15 * kSecond;
  dialogue.run(60.0);
  EXPECT_LT(dialogue.largest_error, 1.0);
}

TEST(HokuyoFaultTest, replyToPpIsTakenOnlyWithRightSums) {
  HokuyoDialogue dialogue;
  dialogue.device.statuses["PP"] = "0L";
  dialogue.connect();
  dialogue.run(3.0);
  EXPECT_EQ(dialogue.scans, 0u);
  EXPECT_GE(dialogue.reconnects, 1);
  dialogue.device.statuses.clear();
  dialogue.run(2.0);
  EXPECT_GT(dialogue.scans, 10u);
}

}  // namespace
}  // namespace hokuyo_sick_drivers
