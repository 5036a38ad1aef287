// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "emulator_host.h"
#include "hokuyo_device.h"
#include "scip_text.h"

namespace device_emulators {
namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// All steps of a UTM-30LX; 540 and following have the values of the document's example.
std::shared_ptr<FixedSource> exampleSource() {
  Scan scan;
  scan.angle_increment = 2.0 * M_PI / 1440;
  scan.angle_min = -540 * scan.angle_increment;
  scan.ranges.assign(2, std::vector<float>(1081, 1.0f));
  scan.ranges[1].assign(1081, kNan);
  scan.intensities.assign(2, std::vector<float>(1081, 100.0f));
  scan.ranges[0][540] = 1.0f;
  scan.intensities[0][540] = 1809.0f;
  scan.ranges[0][541] = 2.0f;
  scan.intensities[0][541] = 300.0f;
  scan.ranges[0][542] = kInf;
  scan.intensities[0][542] = 0.0f;
  scan.ranges[1][540] = 1.5f;
  scan.intensities[1][540] = 350.0f;
  return std::make_shared<FixedSource>(scan);
}

struct Emulation {
  explicit Emulation(const HokuyoOptions& options = HokuyoOptions())
      : device(options, exampleSource()), host(device) {}
  std::string ask(const std::string& command, Nanoseconds duration = kMillisecond) {
    return host.ask(command + "\n", duration);
  }
  std::string askAll(const std::vector<std::string>& commands) {
    std::string replies;
    for (const std::string& command : commands) replies += ask(command);
    return replies;
  }
  HokuyoDevice device;
  Host host;
};

TEST(HokuyoDevice, AnswersAsRecordedFromAUtm30lx) {
  HokuyoOptions options;
  options.start_ms = 0x4991D0;
  Emulation s(options);
  EXPECT_EQ(s.ask("PP"),
            "PP\n00P\nMODL:UTM-30LX(Hokuyo Automatic Co.,Ltd.);" +
                std::string(1, scipSum("MODL:UTM-30LX(Hokuyo Automatic Co.,Ltd.)")) +
                "\nDMIN:23;7\nDMAX:60000;J\nARES:1440;^\nAMIN:0;?\nAMAX:1080;Z\nAFRT:540;0\nSCAN:2400;U\n\n");
  const std::string version = s.ask("VV");
  EXPECT_EQ(version.find("VV\n00P\nVEND:Hokuyo Automatic Co.,Ltd.;[\nPROD:SOKUIKI Sensor TOP-URG UTM-30LX;"),
            0u);
  EXPECT_NE(version.find("\nPROT:SCIP 2.0;N\nSERI:"), std::string::npos);
  EXPECT_EQ(s.ask("BM"), "BM\n00P\n\n");
  Emulation fresh(options);
  fresh.host.send("BM\nII\n");
  const std::string information = fresh.host.listen(0);
  EXPECT_NE(information.find("LASR:ON;9\nSCSP:Initial(2400[rpm])<-Default setting by user;1\nMESM:CLASSIC;^\n"
                             "SBPS:USB Full Speed;P\nTIME:4991D0;d\nSTAT:Sensor works well.;8\n\n"),
            std::string::npos)
      << information;
}

TEST(HokuyoDevice, SumMayIncludeTheSemicolon) {
  HokuyoOptions options;
  options.sum_semicolon = true;
  EXPECT_NE(Emulation(options).ask("PP").find("\n" + scipKeyLine("AMIN", "0", true)), std::string::npos);
}

TEST(HokuyoDevice, WorkedExampleOfIntensities) {
  HokuyoOptions options;
  options.start_ms = 4821609;
  Emulation s(options);
  EXPECT_EQ(s.ask("ME0540054201001", kSecond),
            "ME0540054201001\n00P\n\nME0540054201000\n99b\nBI9YM\n0?X0LA0O@04\\001000T\n\n");
  EXPECT_FALSE(s.device.laserOn());
}

TEST(HokuyoDevice, WorkedExamplesOfEchoes) {
  Emulation s{HokuyoOptions("UTM-30LX-EW")};
  EXPECT_NE(s.ask("ND0540054101001", kSecond).find("\n0?X&0GL0O@_\n\n"), std::string::npos);
  EXPECT_NE(s.ask("NE0540054001001", kSecond).find("\n" + scipLine("0?X0LA&0GL05N") + "\n"),
            std::string::npos);
  s.ask("BM");
  EXPECT_NE(s.ask("HD0540054101", kSecond).find("HD0540054101\n00P\n"), std::string::npos);
  EXPECT_NE(s.ask("HE0540054101", kSecond).find("&"), std::string::npos);
  EXPECT_EQ(s.ask("MD0540054101001", kSecond).find("&"), std::string::npos);
}

TEST(HokuyoDevice, SizesOfWholeMessages) {
  Emulation s;
  const std::string first = "MD0000108001001\n00P\n\n";
  EXPECT_EQ(s.ask("MD0000108001001", kSecond).size(), first.size() + 3372);
  EXPECT_EQ(s.ask("ME0000108001001", kSecond).size(), first.size() + 6717);
}

TEST(HokuyoDevice, CodesOfRanges) {
  Scan scan;
  scan.angle_increment = 2.0 * M_PI / 1440;
  scan.ranges = {{kNan, kInf, -kInf, 0.0f, 0.022f, 0.023f, 60.0f, 60.001f}};
  const std::vector<std::uint32_t> utm = {0, 1, 4, 0, 4, 23, 60000, 1};
  HokuyoRequest request;
  request.first = 540;
  request.last = 547;
  const SentScan sent = measure(&scan, hokuyoModel("UTM-30LX"), request, false);
  EXPECT_EQ(sent.ranges, utm);
  EXPECT_EQ(measure(&scan, hokuyoModel("UST-10LX"), request, false).ranges[1], 65533u);
  request.two_characters = true;
  EXPECT_EQ(measure(&scan, hokuyoModel("UTM-30LX"), request, false).ranges[6], 4095u);
  EXPECT_EQ(measure(nullptr, hokuyoModel("UTM-30LX"), request, false).ranges.size(), 8u);
}

TEST(HokuyoDevice, ClusterTakesTheSmallestDistanceAndLeavesCodesOut) {
  Scan scan;
  scan.angle_increment = 2.0 * M_PI / 1440;
  scan.ranges = {{2.0f, 1.0f, kInf, 3.0f, kInf, kInf, 4.0f}};
  scan.intensities = {{20.0f, 10.0f, 1.0f, 30.0f, 1.0f, 1.0f, 40.0f}};
  HokuyoRequest request;
  request.first = 540;
  request.last = 546;
  request.cluster = 2;
  request.intensity = true;
  HokuyoModel model = hokuyoModel("UTM-30LX");
  const SentScan sent = measure(&scan, model, request, false);
  EXPECT_EQ(sent.ranges, (std::vector<std::uint32_t>{1000, 3000, 1}));
  EXPECT_EQ(sent.intensities, (std::vector<std::uint32_t>{10, 30, 1}));
  model.intensity_scale = 1.5;
  EXPECT_EQ(measure(&scan, model, request, false).intensities, (std::vector<std::uint32_t>{15, 45, 2}));
  EXPECT_EQ(measure(&scan, model, request, true).ranges, (std::vector<std::uint32_t>{1000, 3000, 1, 4000}));
}

TEST(HokuyoDevice, CountFallsInTheEchoAndTheLaserGoesOff) {
  Emulation s;
  s.ask("MD0540054201005");
  const std::string stream = s.host.listen(kSecond);
  std::size_t at = 0;
  for (const char* echo : {"MD0540054201004\n99b\n", "MD0540054201003\n99b\n", "MD0540054201002\n99b\n",
                           "MD0540054201001\n99b\n", "MD0540054201000\n99b\n"}) {
    at = stream.find(echo, at);
    ASSERT_NE(at, std::string::npos) << echo;
  }
  EXPECT_EQ(countOf(stream, "99b"), 5u);
  EXPECT_FALSE(s.device.laserOn());
}

TEST(HokuyoDevice, StreamsAt40HzWithCount00AndUserText) {
  Emulation s;
  s.ask("MD0540054201000;hello");
  EXPECT_EQ(countOf(s.host.listen(10 * kSecond), "MD0540054201000;hello\n99b\n"), 400u);
  EXPECT_TRUE(s.device.laserOn());
  s.ask("MD0540054201300");
  EXPECT_EQ(countOf(s.host.listen(10 * kSecond), "\n99b\n"), 100u);
}

TEST(HokuyoDevice, StampIsTheCounterAtStep0) {
  HokuyoOptions options;
  options.drift_ppm = 100.0;
  options.start_ms = 1000;
  Emulation s(options);
  s.ask("MD0540054201000");
  s.host.listen(100 * kSecond);
  const auto scans = s.device.takeSentScans();
  ASSERT_GT(scans.size(), 3990u);
  for (const SentScan& scan : scans) {
    EXPECT_EQ(scan.start % (25 * kMillisecond), 0);
    const double shown = 1000.0 + scan.start * 1e-6 * (1.0 + 100e-6);
    EXPECT_EQ(scan.device_stamp, static_cast<std::int64_t>(std::floor(shown + 1e-6)));
  }
  EXPECT_EQ(scans.back().device_stamp - 1000 - scans.back().start / kMillisecond, 9);
}

TEST(HokuyoDevice, TransfersAScanAfterItsEnd) {
  Emulation s;
  s.ask("MD0000108001001");
  s.host.writes.clear();
  s.host.listen(kSecond);
  const auto scans = s.device.takeSentScans();
  ASSERT_EQ(scans.size(), 1u);
  EXPECT_GE(s.host.writes[0].time - scans[0].start, 18'750 * kMicrosecond);
  EXPECT_LT(s.host.writes[0].time - scans[0].start, 25'000 * kMicrosecond);
}

TEST(HokuyoDevice, CounterWraps) {
  HokuyoOptions options;
  options.start_ms = (1 << 24) - 500;
  Emulation s(options);
  s.ask("MD0540054201000");
  s.host.listen(kSecond);
  const auto scans = s.device.takeSentScans();
  EXPECT_GE(scans.front().device_stamp, (1 << 24) - 500);
  EXPECT_LT(scans.back().device_stamp, 500);
  for (std::size_t i = 1; i < scans.size(); ++i)
    EXPECT_EQ((scans[i].device_stamp - scans[i - 1].device_stamp) & 0xffffff, 25);
}

TEST(HokuyoDevice, LaserStates) {
  Emulation s;
  EXPECT_EQ(s.ask("GD0000000001"), "GD0000000001\n10Q\n\n");
  EXPECT_EQ(s.ask("BM"), "BM\n00P\n\n");
  EXPECT_EQ(s.ask("BM"), "BM\n02R\n\n");
  const std::string once = s.ask("GD0540054201", kSecond);
  EXPECT_EQ(once.find("GD0540054201\n00P\n"), 0u);
  EXPECT_NE(once.find("\n" + scipLine("0?X0O@001") + "\n"), std::string::npos);
  EXPECT_EQ(s.ask("GS0540054201", kSecond).size(),
            std::string("GS0540054201\n00P\nTTTTs\nDDEEFFs\n\n").size());
  EXPECT_NE(s.ask("GE0540054201", kSecond).find("0?X0LA0O@04\\001000T"), std::string::npos);
  EXPECT_EQ(s.askAll({"GD0540054201;a", "GD0540054201;a"}), "GD0540054201;a\n0Bb\n\n");
  EXPECT_EQ(s.ask("QT"), "QT\n00P\n\n");
  EXPECT_EQ(s.ask("", kSecond), "");
  EXPECT_EQ(s.ask("GD0540054201"), "GD0540054201\n10Q\n\n");
}

TEST(HokuyoDevice, TimeMode) {
  HokuyoOptions options;
  options.start_ms = 16000000;
  Emulation s(options);
  EXPECT_EQ(s.ask("TM1"), "TM1\n04T\n\n");
  EXPECT_EQ(s.ask("TM2"), "TM2\n03S\n\n");
  s.ask("BM");
  EXPECT_EQ(s.ask("TM0"), "TM0\n00P\n\n");
  EXPECT_FALSE(s.device.laserOn());
  EXPECT_EQ(s.ask("TM0"), "TM0\n02R\n\n");
  EXPECT_EQ(s.ask("TM1"), "TM1\n00P\n" + scipLine(scipEncode(16000005, 4)) + "\n");
  for (const char* refused : {"MD0000108001000", "QT", "VV", "RS", "BM"})
    EXPECT_EQ(s.ask(refused), refused + std::string("\n0Ee\n\n"));
  EXPECT_EQ(s.ask("TM2"), "TM2\n00P\n\n");
  EXPECT_EQ(s.ask("TM7"), "TM7\n01Q\n\n");
  s.ask("MD0540054201000", 0);
  EXPECT_EQ(s.ask("TM0", 0), "TM0\n10Q\n\n");

  Emulation newer{HokuyoOptions("UST-10LX")};
  EXPECT_EQ(newer.ask("TM1").substr(0, 8), "TM1\n00P\n");
  newer.ask("TM0");
  EXPECT_EQ(newer.ask("QT"), "QT\n10Q\n\n");
}

TEST(HokuyoDevice, ResetZeroesTheClock) {
  HokuyoOptions options;
  options.start_ms = 5000;
  Emulation s(options);
  s.ask("MD0540054201000", kSecond);
  s.host.send("RT\nTM0\n");
  EXPECT_EQ(s.device.counter(s.host.now()), 0u);
  EXPECT_TRUE(s.device.laserOn());
  s.host.listen(kSecond);
  for (const SentScan& scan : s.device.takeSentScans()) EXPECT_LT(scan.device_stamp, 7000);
  EXPECT_EQ(s.host.ask("RS\n", 0), "RS\n00P\n\n");
  EXPECT_EQ(s.device.counter(s.host.now()), 0u);
  EXPECT_FALSE(s.device.laserOn());
  EXPECT_EQ(s.host.listen(kSecond), "");
  EXPECT_EQ(s.device.counter(s.host.now()), 1000u);
}

TEST(HokuyoDevice, ErrorsOfRequests) {
  Emulation s;
  const std::vector<std::pair<std::string, std::string>> cases = {{"MDxxxx108001000", "01Q"},
                                                                  {"MD0000x08001000", "02R"},
                                                                  {"MD00001080x1000", "03S"},
                                                                  {"MD0000108101000", "04T"},
                                                                  {"MD0500049901000", "05U"},
                                                                  {"MD0000108001x00", "06V"},
                                                                  {"MD00001080010x0", "07W"},
                                                                  {"MD0000108001", "0Cc"},
                                                                  {"XX", "0Ee"},
                                                                  {"HD0000108001", "0Ee"},
                                                                  {"%ST", "0Ee"},
                                                                  {"AR00", "0Ee"},
                                                                  {"CR05", "04T"},
                                                                  {"HS1", "03S"},
                                                                  {"GD0000108101", "04T"},
                                                                  {"SS01920x", "01Q"},
                                                                  {"SS012345", "02R"},
                                                                  {"SS019200", "03S"},
                                                                  {"SS115200", "00P"},
                                                                  {"VV;0123456789abcdef", "0Gg"},
                                                                  {"VV\x01", "0Hh"},
                                                                  {"R", "0Ee"}};
  for (const auto& [request, status] : cases) EXPECT_EQ(s.ask(request), request + "\n" + status + "\n\n");
  EXPECT_EQ(s.ask("VV;0123456789abcde").substr(0, 22), "VV;0123456789abcde\n00P");
}

TEST(HokuyoDevice, ErrorsOfRequestsInScip22) {
  Emulation s{HokuyoOptions("UST-10LX")};
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"MD0000108001", "0Hh"}, {"MD00001080010000", "0Dd"},    {"VVx", "0Dd"},
      {"XX", "0Ee"},           {"HD0000108001", "0Ff"},        {"ND0000108001000", "0Ff"},
      {"SS115200", "0Ff"},     {"VV;0123456789abcdef", "0Gg"}, {"CR05", "04T"}};
  for (const auto& [request, status] : cases) EXPECT_EQ(s.ask(request), request + "\n" + status + "\n\n");
  EXPECT_NE(s.ask("PP").find("\nPROT:SCIP 2.2;"), std::string::npos);
  Emulation urg{HokuyoOptions("URG-04LX")};
  EXPECT_EQ(urg.ask("ME0044072501001"), "ME0044072501001\n0Ee\n\n");
  EXPECT_EQ(urg.ask("MD0000072501001"), "MD0000072501001\n04T\n\n");
  EXPECT_EQ(urg.askAll({"HS1", "HS1", "HS2"}), "HS1\n00P\n\nHS1\n02R\n\nHS2\n01Q\n\n");
  EXPECT_EQ(urg.askAll({"CR05", "CR05", "CR11", "CRx1"}),
            "CR05\n00P\n\nCR05\n03S\n\nCR11\n02R\n\nCRx1\n01Q\n\n");
}

TEST(HokuyoDevice, StatesAndSleepOfScip22) {
  Emulation s{HokuyoOptions("UTM-30LX-EW")};
  EXPECT_EQ(s.ask("%ST"), "%ST\n00P\n" + scipLine("000") + "\n");
  s.ask("BM");
  EXPECT_EQ(s.ask("%ST"), "%ST\n00P\n" + scipLine("003") + "\n");
  s.ask("MD0540054201000", 0);
  EXPECT_EQ(s.ask("%ST", 0), "%ST\n00P\n" + scipLine("004") + "\n");
  EXPECT_NE(s.ask("II", 0).find("MESM:004 Multi_scan;"), std::string::npos);
  EXPECT_EQ(s.ask("%SL"), "%SL\n00P\n\n");
  EXPECT_EQ(s.ask("%ST"), "%ST\n00P\n" + scipLine("005") + "\n");
  EXPECT_EQ(s.ask("MD0540054201000"), "MD0540054201000\n10Q\n\n");
  EXPECT_EQ(s.askAll({"QT", "%ST"}), "QT\n00P\n\n%ST\n00P\n" + scipLine("000") + "\n");
}

TEST(HokuyoDevice, SimulatedMalfunction) {
  Emulation s;
  EXPECT_EQ(s.askAll({"DB10", "DB03", "DB03", "DB06", "BM"}),
            "DB10\n03S\n\nDB03\n00P\n\nDB03\n02R\n\nDB06\n01Q\n\nBM\n01Q\n\n");
  EXPECT_NE(s.ask("II").find("STAT:Trouble!! Error No. =[00->"), std::string::npos);
  EXPECT_EQ(s.ask("MD0540054201000"), "MD0540054201000\n" + scipLine("53") + "\n");
  EXPECT_EQ(s.askAll({"DB10", "BM"}), "DB10\n00P\n\nBM\n00P\n\n");
}

TEST(HokuyoDevice, QuitFinishesTheScanOrCutsItAtARow) {
  for (const bool cuts : {false, true}) {
    HokuyoOptions options;
    options.quit_cuts_scan = cuts;
    options.line.packet_size = 64;
    options.line.packet_gap = 100 * kMicrosecond;
    Emulation s(options);
    s.ask("MD0000108001000", 20 * kMillisecond);
    const std::string rest = s.ask("QT", kSecond);
    ASSERT_GT(rest.size(), 10u);
    EXPECT_EQ(rest.substr(rest.size() - 8), "QT\n00P\n\n");
    EXPECT_EQ(rest[rest.size() - 9], '\n');
    EXPECT_EQ(s.device.takeSentScans().size(), cuts ? 0u : 1u);
    EXPECT_EQ(rest.size() < 200, cuts) << rest.size();
  }
}

TEST(HokuyoDevice, RestartsOnTheSecondRb) {
  HokuyoOptions options("UST-10LX");
  options.boot_delay = 3 * kSecond;
  options.start_ms = 100000;
  Emulation s(options);
  EXPECT_EQ(s.ask("RB", 2 * kSecond), "RB\n01Q\n\n");
  EXPECT_EQ(s.ask("RB", kSecond / 2), "RB\n01Q\n\n");
  EXPECT_EQ(s.ask("RB", kSecond / 2), "RB\n00P\n\n");
  EXPECT_EQ(s.host.disconnects, 0);
  s.host.listen(kSecond);
  EXPECT_EQ(s.host.disconnects, 1);
  s.host.listen(kSecond);
  ASSERT_TRUE(s.device.linkUp());
  s.device.connect(s.host.now());
  EXPECT_EQ(s.ask("VV", kSecond), "");
  s.host.listen(2 * kSecond);
  EXPECT_EQ(s.ask("QT"), "QT\n00P\n\n");
  EXPECT_LT(s.device.counter(s.host.now()), 6000u);
}

TEST(HokuyoDevice, LinesEndedByCrAndPiecesOfLines) {
  Emulation s;
  s.host.send("Q");
  s.host.send("T\r\n\nBM\r");
  EXPECT_EQ(s.host.listen(0), "QT\n00P\n\nBM\n00P\n\n");
  EXPECT_EQ(s.ask(std::string(5000, 'x')).substr(256), "\n0Ee\n\n");
}

TEST(HokuyoDevice, StreamOutlivesTheHostUnlessAskedOtherwise) {
  for (const bool stop : {false, true}) {
    HokuyoOptions options;
    options.stop_on_close = stop;
    Emulation s(options);
    s.ask("MD0540054201000", kSecond);
    s.device.disconnect(s.host.now());
    EXPECT_EQ(s.host.listen(kSecond), "");
    s.device.connect(s.host.now());
    EXPECT_EQ(s.host.listen(kSecond).empty(), stop);
  }
}

TEST(HokuyoDevice, StreamsFromTheStart) {
  HokuyoOptions options;
  options.streaming = true;
  options.faults.rate(Fault::kHalfMessage) = 1.0;
  Emulation s(options);
  const std::string stream = s.host.listen(kSecond);
  EXPECT_NE(stream.find("MD"), 0u);
  EXPECT_EQ(countOf(stream, "\nMD0000108001000\n99b\n"), 40u);
}

TEST(HokuyoDevice, PacedAndSkippingOnASerialLine) {
  HokuyoOptions options("URG-04LX");
  options.line.baud_rate = 19200;
  Emulation s(options);
  s.device.setHostBaudRate(19200);
  s.ask("MD0044072501000");
  const std::string stream = s.host.listen(100 * kSecond);
  EXPECT_NEAR(static_cast<double>(stream.size()), 100 * 1920, 100 * 1920 * 0.15);
  EXPECT_LE(stream.size(), 100 * 1920u + 20);
  EXPECT_GT(s.device.counts().skipped, 800u);

  s.ask("QT", 5 * kSecond);
  EXPECT_EQ(s.ask("SS115200", kSecond), "SS115200\n00P\n\n");
  EXPECT_EQ(s.host.baud_rates, std::vector<int>{115200});
  EXPECT_EQ(s.ask("VV", kSecond), "");
  s.device.setHostBaudRate(115200);
  EXPECT_EQ(s.ask("QT", kSecond), "QT\n00P\n\n");
}

}  // namespace
}  // namespace device_emulators
