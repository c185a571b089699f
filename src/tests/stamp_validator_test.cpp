#include "live/stamp_validator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "io/frame_directory.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using Verdict = StampValidator::Verdict;

constexpr TimeNs kSecondNs = 1'000'000'000;
constexpr TimeNs kHourNs = 3600 * kSecondNs;

// Sensors of 10 Hz, as a source gives their frames.
class Stream {
 public:
  explicit Stream(std::uint32_t sensors, bool is_live = false)
      : validator_(LiveConfig()), is_live_(is_live) {
    for (std::uint32_t i = 0; i < sensors; ++i) validator_.AddSensor();
  }

  // `after_ns` from the frame before, by this computer's clocks.
  Verdict Add(std::uint32_t sensor, TimeNs time_ns, TimeNs after_ns = 0) {
    host_ns_ += after_ns;
    std::optional<Arrival> arrival;
    if (is_live_) arrival = Arrival{kBeginNs + host_ns_, host_ns_};
    const Verdict verdict = validator_.Judge({sensor, time_ns, arrival});
    if (verdict == Verdict::kRestart) validator_.Begin();
    if (verdict == Verdict::kTaken || verdict == Verdict::kRestart) validator_.Take(time_ns);
    return verdict;
  }

  // Of how many of the next frames of some sensors in turn this was the verdict, at real time.
  int Count(Verdict verdict, int frames, const std::vector<TimeNs>& begins_ns) {
    int count = 0;
    const auto sensors = static_cast<TimeNs>(begins_ns.size());
    for (int k = 0; k < frames; ++k) {
      for (std::uint32_t i = 0; i < begins_ns.size(); ++i) {
        count += Add(i, begins_ns[i] + k * kPeriodNs, kPeriodNs / sensors) == verdict ? 1 : 0;
      }
    }
    return count;
  }

  StampValidator& validator() { return validator_; }

 private:
  StampValidator validator_;
  bool is_live_;
  TimeNs host_ns_ = 0;
};

TEST(StampValidator, TakesSensorsThatAreBehindEachOtherByLessThanMayBe) {
  Stream stream(3);
  EXPECT_EQ(stream.Count(Verdict::kTaken, 50, {kBeginNs, kBeginNs + 90'000'000, kBeginNs}), 150);
}

TEST(StampValidator, OneStampAheadBindsNobodyHoweverFarItIs) {
  for (const TimeNs ahead_ns :
       {3 * kSecondNs, 10 * kSecondNs, 59 * kSecondNs, kHourNs, kMaxStampNs - kBeginNs}) {
    for (const std::uint32_t sensors : {1U, 2U, 3U}) {
      for (const bool is_live : {false, true}) {
        Stream stream(sensors, is_live);
        const std::vector<TimeNs> begins_ns(sensors, kBeginNs);
        stream.Count(Verdict::kTaken, 50, begins_ns);
        EXPECT_EQ(stream.Add(sensors - 1, kBeginNs + 50 * kPeriodNs + ahead_ns),
                  Verdict::kUnconfirmed);
        const std::vector<TimeNs> later_ns(sensors, kBeginNs + 50 * kPeriodNs);
        EXPECT_EQ(stream.Count(Verdict::kTaken, 50, later_ns), 50 * static_cast<int>(sensors));
      }
    }
  }
}

TEST(StampValidator, ABurstOfASensorThatNobodyKnowsBindsNobody) {
  for (const bool is_live : {false, true}) {
    Stream stream(3, is_live);
    stream.Count(Verdict::kTaken, 50, {kBeginNs, kBeginNs});
    const int burst = is_live ? 500 : 20;  // without a clock more would be a silence of the others
    for (int k = 0; k < burst; ++k) {
      EXPECT_EQ(stream.Add(2, kBeginNs + 500'000 * kHourNs + k * kPeriodNs), Verdict::kUnconfirmed);
    }
    const TimeNs later_ns = kBeginNs + 50 * kPeriodNs;
    EXPECT_EQ(stream.Count(Verdict::kTaken, 50, {later_ns, later_ns}), 100);
  }
}

TEST(StampValidator, AClockThatIsApartIsItsOwnAffair) {
  for (const TimeNs by_ns : {-2 * kHourNs, -20 * kSecondNs, 20 * kSecondNs, 2 * kHourNs}) {
    Stream stream(2);
    EXPECT_EQ(stream.Count(Verdict::kTaken, 300, {kBeginNs, kBeginNs + by_ns}), 300);
  }
}

TEST(StampValidator, AClockLessThanASecondAheadMakesNothingLate) {
  Stream stream(2);
  EXPECT_EQ(stream.Count(Verdict::kLate, 300, {kBeginNs, kBeginNs + 9 * kSecondNs / 10}), 0);
}

TEST(StampValidator, TheClockOfASensorAloneIsThatOfNowOnceEightFramesAgree) {
  for (const TimeNs by_ns : {-kHourNs, -6 * kSecondNs, 10 * kSecondNs, kHourNs}) {
    Stream stream(1);
    stream.Count(Verdict::kTaken, 50, {kBeginNs});
    const TimeNs set_ns = kBeginNs + 50 * kPeriodNs + by_ns;
    EXPECT_EQ(stream.Count(Verdict::kUnconfirmed, StampValidator::kFramesToConfirm - 1, {set_ns}),
              StampValidator::kFramesToConfirm - 1);
    const TimeNs next_ns = set_ns + (StampValidator::kFramesToConfirm - 1) * kPeriodNs;
    const bool is_related = by_ns == 10 * kSecondNs;  // within live.window_s
    EXPECT_EQ(stream.Add(0, next_ns), is_related ? Verdict::kTaken : Verdict::kRestart);
    EXPECT_TRUE(stream.validator().IsConfirmed(0, next_ns));
    EXPECT_EQ(stream.Count(Verdict::kTaken, 50, {next_ns + kPeriodNs}), 50);
  }
}

TEST(StampValidator, AClockThatGoesBackALittleCatchesUp) {
  Stream stream(1);
  stream.Count(Verdict::kTaken, 50, {kBeginNs});
  const TimeNs set_ns = kBeginNs + 50 * kPeriodNs - 3 * kSecondNs;
  EXPECT_EQ(stream.Count(Verdict::kLate, 27, {set_ns}), 27);
  EXPECT_EQ(stream.Count(Verdict::kTaken, 50, {set_ns + 30 * kPeriodNs}), 50);
}

TEST(StampValidator, WhereMostClocksAreSetTheyAreTheTime) {
  Stream stream(3);
  stream.Count(Verdict::kTaken, 50, {kBeginNs, kBeginNs, kBeginNs});
  const TimeNs later_ns = kBeginNs + 50 * kPeriodNs;
  EXPECT_EQ(stream.Count(Verdict::kRestart, 50, {later_ns, later_ns + kHourNs, later_ns + kHourNs}),
            1);
  EXPECT_GT(stream.validator().newest_ns(), kBeginNs + kHourNs);
}

TEST(StampValidator, ASensorThatIsHeardNoMoreHoldsBackNobody) {
  Stream glitched_first(2);
  glitched_first.Add(1, kMaxStampNs);
  EXPECT_EQ(glitched_first.Count(Verdict::kRestart, 50, {kBeginNs}), 1);
  Stream died(2);
  died.Count(Verdict::kTaken, 50, {kBeginNs, kBeginNs});
  EXPECT_EQ(died.Count(Verdict::kTaken, 100, {kBeginNs + 50 * kPeriodNs}), 100);
  Stream died_as_the_clock_was_set(2);
  died_as_the_clock_was_set.Count(Verdict::kTaken, 50, {kBeginNs, kBeginNs});
  EXPECT_EQ(died_as_the_clock_was_set.Count(Verdict::kRestart, 100, {kBeginNs + kHourNs}), 1);
}

TEST(StampValidator, ClocksThatAlternateGiveTheFramesOfTheFirst) {
  Stream stream(1);
  int taken = 0;
  for (int k = 0; k < 200; ++k) {
    const TimeNs by_ns = k % 2 == 0 ? 0 : kHourNs;
    taken += stream.Add(0, kBeginNs + k * kPeriodNs + by_ns) == Verdict::kTaken ? 1 : 0;
  }
  EXPECT_EQ(taken, 100);
}

TEST(StampValidator, ThisComputersClockDecidesBetweenTwoAndIsNotOverruledByAny) {
  // The wrong one came first.
  Stream tied(2, true);
  EXPECT_EQ(tied.Count(Verdict::kTaken, 100, {kBeginNs - 2 * kHourNs, kBeginNs}), 100);
  // Many that agree with each other.
  Stream flooded(60, true);
  std::vector<TimeNs> begins_ns(60, kBeginNs + kHourNs);
  begins_ns.front() = kBeginNs;
  EXPECT_EQ(flooded.Count(Verdict::kTaken, 50, begins_ns), 50);
}

TEST(StampValidator, OfTwoClocksByThisComputersTheNearerOneWinsWhicheverCameFirst) {
  for (const TimeNs by_ns : {-50 * kSecondNs, -8 * kSecondNs, 8 * kSecondNs, 50 * kSecondNs}) {
    for (const std::size_t true_ones : {1U, 2U}) {
      Stream stream(static_cast<std::uint32_t>(2 * true_ones), true);
      std::vector<TimeNs> begins_ns(2 * true_ones, kBeginNs);
      std::fill_n(begins_ns.begin(), true_ones, kBeginNs + by_ns);
      const int frames = 30;
      const int taken = static_cast<int>(true_ones) * frames;
      stream.Count(Verdict::kTaken, frames, begins_ns);
      for (TimeNs& begin_ns : begins_ns) begin_ns += frames * kPeriodNs;
      EXPECT_EQ(stream.Count(Verdict::kTaken, frames, begins_ns), taken) << by_ns;
      const TimeNs now_ns = kBeginNs + 2 * frames * kPeriodNs;
      EXPECT_NEAR(static_cast<double>(stream.validator().newest_ns()), static_cast<double>(now_ns),
                  1e9);
    }
  }
}

TEST(StampValidator, TwoClocksOnBothSidesOfThisComputersDoNotTakeTurns) {
  Stream stream(2, true);
  EXPECT_EQ(
      stream.Count(Verdict::kRestart, 200, {kBeginNs + 3 * kSecondNs, kBeginNs - 3 * kSecondNs}),
      0);
}

TEST(StampValidator, ALiveSourceThatIsPlayedFromLongAgoIsBelieved) {
  Stream played(2, true);
  const TimeNs begin_ns = kBeginNs - 20'000 * kHourNs;
  EXPECT_GE(played.Count(Verdict::kTaken, 50, {begin_ns, begin_ns}), 100 - 8);
  // As fast as may be, and with a pause.
  int taken = 0;
  for (int k = 0; k < 50; ++k) {
    taken += played.Add(0, begin_ns + 20 * kSecondNs + k * kPeriodNs) == Verdict::kTaken ? 1 : 0;
    taken += played.Add(1, begin_ns + 20 * kSecondNs + k * kPeriodNs) == Verdict::kTaken ? 1 : 0;
  }
  EXPECT_GE(taken, 100 - 8);
}

TEST(StampValidator, AFewPacketsWithoutAnyLidarBeginNothing) {
  Stream stream(1, true);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(stream.Add(0, kMaxStampNs - kHourNs + k * kPeriodNs, kPeriodNs),
              Verdict::kUnconfirmed);
  }
  EXPECT_FALSE(stream.validator().has_begun());
}

TEST(StampValidator, PacketsInTheNameOfALidarDoNotSetItsClock) {
  Stream stream(1, true);
  stream.Count(Verdict::kTaken, 50, {kBeginNs});
  for (int k = 0; k < 50; ++k) {
    EXPECT_EQ(stream.Add(0, kBeginNs + 9'000 * kHourNs + k * kPeriodNs), Verdict::kUnconfirmed);
  }
  EXPECT_EQ(stream.Count(Verdict::kTaken, 50, {kBeginNs + 50 * kPeriodNs}), 50);
}

TEST(StampValidator, ASensorOfFewFramesIsBelievedOnceItsRateIsKnown) {
  for (const bool is_live : {false, true}) {
    Stream stream(1, is_live);
    int taken = 0;
    for (int k = 0; k < 40; ++k) {
      const Verdict verdict = stream.Add(0, kBeginNs + k * 10 * kSecondNs, 10 * kSecondNs);
      taken += verdict == Verdict::kTaken ? 1 : 0;
    }
    EXPECT_GT(taken, 40 - 2 * StampValidator::kFramesToConfirm);
  }
}

TEST(StampValidator, StampsAtTheEndsOfAllTimeAreCompared) {
  Stream stream(2);
  for (int k = 0; k < 400; ++k) {
    const TimeNs end_ns = k % 3 == 0 ? -kMaxStampNs : kMaxStampNs;
    stream.Add(static_cast<std::uint32_t>(k % 2), k % 5 == 0 ? 0 : end_ns);
  }
  Stream ascending(1, true);  // by steps that are no period
  for (TimeNs time_ns = -kMaxStampNs; time_ns <= kMaxStampNs; time_ns += kMaxStampNs / 4) {
    ascending.Add(0, time_ns, kPeriodNs);
    EXPECT_TRUE(!ascending.validator().IsOutOfSync(0) ||
                ascending.validator().IsPending(0, time_ns));
  }
  Stream burst(3, true);  // in which much time passes
  burst.Add(0, kMaxStampNs);
  for (int k = 0; k <= 32; ++k) burst.Add(1, -kMaxStampNs + k * (kMaxStampNs / 16));
  for (int k = 0; k < 20; ++k) burst.Add(2, -kMaxStampNs + k);
  SUCCEED();  // what overflows ends the test where it is sanitized
}

}  // namespace
}  // namespace unlidar
