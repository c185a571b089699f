#include "app/live_teller.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

using testing::TemporaryFolder;

// A teller, and what it has told.
class Told {
 public:
  Told()
      : note_([this](const std::string& text) { notes_.push_back(text); }),
        output_(folder_ / "out.csv", folder_ / "events", {0, 0}, signals_, note_),
        teller(output_, service_, note_) {
    teller.AddSensor("roof");
    teller.AddSensor("mast");
  }

  const std::vector<std::string>& notes() const { return notes_; }

  // Events that hold a text.
  std::size_t NumEvents(const std::string& text) {
    teller.Flush();
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
  LiveTeller teller;
};

TEST(IsWorthANote, TheFirstTimeAndEachTimeThereAreTwiceAsMany) {
  std::vector<std::uint64_t> noted;
  for (std::uint64_t count = 0; count <= 40; ++count) {
    if (IsWorthANote(count)) noted.push_back(count);
  }
  EXPECT_EQ(noted, (std::vector<std::uint64_t>{1, 2, 4, 8, 16, 32}));
}

TEST(LiveTeller, TellsOfEachSensorOnlyWhatIsNew) {
  Told told;
  EXPECT_FALSE(told.teller.HasTold(0));
  constexpr auto kOk = SensorState::kOk;
  constexpr auto kSilent = SensorState::kSilent;
  for (const SensorState state : {kOk, kOk, kSilent, kSilent, kOk, SensorState::kBlinded}) {
    told.teller.TellSensor(0, state, 1);
    told.teller.Take(SensorChanged{0, state}, LiveProgress());
  }
  EXPECT_TRUE(told.teller.HasTold(0));
  EXPECT_FALSE(told.teller.HasTold(1));
  EXPECT_EQ(told.NumEvents("\"roof\""), 4U);
  EXPECT_EQ(told.NumEvents("\"state\":\"silent\""), 1U);
  EXPECT_EQ(told.NumEvents("\"state\":\"blinded\""), 1U);
  ASSERT_EQ(told.notes().size(), 1U);
  EXPECT_EQ(told.notes()[0].rfind("roof: blinded", 0), 0U);
  EXPECT_EQ(told.NumEvents("\"mast\""), 0U);
}

TEST(LiveTeller, SaysWhyItBeginsASecondTime) {
  Told told;
  told.teller.Take(EngineState::kWarmingUp, LiveProgress());
  told.teller.Take(EngineState::kRunning, LiveProgress());
  EXPECT_TRUE(told.notes().empty());
  LiveProgress now;
  now.newest_ns = 1'706'300'000'250'000'000;
  told.teller.Take(EngineState::kWarmingUp, now);
  EXPECT_EQ(told.notes(), (std::vector<std::string>{
                              "begins anew at 1706300000.250000000: the clock has gone back, or no "
                              "frame came for longer than live.window_s"}));
  EXPECT_EQ(told.NumEvents("warming_up"), 2U);
}

TEST(LiveTeller, OverloadIsAStateUntilItIsOver) {
  Told told;
  told.teller.TellPace(1, 0, LiveProgress());
  EXPECT_EQ(told.NumEvents("state"), 0U);
  told.teller.TellPace(2, 0, LiveProgress());
  told.teller.TellPace(4, 5, LiveProgress());
  told.teller.Take(EngineState::kRunning, LiveProgress());  // which waits
  EXPECT_EQ(told.NumEvents("overloaded"), 1U);
  EXPECT_EQ(told.NumEvents("running"), 0U);
  told.teller.TellPace(1, 9, LiveProgress());
  EXPECT_EQ(told.NumEvents("running"), 1U);
  EXPECT_EQ(told.notes(), (std::vector<std::string>{"overloaded: one frame in 2 is worked off",
                                                    "overloaded: one frame in 4 is worked off",
                                                    "no more overloaded, left out: 9 frames"}));
}

TEST(LiveTeller, AnEngineThatRunsSaysSoAgainAndABeginningIsToldOnce) {
  Told told;
  const auto at = [](int seconds) {
    return LiveProgress{1'000'000'000LL * seconds, static_cast<std::uint64_t>(10 * seconds), 0};
  };
  told.teller.Take(EngineState::kWarmingUp, at(1));
  for (int s = 1; s < 60; ++s) told.teller.TellAlive(at(s));
  EXPECT_EQ(told.NumEvents("warming_up"), 1U);
  told.teller.Take(EngineState::kRunning, at(60));
  for (int s = 60; s < 181; ++s) told.teller.TellAlive(at(s));
  EXPECT_EQ(told.NumEvents("running"), 4U);
}

TEST(LiveTeller, AnEngineWhoseClockWentBackWhileOverloadedSaysThatItRunsAsOftenAsBefore) {
  Told told;
  const auto at = [](int seconds) { return LiveProgress{1'000'000'000LL * seconds, 1, 0}; };
  told.teller.Take(EngineState::kWarmingUp, at(7200));
  told.teller.Take(EngineState::kRunning, at(7203));
  told.teller.TellPace(2, 1, at(7210));
  told.teller.Take(EngineState::kWarmingUp, at(3600));
  told.teller.Take(EngineState::kRunning, at(3603));
  for (int s = 3603; s < 3724; ++s) told.teller.TellAlive(at(s));
  EXPECT_EQ(told.NumEvents("overloaded"), 1U + 3U);
}

}  // namespace
}  // namespace unlidar
