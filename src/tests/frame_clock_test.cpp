#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/frame_directory.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kMs = 1'000'000;
constexpr TimeNs kSecond = 1'000 * kMs;

using Names = std::vector<std::string_view>;
using Times = std::vector<std::optional<TimeNs>>;

// The times of the frames of a folder.
Times TimesOf(const Names& names, double rate_hz = 0.0, std::string* warning = nullptr) {
  FrameClock clock("folder", rate_hz);
  clock.Settle(names);
  Times times;
  for (const std::string_view name : names) times.push_back(clock.TimeOf(name));
  if (warning != nullptr) *warning = clock.warning() ? clock.warning()->text : "";
  return times;
}

// The same of frames that come one by one.
Times TimesOfStream(const Names& names, double rate_hz = 0.0) {
  FrameClock clock("stream", rate_hz);
  Times times;
  for (const std::string_view name : names) times.push_back(clock.TimeOf(name));
  return times;
}

TEST(FrameClock, ConsecutiveWholeNumbersAreFramesOfTenASecondAndItSaysSo) {
  std::string warning;
  EXPECT_EQ(TimesOf({"000000", "000001", "000002"}, 0.0, &warning),
            (Times{0, 100 * kMs, 200 * kMs}));
  EXPECT_NE(warning.find("10 frames a second"), std::string::npos) << warning;
  EXPECT_NE(warning.find("input.frame_rate_hz"), std::string::npos) << warning;
}

TEST(FrameClock, AGivenRateIsTakenAndNothingIsSaid) {
  std::string warning;
  EXPECT_EQ(TimesOf({"0", "1", "2"}, 20.0, &warning), (Times{0, 50 * kMs, 100 * kMs}));
  EXPECT_EQ(warning, "");
}

TEST(FrameClock, AMissingNumberIsTimeThatPasses) {
  EXPECT_EQ(TimesOf({"500", "501", "517", "518"}),
            (Times{50 * kSecond, 50 * kSecond + 100 * kMs, 51 * kSecond + 700 * kMs,
                   51 * kSecond + 800 * kMs}));
}

TEST(FrameClock, NumbersFarApartAreTimesOfTheUnitThatMakesThemFramesOfALidar) {
  const std::vector<std::pair<Names, TimeNs>> units = {
      {{"0", "100", "200"}, kMs},
      {{"000000", "000050", "000100"}, kMs},
      {{"0", "100000", "200000"}, 1'000},
      {{"0", "100000000", "200000000"}, 1},
      {{"5000000", "5000100", "5000200"}, kMs},          // since switched on
      {{"900000000", "900100000", "900200000"}, 1'000},  // as seconds they would lie a day apart
  };
  for (const auto& [names, unit_ns] : units) {
    std::string warning;
    const Times times = TimesOf(names, 0.0, &warning);
    for (std::size_t i = 0; i < names.size(); ++i) {
      EXPECT_EQ(times[i], std::stoll(std::string(names[i])) * unit_ns) << names[i];
    }
    EXPECT_NE(warning, "") << names[1];
  }
}

TEST(FrameClock, NumbersThatAreNeitherAreRefusedUnlessTheRateIsGiven) {
  EXPECT_THROW(TimesOf({"0", "5000", "10000"}), InputError);
  EXPECT_EQ(TimesOf({"0", "5000", "10000"}, 5e4), (Times{0, 100 * kMs, 200 * kMs}));
}

TEST(FrameClock, StampsAreReadAsEverWhateverTheRate) {
  const TimeNs unix_ns = 1'706'255'621 * kSecond;
  for (const double rate_hz : {0.0, 20.0}) {
    std::string warning;
    EXPECT_EQ(TimesOf({"1706255621", "1706255622"}, rate_hz, &warning),
              (Times{unix_ns, unix_ns + kSecond}));
    EXPECT_EQ(TimesOf({"1706255621614", "1706255621714"}, rate_hz, &warning),
              (Times{unix_ns + 614 * kMs, unix_ns + 714 * kMs}));
    EXPECT_EQ(TimesOf({"0.000000", "0.100000", "1"}, rate_hz, &warning),
              (Times{0, 100 * kMs, kSecond}));
    EXPECT_EQ(TimesOf({"0", "1e0", "2"}, rate_hz, &warning), (Times{0, kSecond, 2 * kSecond}));
    EXPECT_EQ(TimesOf({"0.5", "1.5"}, rate_hz, &warning), (Times{kSecond / 2, 3 * kSecond / 2}));
    EXPECT_EQ(warning, "");
  }
}

TEST(FrameClock, ARateThatIsGivenForStampsIsNotPassedOverInSilence) {
  for (const Names& names : {Names{"100000000", "100000001"}, Names{"0", "1", "2.5"}}) {
    std::string warning;
    EXPECT_EQ(TimesOf(names, 20.0, &warning), TimesOf(names));
    EXPECT_NE(warning.find("frame_rate_hz is given, but names are stamps"), std::string::npos);
    EXPECT_LT(warning.size(), 200U);
  }
  FrameClock stream("stream", 20.0);
  EXPECT_EQ(stream.TimeOf("1706255621"), 1'706'255'621 * kSecond);
  EXPECT_TRUE(stream.warning());
}

TEST(FrameClock, OneNumberOfAFolderSettlesNothingForEver) {
  for (const Names& names : {Names{"0", "100", "200"}, Names{"0", "1", "2"}, Names{"0", "0.1"}}) {
    FrameClock clock("folder", 0.0);
    clock.Settle({names.front()});
    Times times;
    for (const std::string_view name : names) times.push_back(clock.TimeOf(name));
    EXPECT_EQ(times, TimesOf(names)) << names[1];
  }
  FrameClock one("folder", 0.0);
  one.Settle({"7"});
  EXPECT_EQ(one.TimeOf("7"), 700 * kMs);
  EXPECT_TRUE(one.warning());
  EXPECT_THROW(one.TimeOf("107"), InputError);  // no frames of 10 a second
}

TEST(FrameClock, TextsThatAreNoStampHaveNoTime) {
  EXPECT_EQ(TimesOf({"frame_000001", "3"}), (Times{std::nullopt, 300 * kMs}));
}

TEST(FrameClock, FramesOfAStreamAreReadAsThoseOfAFolder) {
  for (const Names& names :
       {Names{"0", "1", "2"}, Names{"7", "8", "12"}, Names{"0", "100", "200"}, Names{"0", "0.1"},
        Names{"1706255621", "1706255622"}, Names{"0.5", "1", "1.5"}}) {
    EXPECT_EQ(TimesOfStream(names), TimesOf(names)) << names[1];
    EXPECT_EQ(TimesOfStream(names, 20.0), TimesOf(names, 20.0)) << names[1];
  }
}

TEST(FrameClock, AStreamWhoseSecondNumberIsFarOffIsRefusedUnlessTheRateIsGiven) {
  EXPECT_THROW(TimesOfStream({"500", "600"}), InputError);
  EXPECT_EQ(TimesOfStream({"500", "600"}, 1e3), (Times{500 * kMs, 600 * kMs}));
  EXPECT_THROW(TimesOfStream({"1", "1.5"}), InputError);
}

}  // namespace
}  // namespace unlidar
