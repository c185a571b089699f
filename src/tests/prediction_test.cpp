// Where confirmed tracks are predicted to be, by the sigmas that are told with it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <variant>
#include <vector>

#include "collection/body.hpp"
#include "live/confirmed_tracks.hpp"
#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::FrameAt;
using testing::kPeriodNs;
using testing::kPeriodS;
using testing::MiddleS;
using testing::Random;

using Path = std::function<Eigen::Vector3d(double time_s)>;

constexpr int kEnd = 240;     // frames
constexpr int kJudged = 60;   // from this one on
constexpr int kAhead = 3;     // frames by which a prediction is ahead of the newest plot
constexpr double kHit = 0.4;  // share of frames with a plot
constexpr double kReturnSigmaM = 0.1;

Eigen::Vector3d StraightOn(double time_s) { return {15.0, -30.0 + 3.0 * time_s, 10.0}; }

// At 4 m/s for 12 s; then it brakes by 8 m/s^2, and hovers.
Eigen::Vector3d Stop(double time_s) {
  const double braking_s = std::clamp(time_s - 12.0, 0.0, 0.5);
  return {15.0, -30.0 + 4.0 * std::min(time_s, 12.5) - 4.0 * braking_s * braking_s, 10.0};
}

Eigen::Vector3d Weave(double time_s) {
  return {15.0 + 0.6 * std::sin(2.5 * time_s), -30.0 + 3.0 * time_s, 10.0};
}

// What is seen of a sphere: the mean of three returns of the side that faces the sensor.
LivePlot PlotOf(int i, const Eigen::Vector3d& truth_m, Random* random) {
  constexpr int kReturns = 3;
  const Eigen::Vector3d centre_m =
      truth_m - FacingSideOffsetM(kReturnSigmaM, truth_m, CollectConfig().centroid_offset) +
      random->NormalVector(kCentreSigmaM);
  std::vector<Eigen::Vector3d> returns_m;
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (int k = 0; k < kReturns; ++k) {
    returns_m.push_back(centre_m + random->NormalVector(kReturnSigmaM));
    mean_m += returns_m.back() / kReturns;
  }
  LivePlot seen;
  Eigen::Matrix3d scatter_m2 = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& one_m : returns_m) {
    scatter_m2 += (one_m - mean_m) * (one_m - mean_m).transpose();
  }
  seen.scatter_m2 = SymmetricMatrix(scatter_m2);
  seen.plot.frame = static_cast<std::uint32_t>(i);
  seen.plot.time_ns = seen.plot.frame_time_ns = FrameAt(i).middle_ns();
  seen.plot.position_m = seen.plot.ray_m = mean_m;
  seen.plot.variance_m2 = 0.02;
  seen.plot.log_clutter = std::log(1e-6);
  seen.plot.num_returns = kReturns;
  seen.stamp_ns = FrameAt(i).stamp_ns;
  seen.time_s = MiddleS(i);
  return seen;
}

struct Nees {
  double mean = 0.0;
  double within95 = 0.0;  // share of predictions
};

// Of the predictions in flights that differ in what is seen of them.
Nees NeesOf(const Path& path) {
  double sum = 0.0;
  int within = 0;
  int count = 0;
  for (std::uint32_t seed = 1; seed <= testing::Draws(8U); ++seed) {
    Random random(seed);
    const Config config;
    const ScanSchedule schedule{{ScanSchedule::Sensor()}};
    const std::vector<TrackModel> models = {TrackModel(4.0, schedule, config.robust.tracker)};
    LiveTrace trace({});
    int i = 0;
    const auto judge = [&](const EngineEvent& event) {
      const auto* now = std::get_if<TrackPredicted>(&event);
      if (now == nullptr || i < kJudged) return;
      const TimeNs since_ns = now->row.time_ns - FrameAt(0).middle_ns();
      const Eigen::Vector3d truth_m = path(MiddleS(0) + static_cast<double>(since_ns) * 1e-9);
      const double nees =
          (now->row.position_m - truth_m).cwiseQuotient(now->row.sigma_m).squaredNorm();
      sum += nees;
      within += nees < 7.81 ? 1 : 0;
      ++count;
    };
    ConfirmedTracks tracks(config, models, FirstSensorStamps{}, judge, trace);
    tracks.SetPeriod(kPeriodNs);
    Flight flight;
    RecentPlots all;
    for (; i < kEnd; ++i) {
      const FrameTime at{MiddleS(i), {static_cast<std::uint32_t>(i)}};
      tracks.AddInstants(FrameAt(i));
      std::vector<LivePlot> plots;
      if (i < 10 || random.Uniform(0.0, 1.0) < kHit) {
        plots.push_back(PlotOf(i, path(MiddleS(i)), &random));
      }
      for (const LivePlot& seen : plots) all.push_back(seen);
      if (i < 10) {
        flight.plots.push_back(plots.front());
        flight.frame_times.push_back(at);
        if (i == 9) tracks.Initiate(flight);
      } else {
        tracks.Extend(plots, at);
      }
      tracks.Judge(all, MiddleS(i));
      tracks.EmitRows(FrameAt(i).middle_ns(), FrameAt(i).stamp_ns);
      tracks.Predict(FrameAt(i + kAhead).stamp_ns);
    }
  }
  EXPECT_GT(count, 100);
  return {sum / count, static_cast<double>(within) / count};
}

TEST(Prediction, SigmasAreTrueWhereATargetWeaves) {
  const Nees nees = NeesOf(Weave);
  EXPECT_GT(nees.mean, 2.0);
  EXPECT_LT(nees.mean, 4.0);
  EXPECT_GT(nees.within95, 0.9);
}

// The fit, whose agility is that of seconds of calm flight, states sigmas with which it is 11.
TEST(Prediction, SigmasAreTrueWhereATargetStops) {
  const Nees nees = NeesOf(Stop);
  EXPECT_GT(nees.mean, 2.0);
  EXPECT_LT(nees.mean, 5.0);
  EXPECT_GT(nees.within95, 0.9);
}

// Nothing tells that it will go on as straight as it did.
TEST(Prediction, SigmasAllowForAStraightFlightToTurn) {
  const Nees nees = NeesOf(StraightOn);
  EXPECT_GT(nees.mean, 1.0);
  EXPECT_LT(nees.mean, 3.0);
}

}  // namespace
}  // namespace unlidar
