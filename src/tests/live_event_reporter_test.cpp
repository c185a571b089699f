#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "app/live_intake.hpp"
#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

using testing::TemporaryFolder;

// A reporter, and what it has fixture.
class ReporterFixture {
 public:
  ReporterFixture()
      : note_([this](const std::string& text) { notes_.push_back(text); }),
        output_(folder_ / "out.csv", folder_ / "events", {0, 0}, signals_, note_),
        reporter(output_, service_, note_) {
    reporter.AddSensor("roof");
    reporter.AddSensor("mast");
  }

  const std::vector<std::string>& notes() const { return notes_; }

  // Events that hold a text.
  std::size_t NumEvents(const std::string& text) {
    reporter.Flush();
    std::ifstream file(folder_ / "events");
    std::size_t count = 0;
    for (std::string line; std::getline(file, line);) {
      count += line.find(text) != std::string::npos ? 1U : 0U;
    }
    return count;
  }

 private:
  TemporaryFolder folder_;
  std::vector<std::string> notes_;
  std::function<void(const std::string&)> note_;
  Signals signals_;
  ServiceNotifier service_;
  LiveOutput output_;

 public:
  LiveEventReporter reporter;
};

TEST(LiveEventReporter, TellsOfAClockWithTheStateOfItsSensor) {
  ReporterFixture fixture;
  constexpr auto kOk = SensorState::kOk;
  fixture.reporter.ReportClock(0, SyncState::kSynchronised, 1);
  EXPECT_EQ(fixture.NumEvents("sensor"), 0U);  // it has no frame yet
  fixture.reporter.ReportSensor(0, kOk, 1);
  EXPECT_EQ(fixture.NumEvents("\"state\":\"ok\",\"clock\":\"synchronised\""), 1U);
  for (int k = 0; k < 3; ++k) fixture.reporter.ReportClock(0, SyncState::kLost, 2);
  EXPECT_EQ(fixture.NumEvents("\"state\":\"ok\",\"clock\":\"lost\""), 1U);
  fixture.reporter.ReportSensor(0, SensorState::kSilent, 3);
  EXPECT_EQ(fixture.NumEvents("\"state\":\"silent\",\"clock\":\"lost\""), 1U);
  ASSERT_EQ(fixture.notes().size(), 1U);
  EXPECT_EQ(fixture.notes()[0].rfind("roof: has lost its time synchronisation", 0), 0U);
  // Another LiDAR in its place, and one that tells nothing of its clock.
  fixture.reporter.ReplaceSensor(0, "tower");
  fixture.reporter.ReportSensor(0, kOk, 4);
  fixture.reporter.ReportSensor(1, kOk, 4);
  EXPECT_EQ(fixture.NumEvents("clock"), 3U);
  EXPECT_EQ(fixture.NumEvents("sensor"), 5U);
}

TEST(IsWorthANote, TheFirstTimeAndEachTimeThereAreTwiceAsMany) {
  std::vector<std::uint64_t> noted;
  EXPECT_FALSE(IsWorthANote(0, 0));
  for (std::uint64_t count = 1; count <= 40; ++count) {
    if (IsWorthANote(count - 1, count)) noted.push_back(count);
  }
  EXPECT_EQ(noted, (std::vector<std::uint64_t>{1, 2, 4, 8, 16, 32}));
}

TEST(LiveEventReporter, TellsOfEachSensorOnlyWhatIsNew) {
  ReporterFixture fixture;
  EXPECT_FALSE(fixture.reporter.StateOf(0));
  constexpr auto kOk = SensorState::kOk;
  constexpr auto kSilent = SensorState::kSilent;
  for (const SensorState state : {kOk, kOk, kSilent, kSilent, kOk, SensorState::kBlinded}) {
    fixture.reporter.ReportSensor(0, state, 1);
    fixture.reporter.Take(SensorChanged{0, state}, LiveProgress());
  }
  EXPECT_TRUE(fixture.reporter.StateOf(0));
  EXPECT_FALSE(fixture.reporter.StateOf(1));
  EXPECT_EQ(fixture.NumEvents("\"roof\""), 4U);
  EXPECT_EQ(fixture.NumEvents("\"state\":\"silent\""), 1U);
  EXPECT_EQ(fixture.NumEvents("\"state\":\"blinded\""), 1U);
  ASSERT_EQ(fixture.notes().size(), 1U);
  EXPECT_EQ(fixture.notes()[0].rfind("roof: blinded", 0), 0U);
  EXPECT_EQ(fixture.NumEvents("\"mast\""), 0U);
}

TEST(LiveEventReporter, SaysWhyItBeginsASecondTime) {
  ReporterFixture fixture;
  fixture.reporter.Take(EngineState::kWarmingUp, LiveProgress());
  fixture.reporter.Take(EngineState::kRunning, LiveProgress());
  EXPECT_TRUE(fixture.notes().empty());
  LiveProgress now;
  now.newest_ns = 1'706'300'000'250'000'000;
  fixture.reporter.Take(EngineState::kWarmingUp, now);
  EXPECT_EQ(fixture.notes(),
            (std::vector<std::string>{
                "begins anew at 1706300000.250000000: the clock has gone back, or no "
                "frame came for longer than live.window_s"}));
  EXPECT_EQ(fixture.NumEvents("warming_up"), 2U);
}

TEST(LiveEventReporter, OverloadIsAStateUntilItIsOver) {
  ReporterFixture fixture;
  fixture.reporter.ReportPace(1, 0, LiveProgress());
  EXPECT_EQ(fixture.NumEvents("state"), 0U);
  fixture.reporter.ReportPace(2, 0, LiveProgress());
  fixture.reporter.ReportPace(4, 5, LiveProgress());
  fixture.reporter.Take(EngineState::kRunning, LiveProgress());  // which waits
  EXPECT_EQ(fixture.NumEvents("overloaded"), 1U);
  EXPECT_EQ(fixture.NumEvents("running"), 0U);
  fixture.reporter.ReportPace(1, 9, LiveProgress());
  EXPECT_EQ(fixture.NumEvents("running"), 1U);
  EXPECT_EQ(fixture.notes(), (std::vector<std::string>{"overloaded: one frame in 2 is worked off",
                                                       "overloaded: one frame in 4 is worked off",
                                                       "no more overloaded, left out: 9 frames"}));
}

TEST(LiveEventReporter, AnEngineThatRunsSaysSoAgainAndABeginningIsToldOnce) {
  ReporterFixture fixture;
  const auto at = [](int seconds) {
    return LiveProgress{1'000'000'000LL * seconds, static_cast<std::uint64_t>(10 * seconds), 0};
  };
  fixture.reporter.Take(EngineState::kWarmingUp, at(1));
  for (int s = 1; s < 60; ++s) fixture.reporter.SendHeartbeat(at(s));
  EXPECT_EQ(fixture.NumEvents("warming_up"), 1U);
  fixture.reporter.Take(EngineState::kRunning, at(60));
  for (int s = 60; s < 181; ++s) fixture.reporter.SendHeartbeat(at(s));
  EXPECT_EQ(fixture.NumEvents("running"), 4U);
}

TEST(LiveEventReporter, AnEngineWhoseClockWentBackWhileOverloadedSaysThatItRunsAsOftenAsBefore) {
  ReporterFixture fixture;
  const auto at = [](int seconds) { return LiveProgress{1'000'000'000LL * seconds, 1, 0}; };
  fixture.reporter.Take(EngineState::kWarmingUp, at(7200));
  fixture.reporter.Take(EngineState::kRunning, at(7203));
  fixture.reporter.ReportPace(2, 1, at(7210));
  fixture.reporter.Take(EngineState::kWarmingUp, at(3600));
  fixture.reporter.Take(EngineState::kRunning, at(3603));
  for (int s = 3603; s < 3724; ++s) fixture.reporter.SendHeartbeat(at(s));
  EXPECT_EQ(fixture.NumEvents("overloaded"), 1U + 3U);
}

}  // namespace
}  // namespace unlidar
