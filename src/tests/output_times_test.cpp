#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "io/stamp.hpp"
#include "tests/synthetic_recording.hpp"
#include "tests/temporary_folder.hpp"
#include "trajectory/sampling.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::TemporaryFolder;

constexpr TimeNs kSecond = 1'000'000'000;

std::vector<TimeNs> FromText(const std::string& text) {
  const TemporaryFolder folder;
  return ReadStampList(folder.Write("at", text));
}

// The line number and reason without the path.
std::string ReasonOf(const std::string& text) {
  const TemporaryFolder folder;
  const std::string path = folder.Write("at", text);
  try {
    ReadStampList(path);
  } catch (const InputError& error) {
    const std::string reason = error.what();
    EXPECT_EQ(reason.find(path), 0U) << reason;
    return reason.substr(path.size());
  }
  ADD_FAILURE() << "no error for " << text;
  return "";
}

Recording RecordingOf(TimeNs begin_ns, TimeNs end_ns) {
  Recording recording;
  recording.sensors.resize(2);
  FrameInfo frame;
  frame.begin_ns = frame.stamp_ns = begin_ns;
  frame.end_ns = begin_ns;
  recording.frames.push_back(frame);
  frame.sensor = 1;
  frame.begin_ns = frame.stamp_ns = frame.end_ns = end_ns;
  recording.frames.push_back(frame);
  return recording;
}

TEST(StampList, ReadsOneStampALineExactly) {
  EXPECT_EQ(FromText("1706255621.600227001\n1706255622\r\n\n# note\n 1706255623.5 "),
            (std::vector<TimeNs>{1706255621600227001, 1706255622 * kSecond,
                                 17062556235 * (kSecond / 10)}));
}

TEST(StampList, ReadsTheTimestampColumnOfACsv) {
  EXPECT_EQ(FromText("\xEF\xBB\xBFx, timestamp ,y\r\n1, 2.5 ,hello\n2,3,\n"),
            (std::vector<TimeNs>{2 * kSecond + kSecond / 2, 3 * kSecond}));
  EXPECT_EQ(FromText("timestamp\n1\n"), std::vector<TimeNs>{kSecond});
}

TEST(StampList, IsSortedAndHoldsEachStampOnce) {
  EXPECT_EQ(FromText("3\n1\n3.0\n2\n"), (std::vector<TimeNs>{kSecond, 2 * kSecond, 3 * kSecond}));
}

TEST(StampList, RefusesWhatIsNoStampByLineAndValue) {
  EXPECT_EQ(ReasonOf("1\nsoon\n"),
            ":2: 'soon' is no stamp, expected seconds such as 1706255621.614239");
  EXPECT_EQ(ReasonOf("time,x\n1,2\n").find(":1: 'time,x' is no stamp"), 0U);
  EXPECT_EQ(ReasonOf("1,2\n").find(":1: '1,2' is no stamp"), 0U);
  EXPECT_EQ(ReasonOf("x,timestamp\n1,2\n3\n").find(":3: '' is no stamp"), 0U);
  EXPECT_EQ(ReasonOf("timestamp\nnan\n").find(":2: 'nan' is no stamp"), 0U);
  EXPECT_EQ(ReasonOf("timestamp\n"), ": no stamp in it, expected one a line");
  EXPECT_EQ(ReasonOf("# timestamp\n\n"), ": no stamp in it, expected one a line");
  EXPECT_EQ(ReasonOf(""), ": no stamp in it, expected one a line");
  EXPECT_THROW(ReadStampList("/nowhere/at"), InputError);
  EXPECT_THROW(ReadStampList("/tmp"), InputError);
}

TEST(ParseRate, IsExactAndRefusesWhatIsNoRate) {
  EXPECT_EQ(ParseRate("29.97").nanohertz, 29'970'000'000);
  EXPECT_EQ(ParseRate("10").nanohertz, 10 * kSecond);
  EXPECT_EQ(ParseRate("1e6").nanohertz, 1'000'000 * kSecond);
  for (const char* text :
       {"", "0", "-1", "nan", "inf", "fast", "1000001", "1e-10", "10Hz", "1e99"}) {
    EXPECT_THROW(ParseRate(text), UsageError) << text;
  }
}

std::vector<TimeNs> Resolved(const OutputTimes& times, const Recording& recording) {
  const OutputInstants instants = ResolveOutputTimes(times, recording);
  std::vector<TimeNs> times_ns;
  for (std::size_t k = 0; k < instants.size(); ++k) times_ns.push_back(instants[k]);
  return times_ns;
}

TEST(OutputTimes, AreTheStampsOfTheFirstSensorOnly) {
  EXPECT_EQ(Resolved(FirstSensorStamps{}, RecordingOf(5, 9)), std::vector<TimeNs>{5});
}

TEST(OutputTimes, OfAListAreTheList) {
  const std::vector<TimeNs> list = {1, 2};
  EXPECT_EQ(Resolved(list, RecordingOf(5, 9)), list);
}

TEST(OutputTimes, OfARateRunFromTheFirstBeginToTheLastEnd) {
  EXPECT_EQ(Resolved(ParseRate("4"), RecordingOf(7, 7 + kSecond / 2)),
            (std::vector<TimeNs>{7, 7 + kSecond / 4, 7 + kSecond / 2}));
  EXPECT_EQ(Resolved(ParseRate("4"), RecordingOf(7, 7 + kSecond / 2 - 1)).size(), 2U);
  EXPECT_TRUE(Resolved(ParseRate("4"), Recording()).empty());
}

TEST(OutputTimes, OfARateDoNotDrift) {
  // 29.97 Hz has no whole period: instant 2997 k is nevertheless 100 k seconds after the first.
  const auto times_ns = Resolved(ParseRate("29.97"), RecordingOf(11, 11 + 3'600 * kSecond));
  ASSERT_EQ(times_ns.size(), 2997U * 36 + 1);
  for (std::size_t k = 0; k <= 36; ++k) {
    EXPECT_EQ(times_ns[2997 * k], 11 + static_cast<TimeNs>(100 * k) * kSecond);
  }
  for (std::size_t k = 1; k < times_ns.size(); ++k) {
    const TimeNs step_ns = times_ns[k] - times_ns[k - 1];
    ASSERT_TRUE(step_ns == 33'366'700 || step_ns == 33'366'699 + 1 + 1 || step_ns == 33'366'699 + 1)
        << step_ns;
  }
}

TEST(OutputTimes, OfARateOverAbsurdStampsEndOrAreRefused) {
  const Recording all_time =
      RecordingOf(std::numeric_limits<TimeNs>::min(), std::numeric_limits<TimeNs>::max());
  EXPECT_THROW(Resolved(ParseRate("10"), all_time), UsageError);
  const auto times_ns = Resolved(ParseRate("1e-9"), all_time);
  ASSERT_EQ(times_ns.size(), 19U);
  EXPECT_EQ(times_ns[1], times_ns[0] + kSecond * kSecond);
}

// The definition, in numbers of any length: 1e18 ns / nanohertz by long division.
TEST(OutputTimes, OfARateAreExactForEveryInstant) {
  testing::Random random(3);
  for (int trial = 0; trial < 300; ++trial) {
    const auto nanohertz = static_cast<std::int64_t>(std::exp(random.Uniform(0.0, std::log(1e15))));
    const double most_s = std::min(9e9, 9.9e6 / (static_cast<double>(nanohertz) * 1e-9));
    const auto begin_ns = static_cast<TimeNs>(random.Uniform(-4e18, 4e18));
    const TimeNs end_ns =
        begin_ns + static_cast<TimeNs>(random.Uniform(0.0, 1.0) * most_s * 1e9 / 2);
    const OutputInstants instants(Rate{nanohertz}, begin_ns, end_ns);
    const auto floor_of = [&](std::uint64_t k) {  // k * 1e18 / nanohertz, digit by digit
      std::uint64_t quotient = k / static_cast<std::uint64_t>(nanohertz);
      std::uint64_t rest = k % static_cast<std::uint64_t>(nanohertz);
      for (int digit = 0; digit < 18; ++digit) {
        rest *= 10;
        quotient = quotient * 10 + rest / static_cast<std::uint64_t>(nanohertz);
        rest %= static_cast<std::uint64_t>(nanohertz);
      }
      return static_cast<TimeNs>(quotient);
    };
    const std::size_t size = instants.size();
    ASSERT_GT(size, 0U);
    EXPECT_EQ(instants[0], begin_ns);
    for (int i = 0; i < 20; ++i) {
      const std::size_t k = random.Index(size);
      EXPECT_EQ(instants[k], begin_ns + floor_of(k)) << nanohertz << " " << k;
      EXPECT_EQ(instants.CountBefore(instants[k]), k);
      EXPECT_EQ(instants.CountBefore(instants[k] + 1), k + 1);
    }
    EXPECT_LE(instants[size - 1], end_ns);
    EXPECT_GT(floor_of(size), end_ns - begin_ns) << nanohertz;
  }
}

TEST(OutputTimes, OfAListKnowHowManyComeBeforeATime) {
  const OutputInstants instants(std::vector<TimeNs>{-5, 0, 7});
  EXPECT_EQ(instants.CountBefore(-6), 0U);
  EXPECT_EQ(instants.CountBefore(-5), 0U);
  EXPECT_EQ(instants.CountBefore(1), 2U);
  EXPECT_EQ(instants.CountBefore(8), 3U);
  EXPECT_EQ(OutputInstants().CountBefore(8), 0U);
}

}  // namespace
}  // namespace unlidar
