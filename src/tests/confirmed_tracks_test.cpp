#include "live/confirmed_tracks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::FrameAt;
using testing::kBeginNs;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::MiddleS;
using testing::Random;

constexpr TimeNs kEndless = std::numeric_limits<TimeNs>::max() / 2;

LivePlot PlotAt(int i, const Eigen::Vector3d& position_m) {
  LivePlot seen;
  seen.plot.frame = static_cast<std::uint32_t>(i);
  seen.plot.time_ns = seen.plot.frame_time_ns = FrameAt(i).middle_ns();
  seen.plot.position_m = seen.plot.ray_m = position_m;
  seen.plot.variance_m2 = 0.02;
  seen.plot.log_clutter = std::log(1e-6);
  seen.plot.num_returns = 3;
  seen.scatter_m2 = SymmetricMatrix(3.0 * 0.1 * 0.1 * Eigen::Matrix3d::Identity());
  seen.stamp_ns = FrameAt(i).stamp_ns;
  seen.time_s = MiddleS(i);
  return seen;
}

FrameTime MomentAt(int i) { return {MiddleS(i), {static_cast<std::uint32_t>(i)}}; }

void Append(const LivePlot& seen, Flight* flight) {
  flight->plots.push_back(seen);
  flight->frame_times.push_back(MomentAt(static_cast<int>(seen.plot.frame)));
}

// A drone that passes.
LivePlot DroneAt(int i) { return PlotAt(i, {15.0, -10.0 + 0.4 * i, 8.0}); }

// Another one, far from it.
LivePlot OtherAt(int i) { return PlotAt(i, {-25.0, 5.0 - 0.3 * i, 12.0}); }

// One far away, of a single return.
LivePlot FarAt(int i, const Eigen::Vector3d& position_m, double log_clutter) {
  LivePlot seen = PlotAt(i, position_m);
  seen.plot.variance_m2 = 0.1;
  seen.plot.log_clutter = log_clutter;
  seen.plot.num_returns = 1;
  seen.scatter_m2 = {};
  return seen;
}

// One that turns.
LivePlot CirclingAt(int i) {
  return PlotAt(i, {20.0 + 6.0 * std::cos(0.06 * i), 6.0 * std::sin(0.06 * i), 8.0});
}

template <class PlotOf>
Flight FlightUntil(int end, const PlotOf& plot_of) {
  Flight flight;
  for (int i = 0; i < end; ++i) Append(plot_of(i), &flight);
  return flight;
}

struct Tracks {
  Config config;
  ScanSchedule scan_schedule;
  std::vector<TrackModel> models;
  std::vector<TrajectoryRow> rows;
  std::vector<TrackConfirmed> confirmed;
  std::vector<TrackEnded> ended;
  std::vector<TracedTrack> traced;
  LiveTrace trace;
  ConfirmedTracks tracks;

  explicit Tracks(const Config& its_config = Config())
      : config(its_config),
        scan_schedule{{ScanSchedule::Sensor()}},
        models({TrackModel(4.0, scan_schedule, config.robust.tracker)}),
        trace([this](const LiveTraceEvent& event) {
          traced.push_back(std::get<TracedTrack>(event));
        }),
        tracks(
            config, models, FirstSensorStamps{},
            [this](const EngineEvent& event) {
              if (const auto* given = std::get_if<RowGiven>(&event)) rows.push_back(given->row);
              if (const auto* at = std::get_if<TrackConfirmed>(&event)) confirmed.push_back(*at);
              if (const auto* at = std::get_if<TrackEnded>(&event)) ended.push_back(*at);
            },
            trace) {
    tracks.SetPeriod(kPeriodNs);
  }

  // Begins a track with a flight unless one has it, and judges it.
  void Initiate(const Flight& flight) {
    if (!tracks.HasTrackOf(flight)) tracks.Initiate(flight);
    for (const LivePlot& plot : flight.plots) seen.push_back(plot);
    tracks.Judge(seen, flight.plots.back().time_s);
  }

  // The tracks go on to a frame with a plot, are judged, and give all rows that are due.
  void GoTo(int i, const LivePlot& plot) {
    tracks.AddInstants(FrameAt(i));
    tracks.Extend({plot}, MomentAt(i));
    seen.push_back(plot);
    tracks.Judge(seen, plot.time_s);
    tracks.EmitRows(FrameAt(i).middle_ns(), FrameAt(i).stamp_ns);
  }

  RecentPlots seen;
};

TEST(ConfirmedTracks, WithoutOneEveryPlotIsFree) {
  Tracks t;
  EXPECT_EQ(t.tracks.Extend({DroneAt(0), OtherAt(0)}, MomentAt(0)), (std::vector<char>{1, 1}));
}

TEST(ConfirmedTracks, EachTakesItsOwnPlotAndLeavesTheRest) {
  Tracks t;
  t.Initiate(FlightUntil(20, DroneAt));
  t.Initiate(FlightUntil(20, OtherAt));
  const LivePlot stray = PlotAt(20, {40.0, 30.0, 10.0});
  const std::vector<LivePlot> plots = {stray, OtherAt(20), DroneAt(20)};
  EXPECT_EQ(t.tracks.Extend(plots, MomentAt(20)), (std::vector<char>{1, 0, 0}));
}

TEST(ConfirmedTracks, TheFirstVerdictOnANewOneMayWaitForTheNextFrame) {
  Tracks t;
  constexpr int kEnd = 400;
  for (int i = 0; i <= kEnd; ++i) {
    t.tracks.AddInstants(FrameAt(i));
    t.seen.push_back(CirclingAt(i));
  }
  const auto judge_in_large_frame = [&](int i) {
    t.tracks.Judge(t.seen, CirclingAt(i).time_s, true);
    t.tracks.EmitRows(FrameAt(i).middle_ns(), FrameAt(2 * kEnd).stamp_ns);
  };
  t.tracks.Initiate(FlightUntil(kEnd, CirclingAt));
  judge_in_large_frame(kEnd - 1);
  EXPECT_TRUE(t.rows.empty());
  t.tracks.Extend({CirclingAt(kEnd)}, MomentAt(kEnd));
  judge_in_large_frame(kEnd);
  EXPECT_GE(t.rows.size(), static_cast<std::size_t>(kEnd));  // from its first plot on
}

TEST(ConfirmedTracks, APlaceIsATargetsWhileItIsThere) {
  Tracks t;
  t.Initiate(FlightUntil(20, DroneAt));
  const auto seconds = [](int i) { return DroneAt(i).time_s; };
  const auto has = [&](int place, int since, int until) {
    const Eigen::Vector3d place_m = DroneAt(place).plot.position_m;
    const KnownTargets targets = t.tracks.TargetsAt(seconds(until));
    return targets.box_m.contains(place_m) && targets.are_at(place_m, seconds(since));
  };
  EXPECT_TRUE(has(19, 19, 19));
  EXPECT_TRUE(has(21, 20, 21));
  EXPECT_FALSE(has(19, 2, 19));  // it was 7 m away
  EXPECT_FALSE(has(2, 2, 19));   // and has left
}

TEST(ConfirmedTracks, WhatIsSightedNowAndThenGoesOn) {
  Tracks t;
  const auto far_at = [](int i) { return FarAt(i, {40.0, -20.0 + 0.2 * i, 20.0}, -14.0); };
  constexpr int kEnd = 170;
  Flight flight;
  for (int i = 0; i < 100; i += 5) Append(far_at(i), &flight);
  for (int i = 0; i < kEnd; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(flight);
  for (int i = 100; i < kEnd; ++i) {
    const bool is_seen = i == 115 || i == 130 || i == 145 || i == 160;
    t.tracks.Extend(is_seen ? std::vector<LivePlot>{far_at(i)} : std::vector<LivePlot>(),
                    MomentAt(i));
  }
  t.tracks.Close(kEndless);
  ASSERT_EQ(t.ended.size(), 1U);
  EXPECT_EQ(t.ended[0].last_evidence_ns, far_at(160).plot.time_ns);
}

// Returns the frame of the last evidence of a drone that is seen in every frame, and from frame 60
// on in no more, but for a stray on its way in every fifth.
int LastFrameWithEvidence(double log_clutter) {
  Tracks t;
  constexpr int kEnd = 100;
  for (int i = 0; i < kEnd; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(60, DroneAt));
  for (int i = 60; i < kEnd; ++i) {
    LivePlot stray = DroneAt(i);
    stray.plot.position_m += Eigen::Vector3d(0.0, 0.2, 0.3);
    stray.plot.log_clutter = log_clutter;
    t.tracks.Extend(i % 5 == 4 ? std::vector{stray} : std::vector<LivePlot>(), MomentAt(i));
  }
  t.tracks.Close(kEndless);
  EXPECT_EQ(t.ended.size(), 1U);
  return static_cast<int>((t.ended[0].last_evidence_ns - FrameAt(0).middle_ns()) / kPeriodNs);
}

TEST(ConfirmedTracks, OneThatWasSeenInEveryFrameDoesNotGoOnByStrays) {
  EXPECT_EQ(LastFrameWithEvidence(-2.0), 59);
  EXPECT_EQ(LastFrameWithEvidence(-14.0), 99);  // in open air it is the drone
}

TEST(ConfirmedTracks, OneThatIsLostLeavesItsPlotsToAGroundTarget) {
  for (const double ground_gain : {0.0, 1e-3, 100.0}) {
    for (const int pause : {3, 30}) {
      Tracks t;
      const int last = 64 + pause;
      const bool is_left = pause == 30 && ground_gain == 100.0;
      for (int i = 0; i <= last; ++i) t.tracks.AddInstants(FrameAt(i));
      t.Initiate(FlightUntil(60, DroneAt));
      for (int i = 60 + pause; i <= last; ++i) {
        t.tracks.Extend({DroneAt(i)}, MomentAt(i), {ground_gain});
        EXPECT_EQ(t.tracks.TrackOf(0).has_value(), !is_left) << ground_gain << " " << pause;
      }
      t.tracks.Close(kEndless);
      ASSERT_EQ(t.ended.size(), 1U);
      EXPECT_EQ(t.ended[0].last_evidence_ns, DroneAt(is_left ? 59 : last).plot.time_ns);
    }
  }
}

TEST(ConfirmedTracks, AFlightIsATrackOnce) {
  Tracks t;
  for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
  const Flight flight = FlightUntil(20, DroneAt);
  t.Initiate(flight);
  t.Initiate(flight);
  t.tracks.Close(kEndless);
  ASSERT_EQ(t.confirmed.size(), 1U);
  EXPECT_EQ(t.confirmed[0].track_id, 0);
  EXPECT_EQ(t.confirmed[0].first_evidence_ns, flight.plots.front().plot.time_ns);
  ASSERT_EQ(t.ended.size(), 1U);
  EXPECT_EQ(t.ended[0].last_evidence_ns, flight.plots.back().plot.time_ns);
}

TEST(ConfirmedTracks, EveryRowIsGivenOnceInOrderWhereTheDroneIs) {
  Tracks t;
  for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(20, DroneAt));
  std::size_t num_settled = 0;
  for (int i = 20; i < 60; ++i) {
    const LivePlot seen = DroneAt(i);
    t.tracks.AddInstants(FrameAt(i));
    t.tracks.Extend({seen}, MomentAt(i));
    const TimeNs middle_ns = FrameAt(i).middle_ns();
    num_settled += t.tracks.EmitRows(middle_ns, FrameAt(i).stamp_ns).size();
    for (const TrajectoryRow& row : t.rows) EXPECT_LE(row.time_ns, middle_ns);
    EXPECT_TRUE(t.tracks.EndLost(middle_ns - 10 * kPeriodNs, middle_ns).empty());
  }
  EXPECT_TRUE(t.ended.empty());
  EXPECT_GT(num_settled, 40U);
  EXPECT_LE(num_settled, 60U);
  t.tracks.Close(kEndless);
  EXPECT_EQ(t.ended.size(), 1U);
  ASSERT_GE(t.rows.size(), 59U);
  for (std::size_t k = 0; k < t.rows.size(); ++k) {
    const TrajectoryRow& row = t.rows[k];
    if (k > 0) {
      EXPECT_EQ(row.time_ns, t.rows[k - 1].time_ns + kPeriodNs);
    }
    const double i = static_cast<double>(row.time_ns - FrameAt(0).middle_ns()) / kPeriodNs;
    const Eigen::Vector3d truth_m(15.0, -10.0 + 0.4 * i, 8.0);
    EXPECT_LT((row.position_m - truth_m).norm(), 0.5) << k;
  }
}

// By scales of the time when it stood still, what it does then would be an outlier.
TEST(ConfirmedTracks, RowsFollowADroneThatSetsOff) {
  Tracks t;
  Random random(1);
  constexpr int kHovers = 96;
  const auto truth_m = [](double i) {
    const double moving_s = std::max(0.0, i - kHovers) * kPeriodS;
    return Eigen::Vector3d(15.0, 3.0 * moving_s * moving_s, 8.0);
  };
  const auto setting_off_at = [&](int i) {
    return PlotAt(i, truth_m(i) + random.NormalVector(0.03));
  };
  for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(20, setting_off_at));
  for (int i = 20; i < kHovers + 30; ++i) {
    const LivePlot seen = setting_off_at(i);
    t.tracks.AddInstants(FrameAt(i));
    t.tracks.Extend({seen}, MomentAt(i));
    t.tracks.EmitRows(FrameAt(i).middle_ns(), FrameAt(i).stamp_ns);
  }
  ASSERT_GT(t.rows.size(), 90U);
  for (const TrajectoryRow& row : t.rows) {
    const double i = static_cast<double>(row.time_ns - FrameAt(0).middle_ns()) / kPeriodNs;
    EXPECT_LT((row.position_m - truth_m(i)).norm(), 0.2) << i;
  }
}

// A drone at 4 m/s, seen by a sensor that gives a frame without times every half second: its
// returns were measured within so much of that from the stamp.
LivePlot SeldomAt(int i, double measured_s, Random* random) {
  constexpr int kEvery = 5;
  LivePlot seen = PlotAt(kEvery * i, Eigen::Vector3d::Zero());
  seen.plot.frame = static_cast<std::uint32_t>(i);
  seen.plot.time_ns = seen.plot.frame_time_ns = seen.stamp_ns + kEvery * kPeriodNs / 2;
  seen.plot.streak_s = kEvery * kPeriodS;
  seen.time_s = (i + 0.5) * kEvery * kPeriodS;
  constexpr int kReturns = 6;
  seen.plot.num_returns = kReturns;
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();
  std::vector<Eigen::Vector3d> returns_m;
  for (int k = 0; k < kReturns; ++k) {
    const double time_s = kEvery * kPeriodS * i + random->Uniform(0.0, measured_s);
    returns_m.push_back(Eigen::Vector3d(15.0, 4.0 * time_s - 20.0, 8.0) +
                        random->NormalVector(0.1));
    seen.plot.position_m += returns_m.back() / kReturns;
  }
  for (const Eigen::Vector3d& return_m : returns_m) {
    const Eigen::Vector3d offset_m = return_m - seen.plot.position_m;
    scatter_m2 += offset_m * offset_m.transpose();
  }
  seen.scatter_m2 = SymmetricMatrix(scatter_m2);
  seen.plot.ray_m = seen.plot.position_m;
  return seen;
}

// Every fifth frame of a LiDAR with ten a second, and one that takes half a second for a frame: the
// streaks of the drone tell, as they do in a recording.
TEST(ConfirmedTracks, RowsOfFramesThatComeSeldomAreWhereTheDroneWasThen) {
  for (const double measured_s : {0.1, 0.5}) {
    Tracks t;
    t.tracks.SetPeriod(5 * kPeriodNs);
    Random random(31);
    const auto moment_at = [](int i) {
      return FrameTime{(i + 0.5) * 0.5, {static_cast<std::uint32_t>(i)}};
    };
    Flight flight;
    for (int i = 0; i < 12; ++i) {
      flight.plots.push_back(SeldomAt(i, measured_s, &random));
      flight.frame_times.push_back(moment_at(i));
      t.tracks.AddInstants(FrameAt(5 * i));
    }
    t.Initiate(flight);
    for (int i = 12; i < 30; ++i) {
      const LivePlot seen = SeldomAt(i, measured_s, &random);
      t.tracks.AddInstants(FrameAt(5 * i));
      t.tracks.Extend({seen}, moment_at(i));
      t.tracks.EmitRows(seen.plot.frame_time_ns, seen.stamp_ns);
    }
    ASSERT_GE(t.rows.size(), 25U);
    for (std::size_t k = 0; k < t.rows.size(); ++k) {
      const double time_s = static_cast<double>(t.rows[k].time_ns - kBeginNs) * kSecondsPerNs;
      EXPECT_NEAR(t.rows[k].position_m.y(), 4.0 * time_s - 20.0, 0.5) << measured_s << ' ' << k;
      if (k > 0) {
        EXPECT_GT(t.rows[k].time_ns, t.rows[k - 1].time_ns);
      }
    }
  }
}

// A drone that speeds up, of frames without point times; the scatter of its returns along its way
// is that of its body, or has the way flown in a frame.
std::vector<TrajectoryRow> RowsOfOneThatSpeedsUp(double streak_s, bool has_streak) {
  const auto plot_at = [&](int i) {
    const double time_s = MiddleS(i);
    LivePlot seen = PlotAt(i, {15.0, 0.75 * time_s * time_s - 10.0, 8.0});
    seen.plot.streak_s = streak_s;
    seen.plot.num_returns = 6;
    const double way_m = 1.5 * time_s * kPeriodS;
    const double along_m2 = has_streak ? way_m * way_m / 12.0 : 0.0;
    seen.scatter_m2 = SymmetricMatrix(
        Eigen::Matrix3d(Eigen::Vector3d(0.02, 0.05 + 5.0 * along_m2, 0.05).asDiagonal()));
    return seen;
  };
  Tracks t;
  constexpr int kEnd = 60;
  for (int i = 0; i < kEnd; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(kEnd, plot_at));
  t.tracks.Close(kEndless);
  return t.rows;
}

TEST(ConfirmedTracks, WhetherADroneIsHitAtOneInstantOfEachFrameTellsTheErrorOfItsTimes) {
  const std::vector<TrajectoryRow> timed = RowsOfOneThatSpeedsUp(0.0, false);
  const std::vector<TrajectoryRow> instant = RowsOfOneThatSpeedsUp(kPeriodS, false);
  const std::vector<TrajectoryRow> streak = RowsOfOneThatSpeedsUp(kPeriodS, true);
  ASSERT_GT(timed.size(), 50U);
  ASSERT_EQ(instant.size(), timed.size());
  ASSERT_EQ(streak.size(), timed.size());
  const std::size_t last = timed.size() - 5;
  const double error_m = timed[last].velocity_mps.y() * kPeriodS / std::sqrt(12.0);
  EXPECT_GT(error_m, 0.2);
  EXPECT_GT(instant[last].sigma_m.y(), error_m);
  EXPECT_LT(instant[last].sigma_m.y(), error_m + 0.1);
  EXPECT_LT(streak[last].sigma_m.y(), 0.6 * error_m);
}

// Beyond the last sighting a row is a guess: a poor one waits for the next sighting, or the end.
TEST(ConfirmedTracks, PoorGuessesWaitForASightingOrTheEnd) {
  for (const bool is_seen_again : {true, false}) {
    Tracks t;
    constexpr int kLast = 90;
    constexpr int kAgain = 114;
    Flight flight;
    for (int i = 0; i <= kLast; i += 6) Append(CirclingAt(i), &flight);
    for (int i = 0; i <= kLast; ++i) t.tracks.AddInstants(FrameAt(i));
    t.Initiate(flight);
    const auto go_to = [&](int i, const std::vector<LivePlot>& plots) {
      t.tracks.AddInstants(FrameAt(i));
      t.tracks.Extend(plots, MomentAt(i));
      // All rows are due.
      t.tracks.EmitRows(FrameAt(i).middle_ns(), FrameAt(i).stamp_ns + NsOf(10.0));
    };
    for (int i = kLast + 1; i < kAgain; ++i) go_to(i, {});
    const std::size_t num_guessed = t.rows.size();
    EXPECT_GE(t.rows.back().time_ns, FrameAt(kLast).stamp_ns);
    EXPECT_LT(t.rows.back().time_ns, FrameAt(kAgain - 1).stamp_ns);
    for (const TrajectoryRow& row : t.rows) EXPECT_LE(row.sigma_m.maxCoeff(), 0.25);
    for (int i = kAgain; is_seen_again && i < kAgain + 18; ++i) {
      if (i % 6 == 0) go_to(i, {CirclingAt(i)});
      if (i % 6 != 0) go_to(i, {});
    }
    if (!is_seen_again) t.tracks.Close(kEndless);
    EXPECT_GE(t.rows.size(), num_guessed + 3) << is_seen_again;
    for (std::size_t k = 1; k < t.rows.size(); ++k) {
      EXPECT_EQ(t.rows[k].time_ns, t.rows[k - 1].time_ns + kPeriodNs);
    }
  }
}

TEST(ConfirmedTracks, OneThatIsSeenNoMoreEndsAlone) {
  Tracks t;
  for (int i = 0; i < 40; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(20, DroneAt));
  t.Initiate(FlightUntil(40, OtherAt));
  const TimeNs middle_ns = FrameAt(39).middle_ns();
  t.tracks.EndLost(FrameAt(19).middle_ns(), middle_ns);
  EXPECT_TRUE(t.ended.empty());
  t.tracks.EndLost(FrameAt(19).middle_ns() + 1, middle_ns);
  ASSERT_EQ(t.ended.size(), 1U);
  EXPECT_EQ(t.ended[0].track_id, 0);
  EXPECT_EQ(t.traced.back().number, 0);
  EXPECT_EQ(t.traced.back().state, TrackState::kDeleted);
  EXPECT_EQ(t.traced.back().rejection, Rejection::kLost);
}

// Something of this width on the way of DroneAt.
LivePlot SpreadAt(int i, double spread_m) {
  LivePlot seen = DroneAt(i);
  seen.scatter_m2 = SymmetricMatrix(static_cast<double>(seen.plot.num_returns) * spread_m *
                                    spread_m * Eigen::Matrix3d::Identity());
  return seen;
}

// A puff of steam: its returns lie wide.
LivePlot PuffAt(int i) { return SpreadAt(i, 0.6); }

// Dust that is no wider than a drone for some seconds.
LivePlot DustAt(int i) { return SpreadAt(i, 0.05 + 0.008 * i); }

// Dust that grows slowly.
LivePlot SlowDustAt(int i) { return SpreadAt(i, 0.1 + 0.004 * i); }

// Smoke that is seen into, no wider than a large drone.
LivePlot SmokeAt(int i) {
  LivePlot seen = DroneAt(i);
  seen.plot.num_returns = 12;
  seen.scatter_m2 = SymmetricMatrix(12.0 * 0.2 * 0.2 * Eigen::Matrix3d::Identity());
  return seen;
}

// A target too small for a drone.
LivePlot InsectAt(int i) {
  LivePlot seen = DroneAt(i);
  seen.scatter_m2 = SymmetricMatrix(3.0 * 0.01 * 0.01 * Eigen::Matrix3d::Identity());
  return seen;
}

// One that stands where a cable that holds it would not be seen.
LivePlot HangingAt(int i) {
  constexpr double kSwayM = 0.05;
  return PlotAt(i, {32.0, kSwayM * std::sin(1.7 * i), 6.0});
}

std::vector<std::pair<TrackState, Rejection>> StatesOf(const std::vector<TracedTrack>& traced) {
  std::vector<std::pair<TrackState, Rejection>> states;
  for (const TracedTrack& one : traced) states.emplace_back(one.state, one.rejection);
  return states;
}

// Follows a target for six seconds, until the end of the stream.
std::vector<std::pair<TrackState, Rejection>> StatesOf(LivePlot (*plot_at)(int),
                                                       const Config& config = Config()) {
  Tracks t(config);
  for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(20, plot_at));
  for (int i = 20; i < 60; ++i) t.GoTo(i, plot_at(i));
  t.tracks.Close(kEndless);
  for (const TracedTrack& one : t.traced) {
    EXPECT_EQ(one.number, 0);
    EXPECT_EQ(one.first_evidence_ns, plot_at(0).plot.time_ns);
  }
  return StatesOf(t.traced);
}

void ExpectFollowedWithoutARow(LivePlot (*plot_at)(int)) {
  Tracks t;
  for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(20, plot_at));
  for (int i = 20; i < 60; ++i) t.GoTo(i, plot_at(i));
  EXPECT_EQ(t.tracks.Extend({plot_at(60)}, MomentAt(60)), (std::vector<char>{0}));
  t.tracks.Close(kEndless);
  EXPECT_TRUE(t.confirmed.empty());
  EXPECT_TRUE(t.rows.empty());
  EXPECT_TRUE(t.ended.empty());
}

TEST(ConfirmedTracks, ACloudIsFollowedWithoutARow) { ExpectFollowedWithoutARow(PuffAt); }

TEST(ConfirmedTracks, AnInsectIsFollowedWithoutARow) { ExpectFollowedWithoutARow(InsectAt); }

TEST(ConfirmedTracks, TheTraceNamesTheRuleForWhichATrackHasNoRows) {
  using States = std::vector<std::pair<TrackState, Rejection>>;
  const std::pair begun(TrackState::kInitiated, Rejection::kNone);
  const std::pair confirmed(TrackState::kConfirmed, Rejection::kNone);
  const std::pair closed(TrackState::kDeleted, Rejection::kNone);
  EXPECT_EQ(StatesOf(DroneAt), (States{begun, confirmed, closed}));
  const struct {
    LivePlot (*plot_at)(int);
    Rule rule;
    TrackState state;
    Rejection rejection;
  } cases[] = {{PuffAt, Rule::kCloud, TrackState::kRejected, Rejection::kCloud},
               {DustAt, Rule::kGrowth, TrackState::kRejected, Rejection::kCloud},
               {SmokeAt, Rule::kVolumeScattering, TrackState::kRejected, Rejection::kCloud},
               {InsectAt, Rule::kInsect, TrackState::kRejected, Rejection::kInsect},
               {HangingAt, Rule::kSuspended, TrackState::kWaiting, Rejection::kSuspended}};
  for (const auto& [plot_at, rule, state, rejection] : cases) {
    const std::pair refused(state, rejection);
    EXPECT_EQ(StatesOf(plot_at), (States{begun, refused, closed})) << NameOf(rejection);
    Config without;
    without.robust.disabled_rules = {rule};
    EXPECT_EQ(StatesOf(plot_at, without), (States{begun, confirmed, closed})) << NameOf(rejection);
  }
}

TEST(ConfirmedTracks, WhatHasGrownALittleWaits) {
  const std::pair begun(TrackState::kInitiated, Rejection::kNone);
  const std::pair waits(TrackState::kWaiting, Rejection::kCloud);
  const std::pair refused(TrackState::kRejected, Rejection::kCloud);
  const std::pair closed(TrackState::kDeleted, Rejection::kNone);
  EXPECT_EQ(StatesOf(SlowDustAt), (std::vector{begun, waits, refused, closed}));
}

TEST(ConfirmedTracks, AFlightScoresTheSameBeforeAndAfterATrackHasIt) {
  Tracks t;
  const Flight flight = FlightUntil(20, DroneAt);
  EXPECT_FALSE(t.tracks.HasTrackOf(flight));
  const double score = t.tracks.ScoreOf(flight);
  EXPECT_GT(score, t.tracks.ScoreOf(FlightUntil(10, DroneAt)));
  EXPECT_EQ(t.tracks.Initiate(flight), 0);
  EXPECT_TRUE(t.tracks.HasTrackOf(flight));
  EXPECT_FALSE(t.tracks.HasTrackOf(FlightUntil(20, OtherAt)));
  EXPECT_EQ(t.tracks.ScoreOf(flight), score);
}

TEST(ConfirmedTracks, APlotIsOfTheTrackToWhichItWasAssigned) {
  Tracks t;
  t.Initiate(FlightUntil(20, DroneAt));
  t.Initiate(FlightUntil(20, OtherAt));
  t.tracks.Extend({PlotAt(20, {40.0, 30.0, 10.0}), OtherAt(20), DroneAt(20)}, MomentAt(20));
  EXPECT_EQ(t.tracks.TrackOf(0), std::nullopt);
  EXPECT_EQ(t.tracks.TrackOf(1), 1);
  EXPECT_EQ(t.tracks.TrackOf(2), 0);
}

TEST(ConfirmedTracks, WhatProvesToBeACloudEndsAndWhatGoesItsWayIsNoDrone) {
  Tracks t;
  constexpr int kGrows = 40;
  const auto growing_at = [](int i) { return i < kGrows ? DroneAt(i) : PuffAt(i); };
  for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
  t.Initiate(FlightUntil(20, growing_at));
  for (int i = 20; i < 120; ++i) t.GoTo(i, growing_at(i));
  ASSERT_EQ(t.confirmed.size(), 1U);
  ASSERT_EQ(t.ended.size(), 1U);
  EXPECT_EQ(t.ended[0].track_id, t.confirmed[0].track_id);
  EXPECT_GT(t.ended[0].last_evidence_ns, FrameAt(kGrows).stamp_ns);
  EXPECT_LT(t.ended[0].last_evidence_ns, FrameAt(119).stamp_ns);
  // Later something small, on the same way, and a drone elsewhere.
  constexpr int kLater = 150;
  Flight piece;
  Flight drone;
  for (int i = 0; i < 20; ++i) {
    Append(PlotAt(kLater + i, growing_at(kGrows - 20 + i).plot.position_m), &piece);
    Append(OtherAt(kLater + i), &drone);
    t.tracks.AddInstants(FrameAt(kLater + i));
  }
  t.Initiate(piece);
  t.Initiate(drone);
  t.rows.clear();
  t.tracks.Close(kEndless);
  ASSERT_EQ(t.confirmed.size(), 2U);
  for (const TrajectoryRow& row : t.rows) {
    EXPECT_EQ(row.track_id, t.confirmed[1].track_id);
    EXPECT_LT(row.position_m.x(), 0.0);
  }
}

// What stands still beyond 25 m may hang on a cable that nothing hits.
TEST(ConfirmedTracks, WhatStandsFarAwayHasNoRowUntilItGoesAway) {
  for (const double range_m : {10.0, 32.0}) {
    Tracks t;
    Random random(3);
    constexpr int kStands = 900;
    const auto standing_at = [&](int i) {
      const double away_m = 0.2 * std::max(0, i - kStands);
      return PlotAt(i, Eigen::Vector3d(range_m, away_m, 6.0) + random.NormalVector(0.08));
    };
    for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
    t.Initiate(FlightUntil(20, standing_at));
    for (int i = 20; i < kStands; ++i) t.GoTo(i, standing_at(i));
    EXPECT_EQ(t.confirmed.empty(), range_m > 25.0) << range_m;
    EXPECT_EQ(t.rows.empty(), range_m > 25.0) << range_m;
    for (int i = kStands; i < kStands + 100; ++i) t.GoTo(i, standing_at(i));
    EXPECT_EQ(t.confirmed.size(), 1U) << range_m;
    ASSERT_FALSE(t.rows.empty());
    EXPECT_GT(t.rows.back().position_m.y(), 10.0) << range_m;
  }
}

// What flies by there so slowly that it has not yet come far does not hang: it goes straight on.
TEST(ConfirmedTracks, WhatGoesOnFarAwayHasRowsBeforeItHasGoneFar) {
  for (const double speed_mps : {0.0, 0.4}) {
    Tracks t;
    Random random(4);
    const auto at = [&](int i) {
      const Eigen::Vector3d place_m(32.0, speed_mps * kPeriodS * i, 6.0);
      return PlotAt(i, place_m + random.NormalVector(0.08));
    };
    for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
    t.Initiate(FlightUntil(20, at));
    for (int i = 20; i < 50; ++i) t.GoTo(i, at(i));
    EXPECT_EQ(t.confirmed.empty(), speed_mps == 0.0) << speed_mps;
  }
}

// Each of its lone sightings is no better than having gone unseen, but they are on one way.
TEST(ConfirmedTracks, WhatMayHaveBeenSeenSinceIsNotLost) {
  Tracks t;
  const auto far_at = [](int i) { return FarAt(i, {60.0, -30.0 + 0.3 * i, 25.0}, -19.0); };
  const TimeNs max_gap_ns = NsOf(t.config.robust.tracker.max_gap_s);
  constexpr int kLast = 300;
  Flight flight;
  for (int i = 0; i < 100; i += 5) Append(far_at(i), &flight);
  t.Initiate(flight);
  int end = 0;
  for (int i = 100; t.ended.empty() && i < kLast + 150; ++i) {
    t.tracks.AddInstants(FrameAt(i));
    const bool is_seen = i == 145 || i == 190 || i == 235 || (i >= 270 && i <= kLast && i % 5 == 0);
    t.tracks.Extend(is_seen ? std::vector<LivePlot>{far_at(i)} : std::vector<LivePlot>(),
                    MomentAt(i));
    const TimeNs now_ns = FrameAt(i).middle_ns();
    t.tracks.EmitRows(now_ns, FrameAt(i).stamp_ns);
    t.tracks.EndLost(now_ns - max_gap_ns, now_ns);
    end = i;
  }
  ASSERT_EQ(t.ended.size(), 1U);
  EXPECT_EQ(t.ended[0].last_evidence_ns, far_at(kLast).plot.time_ns);
  EXPECT_EQ(end, kLast + 101);
}

// One that stops at once is not lost because its own returns at the place count as clutter there;
// what was there before it came is clutter still.
TEST(ConfirmedTracks, WhatAPlaceShowsSinceATrackCameIsNoClutterToIt) {
  for (const bool came_with_it : {true, false}) {
    Tracks t;
    Random random(7);
    constexpr int kStops = 40;
    constexpr int kEnd = 600;  // the track knows no longer how it came
    const auto stopping_at = [&](int i) {
      LivePlot seen = DroneAt(std::min(i, kStops));
      seen = PlotAt(i, seen.plot.position_m + random.NormalVector(i <= kStops ? 0.0 : 0.15));
      seen.plot.num_returns = 1;
      if (i <= kStops) return seen;
      seen.log_surrounding_clutter = seen.plot.log_clutter;
      seen.plot.log_clutter = 4.0;
      seen.dwell_begin_s = DroneAt(came_with_it ? kStops : 0).time_s;
      return seen;
    };
    for (int i = 0; i < 20; ++i) t.tracks.AddInstants(FrameAt(i));
    t.Initiate(FlightUntil(20, stopping_at));
    for (int i = 20; i < kEnd; ++i) t.GoTo(i, stopping_at(i));
    const TrajectoryRow& last = t.rows.back();
    const bool has_stopped = (last.position_m - DroneAt(kStops).plot.position_m).norm() < 0.3 &&
                             last.time_ns >= FrameAt(kEnd - 12).stamp_ns;
    EXPECT_EQ(has_stopped, came_with_it) << last.position_m.transpose() << " " << t.rows.size();
  }
}

}  // namespace
}  // namespace unlidar
