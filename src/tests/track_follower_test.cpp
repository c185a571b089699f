#include "live/track_follower.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <vector>

#include "base/maths.hpp"
#include "tests/synthetic_recording.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {
namespace {

using testing::Random;

constexpr TimeNs kPeriodNs = 100'000'000;
constexpr double kPeriodS = 0.1;
const Eigen::Vector3d kStrayM(60.0, 10.0, 40.0);

// A drone of 2 m/s that is seen in every frame until frame 30, and from frame 150 on: longer apart
// than max_gap_s.
Eigen::Vector3d DroneM(int i) { return {15.0, -10.0 + 0.2 * i, 8.0}; }

FollowedPlot PlotAt(int i, const Eigen::Vector3d& position_m) {
  FollowedPlot followed;
  Plot& plot = followed.seen.plot;
  plot.frame = static_cast<std::uint32_t>(i);
  plot.time_ns = plot.frame_time_ns = i * kPeriodNs;
  plot.position_m = plot.ray_m = position_m;
  plot.variance_m2 = 0.02;
  plot.lowest_m = 10.0;
  plot.log_clutter = -13.0;
  plot.num_returns = 2;
  followed.seen.time_s = i * kPeriodS;
  followed.at = {i * kPeriodS, {static_cast<std::uint32_t>(i)}};
  return followed;
}

class TrackFollowerTest : public ::testing::Test {
 protected:
  TrackFollowerTest() : scan_schedule_{{ScanSchedule::Sensor()}} {
    scan_schedule_.sensors[0].frame_s = kPeriodS;
    models_.emplace_back(3.0, scan_schedule_, config_.tracker);
    for (int i = 0; i <= 30; ++i) Append(PlotAt(i, DroneM(i)));
    std::vector<const Plot*> path;
    for (const LivePlot& seen : flight_.plots) path.push_back(&seen.plot);
    confirmed_ = FilterPath(models_[0], path, flight_.frame_times, 0.0, config_.tracker).back();
  }

  void Append(const FollowedPlot& followed) {
    flight_.plots.push_back(followed.seen);
    flight_.frame_times.push_back(followed.at);
  }

  // Score of the way through these plots, by the model that judges ways.
  double Score(const std::vector<FollowedPlot>& plots) const {
    const TrackModel judge = models_[0].With(TimeOutOfView::kLogUniform);
    Hypothesis h = confirmed_;
    for (const FollowedPlot& one : plots) h = judge.PredictAndUpdate(h, one.seen.plot, one.at);
    return h.score;
  }

  std::vector<std::size_t> Kept(const std::vector<FollowedPlot>& plots) const {
    std::vector<std::size_t> kept;
    std::vector<FollowedPlot> way;
    for (const auto& [i, hypothesis] : RejoinedPlots(models_[0], confirmed_, plots)) {
      kept.push_back(i);
      way.push_back(plots[i]);
      EXPECT_DOUBLE_EQ(hypothesis.score, Score(way));
    }
    EXPECT_GE(Score(way), Score(plots));
    return kept;
  }

  RobustConfig config_;
  ScanSchedule scan_schedule_;
  std::vector<TrackModel> models_;
  Flight flight_;
  Hypothesis confirmed_;
};

// A flat body, of which each frame has returns over a tenth of a second of its flight.
TEST_F(TrackFollowerTest, ItsBodyIsAsWideAsItsReturnsLieButForItsMotion) {
  constexpr double kWidthM = 0.1;
  constexpr double kHeightM = 0.02;
  constexpr int kReturns = 20;
  const Eigen::Vector3d velocity_mps = (DroneM(1) - DroneM(0)) / kPeriodS;
  Random random(4);
  for (LivePlot& seen : flight_.plots) {
    const Eigen::Vector3d across = Eigen::Vector3d::UnitZ().cross(seen.plot.ray_m).normalized();
    Eigen::Matrix<double, 4, kReturns> returns;  // offsets and times
    for (int k = 0; k < kReturns; ++k) {
      const double after_s = random.Uniform(-0.5 * kPeriodS, 0.5 * kPeriodS);
      const Eigen::Vector3d offset_m =
          random.Normal(kWidthM) * across + random.Normal(kHeightM) * Eigen::Vector3d::UnitZ();
      returns.col(k) << offset_m + after_s * velocity_mps, after_s;
    }
    returns.colwise() -= returns.rowwise().mean().eval();
    const Eigen::Matrix4d squares = returns * returns.transpose();
    seen.plot.num_returns = kReturns;
    seen.scatter_m2 = SymmetricMatrix(squares.topLeftCorner<3, 3>());
    seen.time_covariance_ms = squares.topRightCorner<3, 1>().cast<float>();
    seen.time_scatter_s2 = static_cast<float>(squares(3, 3));
  }
  TrackFollower follower(flight_, models_, config_);
  std::vector<LivePlot> settled;
  follower.Settle(30 * kPeriodNs, &settled);
  EXPECT_NEAR(follower.common_errors().depth_sigma_m / 0.5, kWidthM, 0.008);
}

TEST_F(TrackFollowerTest, OfABallThatHoversTheCentreIsFollowed) {
  constexpr double kRadiusM = 0.2;
  constexpr int kReturns = 30;
  const Eigen::Vector3d centre_m = DroneM(40);
  const Eigen::Vector3d ray = centre_m.normalized();
  Random random(4);
  Flight flight;
  for (int i = 0; i <= 30; ++i) {
    Eigen::Matrix<double, 3, kReturns> returns_m;
    for (int k = 0; k < kReturns; ++k) returns_m.col(k) = random.OnFacingSide(kRadiusM, ray);
    FollowedPlot one = PlotAt(i, centre_m + returns_m.rowwise().mean());
    returns_m.colwise() -= returns_m.rowwise().mean().eval();
    for (int k = 0; k < kReturns; ++k)
      one.seen.facing_sums.Add(RayAxes(ray).transpose() * returns_m.col(k));
    one.seen.scatter_m2 = SymmetricMatrix(returns_m * returns_m.transpose());
    one.seen.plot.num_returns = kReturns;
    one.seen.plot.beam_step_m = 0.1F;
    flight.plots.push_back(one.seen);
    flight.frame_times.push_back(one.at);
  }
  const auto nearer_m = [&](const std::vector<Rule>& disabled_rules) {
    config_.disabled_rules = disabled_rules;
    TrackFollower follower(flight, models_, config_);
    std::vector<LivePlot> settled;
    follower.Settle(20 * kPeriodNs, &settled);
    TrajectoryFitter fitter{TrajectoryConfig()};
    follower.Fit(fitter);
    EXPECT_NEAR(follower.common_errors().elevation_sigma_m, 0.1 / std::sqrt(12.0), 1e-6);
    const Eigen::Vector3d place_m = follower.fit().trajectory().At(25 * kPeriodNs).position_m;
    return (centre_m - place_m).dot(ray);
  };
  EXPECT_NEAR(nearer_m({}), 0.0, 0.02);
  EXPECT_NEAR(nearer_m({Rule::kRoundBodies}), (2.0 / 3.0 - 0.4 / 2.0) * kRadiusM, 0.02);
}

TEST_F(TrackFollowerTest, AStrayThatBridgedTheGapIsLeftOut) {
  EXPECT_EQ(Kept({PlotAt(90, kStrayM), PlotAt(150, DroneM(150)), PlotAt(151, DroneM(151))}),
            (std::vector<std::size_t>{1, 2}));
}

TEST_F(TrackFollowerTest, SightingsOnTheWayAreKept) {
  EXPECT_EQ(Kept({PlotAt(90, DroneM(90)), PlotAt(91, DroneM(91)), PlotAt(150, DroneM(150))}),
            (std::vector<std::size_t>{0, 1, 2}));
}

TEST_F(TrackFollowerTest, NoOtherRunAloneLowersTheScoreOfTheWay) {
  Random random(4);
  for (int draw = 0; draw < 200; ++draw) {
    std::vector<FollowedPlot> plots;
    for (int i = 35 + static_cast<int>(random.Index(20)); i < 140;
         i += 6 + static_cast<int>(random.Index(40))) {
      plots.push_back(PlotAt(i, DroneM(i) + random.NormalVector(random.Uniform(0.1, 20.0))));
    }
    plots.push_back(PlotAt(150, DroneM(150)));
    const std::vector<std::size_t> kept = Kept(plots);
    ASSERT_EQ(kept.back(), plots.size() - 1);
    std::vector<FollowedPlot> way;
    for (const std::size_t i : kept) way.push_back(plots[i]);
    for (std::size_t k = 0; k + 1 < way.size(); ++k) {
      std::vector<FollowedPlot> without = way;
      without.erase(without.begin() + static_cast<std::ptrdiff_t>(k));
      EXPECT_LE(Score(without), Score(way) + kMinExchangeLog);
    }
  }
}

// The follower's rows between both parts of the flight rest on its own plots alone.
TEST_F(TrackFollowerTest, AFollowerThatReacquiresDropsTheStrayThatLedThere) {
  TrackFollower follower(flight_, models_, config_);
  const auto extend = [&](int i, const Eigen::Vector3d& place_m) {
    const FollowedPlot followed = PlotAt(i, place_m);
    follower.Extend({followed.seen}, {1}, followed.at);
  };
  extend(90, kStrayM);
  for (int i = 150; i < 170; ++i) extend(i, DroneM(i));
  std::vector<LivePlot> settled;
  follower.Settle(170 * kPeriodNs, &settled);
  EXPECT_EQ(settled.size(), 31U + 20U);
  for (const LivePlot& seen : settled) {
    EXPECT_NE(seen.plot.position_m, kStrayM) << seen.time_s;
  }
}

// The likeliest model of a long calm flight is the calmest one, which cannot follow a turn.
TEST_F(TrackFollowerTest, ACalmTargetMayTurn) {
  for (const bool may_change : {true, false}) {
    RobustConfig config;
    if (!may_change) config.disabled_rules.push_back(Rule::kAgilityChange);
    std::vector<TrackModel> models;
    for (const double sigma_a_mps2 : config.tracker.sigma_a_mps2) {
      models.emplace_back(sigma_a_mps2, scan_schedule_, config.tracker);
    }
    TrackFollower follower(flight_, models, config);
    constexpr int kTurn = 600;
    constexpr int kLast = 640;
    const auto place_m = [](int i) -> Eigen::Vector3d {
      if (i <= kTurn) return DroneM(i);
      const double radius_m = 1.0;  // at 4 m/s: 16 m/s^2
      const double angle = 4.0 * kPeriodS * (i - kTurn);
      return DroneM(kTurn) +
             radius_m * Eigen::Vector3d(1.0 - std::cos(angle), std::sin(angle), 0.0);
    };
    for (int i = 31; i <= kLast; ++i) {
      FollowedPlot followed = PlotAt(i, place_m(i));
      followed.seen.plot.variance_m2 = 0.005;
      follower.Extend({followed.seen}, {1}, followed.at);
    }
    const TimeNs last_ns = PlotAt(kLast, place_m(kLast)).seen.plot.time_ns;
    EXPECT_EQ(follower.last_evidence_ns() == last_ns, may_change);
  }
}

// Nodes that lead nowhere are forgotten with each row that settles plots, of a track that is not
// seen meanwhile, too.
TEST_F(TrackFollowerTest, ATrackKnowsWhenItWasLastSeenAfterItForgets) {
  TrackFollower follower(flight_, models_, config_);
  constexpr int kLast = 600;
  std::vector<LivePlot> settled;
  for (int i = 31; i <= kLast; ++i) {
    const FollowedPlot followed = PlotAt(i, DroneM(i));
    follower.Extend({followed.seen}, {1}, followed.at);
  }
  for (int until = kLast - 30; until <= kLast - 5; ++until) {
    follower.Settle(PlotAt(until, DroneM(until)).seen.plot.frame_time_ns, &settled);
    EXPECT_EQ(follower.last_evidence_ns(), PlotAt(kLast, DroneM(kLast)).seen.plot.time_ns) << until;
  }
}

}  // namespace
}  // namespace unlidar
