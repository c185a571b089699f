#include "scene/plots.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <set>
#include <vector>

#include "scene/floating.hpp"
#include "scene/multi_station_plots.hpp"
#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;

constexpr int kDrone = 1;
constexpr int kBody = 2;
constexpr int kFarSide = 3;
constexpr double kGround_m = -1.5;

struct Found {
  std::vector<Plot> plots;
  std::vector<char> is_body;
  std::size_t num_candidates;
};

// Of what no structure explains and is no ground.
Found FindPlots(const Recording& recording, const RobustConfig& config = RobustConfig()) {
  const MultiStationPlots found(recording, Stations(recording.sensors), config);
  return {found.plots(), found.are_bodies(), found.num_unexplained()};
}

// Six seconds of level ground; `fill` adds what moves.
RecordingMaker OnGround(const std::function<void(double time_s, RecordingMaker*)>& fill) {
  RecordingMaker maker(1);
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddGround(kGround_m, 20.0, 1500);
    fill(MiddleS(i), &maker);
  }
  return maker;
}

// Share of the returns with a label that are in a plot, and that were taken for a body's.
double ShareInPlots(const RecordingMaker& maker, const Found& found, int label) {
  double in_plots = 0.0;
  for (const Plot& plot : found.plots) {
    for (const std::uint32_t i : plot.returns) in_plots += maker.labels[i] == label ? 1.0 : 0.0;
  }
  return in_plots /
         static_cast<double>(std::count(maker.labels.begin(), maker.labels.end(), label));
}

double ShareOfBodies(const RecordingMaker& maker, const Found& found, int label) {
  double all = 0.0;
  double bodies = 0.0;
  for (std::size_t i = 0; i < maker.labels.size(); ++i) {
    if (maker.labels[i] != label) continue;
    all += 1.0;
    bodies += found.is_body[i] != 0 ? 1.0 : 0.0;
  }
  return bodies / all;
}

// A box that stands on the ground (or is cut off below `from_m`) and drives along y.
void AddStanding(const Eigen::Vector3d& middle_m, const Eigen::Vector3d& size_m, double from_m,
                 int count, RecordingMaker* maker) {
  Eigen::Vector3d low = middle_m - 0.5 * size_m;
  Eigen::Vector3d high = middle_m + 0.5 * size_m;
  low.z() = std::max(kGround_m, from_m);
  high.z() = kGround_m + size_m.z();
  maker->AddBox(low, high, count, kBody);
}

using Groups = std::set<std::vector<std::uint32_t>>;

// Single linkage: points nearer than the radius at their range are in one group.
Groups LinkedByBruteForce(const std::vector<Eigen::Vector3f>& points_m, const RangeRadius& radius) {
  std::vector<std::uint32_t> label(points_m.size());
  for (std::uint32_t i = 0; i < label.size(); ++i) label[i] = i;
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double reach_m = radius.At(static_cast<double>(points_m[i].norm()));
      if (static_cast<double>((points_m[i] - points_m[j]).norm()) >= reach_m) continue;
      const std::uint32_t from = label[i];
      std::replace(label.begin(), label.end(), from, label[j]);
    }
  }
  std::vector<std::vector<std::uint32_t>> members(points_m.size());
  for (std::uint32_t i = 0; i < label.size(); ++i) members[label[i]].push_back(i);
  Groups groups(members.begin(), members.end());
  groups.erase(std::vector<std::uint32_t>());
  return groups;
}

// Whether two points are linked or not depends on whose range sets the radius.
bool IsAmbiguous(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const RangeRadius& radius) {
  const double at_a = radius.At(static_cast<double>(a.norm()));
  const double at_b = radius.At(static_cast<double>(b.norm()));
  const auto distance_m = static_cast<double>((a - b).norm());
  return distance_m > 0.999 * std::min(at_a, at_b) && distance_m < 1.001 * std::max(at_a, at_b);
}

TEST(Plots, AreTheSingleLinkageOfTheReturnsOfAFrame) {
  RobustConfig config;
  config.disabled_rules = {Rule::kBodies};
  for (const double half_m : {4.0, 8.0, 40.0}) {
    RecordingMaker maker(7);
    Recording& recording = maker.recording;
    for (int i = 0; i < 60; ++i) {
      maker.BeginFrame(i * kPeriodS);
      if (i != 30) continue;
      while (recording.points_m.size() < 300) {
        const Eigen::Vector3d p =
            maker.random.InBox({10, -half_m, 5}, {10 + 2 * half_m, half_m, 5 + half_m});
        if (std::none_of(recording.points_m.begin(), recording.points_m.end(),
                         [&](const Eigen::Vector3f& q) {
                           return IsAmbiguous(p.cast<float>(), q, config.plots.link);
                         })) {
          maker.Add(p);
        }
      }
    }
    const Found found = FindPlots(recording, config);
    Groups groups;
    for (const Plot& plot : found.plots) {
      std::vector<std::uint32_t> group(plot.returns.begin(), plot.returns.end());
      std::sort(group.begin(), group.end());
      groups.insert(group);
    }
    EXPECT_EQ(groups, LinkedByBruteForce(recording.points_m, config.plots.link));
    EXPECT_EQ(groups.size(), found.plots.size());
    EXPECT_GT(groups.size(), 5U);
  }
}

TEST(Plots, SayWhereAndWhenTheirReturnsWere) {
  RecordingMaker maker(8);
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddGround(kGround_m, 20.0, 1500);
    const TimeNs begin_ns = maker.recording.frames.back().begin_ns;
    for (int k = 0; k < 1 + i % 4; ++k) {
      maker.AddAt(begin_ns + k * 20'000'000,
                  Eigen::Vector3d(10.0, 0.5 * i, 8.0) + maker.random.NormalVector(0.05), kDrone);
    }
  }
  const Recording& recording = maker.recording;
  std::vector<Plot> plots = FindPlots(recording).plots;
  plots.erase(std::remove_if(
                  plots.begin(), plots.end(),
                  [&](const Plot& plot) { return maker.labels[plot.returns.front()] != kDrone; }),
              plots.end());
  ASSERT_EQ(plots.size(), 60U);
  std::vector<double> variances(5, 0.0);
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const Plot& plot = plots[i];
    EXPECT_EQ(plot.frame, i);
    ASSERT_EQ(plot.returns.size(), 1 + i % 4);
    Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
    double time_s = 0.0;
    double lowest_m = std::numeric_limits<double>::infinity();
    for (const std::uint32_t r : plot.returns) {
      const auto n = static_cast<double>(plot.returns.size());
      mean_m += recording.points_m[r].cast<double>() / n;
      time_s += testing::SecondsSinceBegin(recording.times_ns[r]) / n;
      lowest_m = std::min(lowest_m, static_cast<double>(recording.points_m[r].z()) - kGround_m);
    }
    EXPECT_LT((plot.position_m - mean_m).norm(), 1e-5);
    EXPECT_NEAR(testing::SecondsSinceBegin(plot.time_ns), time_s, 2e-9);
    EXPECT_NEAR(plot.lowest_m, lowest_m, 0.1);
    variances[plot.returns.size()] = plot.variance_m2;
  }
  EXPECT_TRUE(std::is_sorted(variances.rbegin(), variances.rend() - 1));
}

constexpr double kHighM = 3.0;

TEST(Plots, CountWhatIsBelowThem) {
  const RecordingMaker maker = OnGround([](double time_s, RecordingMaker* scene) {
    for (const double x_m : {6.0, 12.0, 18.0}) {
      const Eigen::Vector3d at_m(x_m, 2.0 * time_s - 6.0, kGround_m + kHighM);
      scene->AddBlob(at_m, 0.05, 1 + scene->random.Poisson(2.0), kDrone);
      scene->AddBox(at_m - Eigen::Vector3d(1.5, 1.5, kHighM), at_m + Eigen::Vector3d(1.5, 1.5, 0.0),
                    30);
    }
  });
  const Recording& recording = maker.recording;
  RobustConfig config;
  config.disabled_rules = {Rule::kBodies};
  const Found found = FindPlots(recording, config);
  std::size_t num_plots = 0;
  std::size_t num_all = 0;
  for (const Plot& plot : found.plots) {
    if (plot.position_m.z() < kGround_m + kHighM - 0.2) continue;
    ++num_plots;
    const FrameInfo& frame = recording.frames[plot.frame];
    std::uint32_t num_below = 0;
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      const Eigen::Vector3d d = recording.points_m[i].cast<double>() - plot.position_m;
      const bool is_in_column = d.head<2>().norm() < 0.6 + 0.005 * plot.position_m.norm();
      if (is_in_column && d.z() < -0.4 && recording.points_m[i].z() > kGround_m + 0.25) ++num_below;
    }
    EXPECT_NEAR(plot.num_below, num_below, 1.0);  // the ground is estimated
    num_all += num_below;
  }
  EXPECT_GT(num_plots, 100U);
  EXPECT_GT(num_all, 2 * num_plots);
}

// The top of a car 20 m away, 1.2 m above the ground, on one of the cones that spinning beams
// sweep. The next one is 0.1 degrees below it, or 0.28 m above the ground there, as of rays below
// a car, or meets the ground before it.
TEST(Plots, SayWhetherAnyBeamLooksBelowThem) {
  for (const double step_deg : {0.1, 2.63, 4.0}) {
    RecordingMaker maker(1);
    for (int i = 0; i < 60; ++i) {
      maker.BeginFrame(i * kPeriodS);
      const double top_deg = std::atan2(-0.3, 20.0) * 180.0 / M_PI;
      for (double down_deg = top_deg - step_deg; down_deg > -40.0; down_deg -= step_deg) {
        const double range_m = kGround_m / std::tan(down_deg * M_PI / 180.0);
        for (int k = 0; k < (step_deg < 1.0 ? 10 : 400); ++k) {
          const double azimuth = maker.random.Uniform(-M_PI, M_PI);
          maker.Add({range_m * std::cos(azimuth), range_m * std::sin(azimuth), kGround_m});
        }
      }
      const double azimuth = 0.04 * i - 1.2;
      for (const double beside : {0.0, 0.005, 0.01, 0.015}) {
        maker.Add({20.0 * std::cos(azimuth + beside), 20.0 * std::sin(azimuth + beside), -0.3},
                  kDrone);
      }
    }
    const Found found = FindPlots(maker.recording);
    ASSERT_GT(found.plots.size(), 50U) << step_deg;
    for (const Plot& plot : found.plots) {
      EXPECT_NEAR(plot.watched_below, step_deg < 1.0 ? 1.0 : 0.0, 0.1) << step_deg;
    }
  }
}

// A sensor that looks up from 2 degrees below the horizon at a wall, beyond which there is no
// ground, or at crowns of trees that begin higher, and at the head of a walker, or a drone three
// degrees above that edge: it may be lower than nearly all returns.
TEST(Plots, OfWhatTheEdgeOfTheViewCutsOffWhereNoGroundIsSeenAreABody) {
  constexpr double kEdgeRad = -0.035;
  for (const double scene_from_edge_rad : {0.0, 0.1}) {
    for (const double from_edge_rad : {0.0, 0.05}) {
      RecordingMaker maker(3);
      const auto add_towards = [&](double azimuth_rad, double elevation_rad) {
        maker.Add(25.0 * Eigen::Vector3d(std::cos(azimuth_rad) * std::cos(elevation_rad),
                                         std::sin(azimuth_rad) * std::cos(elevation_rad),
                                         std::sin(elevation_rad)));
      };
      for (int i = 0; i < 60; ++i) {
        maker.BeginFrame(i * kPeriodS);
        add_towards(0.2, kEdgeRad);
        for (int k = 0; k < 1500; ++k) {
          const double azimuth_rad = maker.random.Uniform(-0.25, 0.25);
          add_towards(azimuth_rad, maker.random.Uniform(kEdgeRad + scene_from_edge_rad, 0.4));
        }
        const double low_m = 10.0 * std::tan(kEdgeRad + from_edge_rad);
        const double y_m = MiddleS(i) - 2.0;
        maker.AddBox({10.0, y_m - 0.2, low_m}, {10.1, y_m + 0.2, low_m + 0.3}, 30, kBody);
      }
      const Found found = FindPlots(maker.recording);
      EXPECT_NEAR(ShareOfBodies(maker, found, kBody), from_edge_rad == 0.0 ? 1.0 : 0.0, 0.1)
          << scene_from_edge_rad;
    }
  }
}

// A low drone 20 m away, before a wall 30 m away, once it has passed one 10 m away.
TEST(Plots, CountWhatIsInLineWithTheEmptyColumnsBelowThem) {
  constexpr double kDroneRangeM = 20.0;
  constexpr double kHeightM = 1.4;
  const RecordingMaker maker = OnGround([&](double time_s, RecordingMaker* scene) {
    const double y_m = 2.0 * time_s - 6.0;
    scene->AddBlob({kDroneRangeM, y_m, kGround_m + kHeightM}, 0.05, 4, kDrone);
    scene->AddBox({30.0, -30.0, kGround_m}, {30.1, 30.0, kGround_m + 3.0}, 400);
    scene->AddBox({10.0, -30.0, kGround_m}, {10.1, 0.0, kGround_m + 1.5}, 400);
  });
  const Recording& recording = maker.recording;
  const Found found = FindPlots(recording);
  std::size_t num_before = 0;
  std::size_t num_behind = 0;
  for (const Plot& plot : found.plots) {
    if (std::abs(plot.position_m.x() - kDroneRangeM) > 0.5 || plot.num_below > 0) continue;
    const FrameInfo& frame = recording.frames[plot.frame];
    const double radius_m = 0.6 + 0.005 * plot.position_m.norm();
    const double range_m = plot.position_m.head<2>().norm();
    std::uint32_t before = 0;
    std::uint32_t behind = 0;
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      // The line of sight through the return, where it is as far as the plot.
      const Eigen::Vector3d point_m = recording.points_m[i].cast<double>();
      const Eigen::Vector2d toward = plot.position_m.head<2>() / range_m;
      const double along_m = point_m.head<2>().dot(toward);
      if (along_m <= 0.0) continue;
      const Eigen::Vector3d at_m = point_m * range_m / along_m;
      if ((at_m - plot.position_m).head<2>().norm() >= radius_m) continue;
      const double height_m = at_m.z() - kGround_m;
      if (at_m.z() > plot.position_m.z() - 0.4 || height_m < 0.25) continue;
      before += along_m < range_m - radius_m ? 1 : 0;
      behind += along_m > range_m + radius_m ? 1 : 0;
    }
    EXPECT_NEAR(plot.num_before_below, before, 2.0);  // the ground is estimated
    EXPECT_NEAR(plot.num_behind_below, behind, 2.0);
    num_before += before;
    num_behind += behind;
  }
  EXPECT_GT(num_before, 50U);
  EXPECT_GT(num_behind, 50U);
}

TEST(Plots, ComeFrameByFrameAlsoWhereFramesOfTwoSensorsOverlap) {
  RecordingMaker maker(9, 2);
  for (int i = 0; i < 120; ++i) {
    const double begin_s = 0.5 * i * kPeriodS;
    maker.BeginFrame(begin_s, static_cast<std::uint32_t>(i % 2));
    const TimeNs begin_ns = maker.recording.frames.back().begin_ns;
    for (int k = 0; k < 5; ++k) {  // far apart: a plot each
      maker.AddAt(begin_ns + k * 20'000'000, {12.0, 4.0 * k - 8.0, 5.0 + 0.2 * i}, kDrone);
    }
  }
  const Found found = FindPlots(maker.recording);
  ASSERT_EQ(found.plots.size(), 600U);
  EXPECT_TRUE(std::is_sorted(found.plots.begin(), found.plots.end(),
                             [](const Plot& a, const Plot& b) { return a.frame < b.frame; }));
  EXPECT_TRUE(std::is_sorted(
      found.plots.begin(), found.plots.end(),
      [](const Plot& a, const Plot& b) { return a.frame_time_ns < b.frame_time_ns; }));
}

TEST(Plots, LeaveAStreakOnlyWhereReturnsHaveNoTimesOfTheirOwn) {
  for (const bool is_timed : {false, true}) {
    RecordingMaker maker(9, 1);
    for (int i = 0; i < 20; ++i) {
      maker.BeginFrame(i * kPeriodS, 0);
      maker.recording.frames.back().is_timed = is_timed;
      maker.AddAt(maker.recording.frames.back().begin_ns, {12.0, 0.3 * i, 5.0}, kDrone);
    }
    const Found found = FindPlots(maker.recording);
    ASSERT_EQ(found.plots.size(), 20U);
    for (const Plot& plot : found.plots) EXPECT_EQ(plot.streak_s, is_timed ? 0.0 : kPeriodS);
  }
}

TEST(Plots, WalkersAndCarsAreBodies) {
  const Eigen::Vector3d person_m(0.5, 0.5, 1.75);
  const Eigen::Vector3d car_m(1.8, 4.4, 1.5);
  const RecordingMaker walker = OnGround([&](double time_s, RecordingMaker* maker) {
    AddStanding({8.0, 1.4 * time_s - 4.0, 0.0}, person_m, kGround_m, 20, maker);
  });
  const RecordingMaker car = OnGround([&](double time_s, RecordingMaker* maker) {
    AddStanding({12.0, 8.0 * (time_s - 3.0), 0.0}, car_m, kGround_m, 60, maker);
  });
  for (const RecordingMaker* maker : {&walker, &car}) {
    const Found found = FindPlots(maker->recording);
    EXPECT_GT(ShareOfBodies(*maker, found, kBody), 0.7);  // feet and wheels are ground
    EXPECT_LT(ShareInPlots(*maker, found, kBody), 0.01);
  }
}

TEST(Plots, AWalkerWhoseLegsAreBelowTheFieldOfViewIsABody) {
  // The sensor sees down to -7 degrees: at 5 m that is 0.9 m above the ground, at 6 m 0.76 m.
  constexpr double kLowest_rad = -7.0 * M_PI / 180.0;
  RecordingMaker maker(10);
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    for (int k = 0; k < 1500; ++k) {
      const double range_m = maker.random.Uniform(13.0, 40.0);
      const double azimuth = maker.random.Uniform(-M_PI, M_PI);
      maker.Add({range_m * std::cos(azimuth), range_m * std::sin(azimuth), kGround_m});
    }
    const double x = 3.7;
    const double y = 1.4 * (MiddleS(i) - 3.0);
    const double edge_m = std::tan(kLowest_rad) * std::hypot(x, y);
    AddStanding({x, y, 0.0}, {0.3, 0.5, 1.75}, edge_m, 20, &maker);
  }
  const Found found = FindPlots(maker.recording);
  EXPECT_GT(ShareOfBodies(maker, found, kBody), 0.95);
  EXPECT_LT(ShareInPlots(maker, found, kBody), 0.01);
}

TEST(Plots, ADroneAtThreeMetresAndAFastStreakAreNoBodies) {
  const RecordingMaker low = OnGround([](double time_s, RecordingMaker* maker) {
    maker->AddBlob({8.0, 1.5 * (time_s - 3.0), kGround_m + 3.0}, 0.12, 20, kDrone);
  });
  const RecordingMaker fast = OnGround([](double time_s, RecordingMaker* maker) {
    for (int k = 0; k < 20; ++k) {  // 2.5 m within the frame
      const double at_s = time_s + maker->random.Uniform(-0.5, 0.5) * kPeriodS;
      maker->Add(Eigen::Vector3d(15.0, 25.0 * (at_s - 3.0), 8.0) + maker->random.NormalVector(0.12),
                 kDrone);
    }
  });
  for (const RecordingMaker* maker : {&low, &fast}) {
    const Found found = FindPlots(maker->recording);
    EXPECT_EQ(ShareOfBodies(*maker, found, kDrone), 0.0);
    EXPECT_EQ(ShareInPlots(*maker, found, kDrone), 1.0);
  }
}

TEST(Plots, WhatIsWideInTwoDirectionsIsABodyAlsoWithoutAGround) {
  const auto fly = [](const Eigen::Vector3d& half_m) {
    RecordingMaker maker(11);
    for (int i = 0; i < 60; ++i) {
      maker.BeginFrame(i * kPeriodS);
      const Eigen::Vector3d at(15.0, 8.0 * (MiddleS(i) - 3.0), 6.0);
      maker.AddBox(at - half_m, at + half_m, 100, kBody);
    }
    return maker;
  };
  const RecordingMaker sheet = fly({0.1, 2.0, 2.0});
  EXPECT_EQ(ShareOfBodies(sheet, FindPlots(sheet.recording), kBody), 1.0);
  const RecordingMaker pole = fly({0.1, 2.0, 0.1});
  EXPECT_EQ(ShareOfBodies(pole, FindPlots(pole.recording), kBody), 0.0);
}

TEST(Plots, TheFarSideOfABusGoesWithItButNotADroneAboveIt) {
  const RecordingMaker maker = OnGround([](double time_s, RecordingMaker* m) {
    const double y = 6.0 * (time_s - 3.0);
    m->AddBox({10.0, y - 5.0, kGround_m}, {10.1, y + 5.0, kGround_m + 3.0}, 300, kBody);
    m->AddBox({12.4, y - 5.0, kGround_m + 2.9}, {12.5, y + 5.0, kGround_m + 3.0}, 1, kFarSide);
    m->AddBlob({11.0, y, kGround_m + 11.0}, 0.1, 5, kDrone);
  });
  const Found found = FindPlots(maker.recording);
  EXPECT_LT(ShareInPlots(maker, found, kBody), 0.01);
  EXPECT_LT(ShareInPlots(maker, found, kFarSide), 0.05);
  EXPECT_EQ(ShareInPlots(maker, found, kDrone), 1.0);
}

TEST(Plots, ABodysMarginIsItsLengthSidewaysAndItsHeightUp) {
  // A flat load, 20 m long.
  const RecordingMaker maker = OnGround([](double time_s, RecordingMaker* m) {
    const double y = 10.0 * (time_s - 3.0);
    m->AddBox({11.0, y - 10.0, kGround_m + 0.5}, {12.0, y + 10.0, kGround_m + 0.9}, 300, kBody);
    m->AddBlob({11.5, y + 15.0, kGround_m + 1.1}, 0.02, 1, kFarSide);
    m->AddBlob({11.5, y, kGround_m + 5.8}, 0.1, 5, kDrone);
  });
  const Found found = FindPlots(maker.recording);
  EXPECT_GT(ShareOfBodies(maker, found, kBody), 0.9);
  EXPECT_LT(ShareOfBodies(maker, found, kFarSide), 0.1);  // it is only near to one
  EXPECT_LT(ShareInPlots(maker, found, kFarSide), 0.05);
  EXPECT_EQ(ShareInPlots(maker, found, kDrone), 1.0);
}

TEST(Plots, EveryCandidateIsOnceABodyOrInAPlotIfNoneIsNextToABody) {
  const RecordingMaker maker = OnGround([](double time_s, RecordingMaker* m) {
    m->AddBlob({8.0, 2.0 * (time_s - 3.0), 4.0}, 0.1, 5, kDrone);
    m->AddBox({-30, -30, 1}, {30, 30, 30}, 10);
  });
  const Found found = FindPlots(maker.recording);
  std::vector<std::uint32_t> held;
  for (const Plot& plot : found.plots) {
    held.insert(held.end(), plot.returns.begin(), plot.returns.end());
  }
  for (std::uint32_t i = 0; i < found.is_body.size(); ++i) {
    if (found.is_body[i] != 0) held.push_back(i);
  }
  std::sort(held.begin(), held.end());
  EXPECT_EQ(std::adjacent_find(held.begin(), held.end()), held.end());
  EXPECT_EQ(held.size(), found.num_candidates);
  EXPECT_GT(held.size(), 500U);
}

TEST(Plots, ADroneAmongStraysIsNoPartOfABodyThatTheyMake) {
  const RecordingMaker maker = OnGround([](double time_s, RecordingMaker* m) {
    m->AddBlob({14.0, 3.0 * (time_s - 3.0), 9.0}, 0.1, 5, kDrone);
    m->AddBox({4.0, -14.0, 2.0}, {20.0, 14.0, 14.0}, 500);  // 0.09 in a cubic metre
  });
  RobustConfig config;
  const double share = ShareInPlots(maker, FindPlots(maker.recording, config), kDrone);
  config.disabled_rules = {Rule::kStrays};
  const double share_without = ShareInPlots(maker, FindPlots(maker.recording, config), kDrone);
  EXPECT_GT(share, 0.4);
  EXPECT_LT(share_without, 0.1);
}

TEST(Plots, WhereStraysAreDenseSeveralReturnsOfADroneAreAPlot) {
  const RecordingMaker maker = OnGround([](double time_s, RecordingMaker* m) {
    m->AddBlob({14.0, 3.0 * (time_s - 3.0), 9.0}, 0.1, 8, kDrone);
    m->AddBox({4.0, -14.0, 2.0}, {20.0, 14.0, 14.0}, 2000);  // 0.37 in a cubic metre
  });
  RobustConfig config;
  const Found found = FindPlots(maker.recording, config);
  config.disabled_rules = {Rule::kStrayGroups};
  const Found without = FindPlots(maker.recording, config);
  EXPECT_GT(ShareInPlots(maker, found, kDrone), ShareInPlots(maker, without, kDrone) + 0.3);
}

// What comes to a spot beyond that is a static object, as a crown among strays is.
TEST(Plots, GroupsOfDenseStraysAreAsManyAsTheirPlotsSay) {
  const Eigen::Vector3d low_m(4.0, -14.0, 2.0);
  const Eigen::Vector3d high_m(20.0, 14.0, 14.0);
  const RecordingMaker maker = OnGround(
      [&](double, RecordingMaker* m) { m->AddBox(low_m, high_m, 2000); });  // 0.37 in a cubic metre
  double num_plots = 0.0;
  double rate = 0.0;
  for (const Plot& plot : FindPlots(maker.recording).plots) {
    if (plot.stray_group_rate == 0.0) continue;
    num_plots += 1.0;
    rate += plot.stray_group_rate;
  }
  const double volume_m3 = (high_m - low_m).prod();
  const auto num_frames = static_cast<double>(maker.recording.frames.size());
  const double expected = rate / num_plots * volume_m3 * num_frames;
  EXPECT_GT(num_plots, 0.2 * expected);  // of lone strays and all there are 0.07; some form bodies
  EXPECT_LT(num_plots, 2.0 * expected);
}

TEST(Plots, StraysGroupByTheRangeFromALiDARThatHasMovedAway) {
  RecordingMaker maker = OnGround([](double time_s, RecordingMaker* m) {
    m->AddBlob({14.0, 3.0 * (time_s - 3.0), 9.0}, 0.1, 8, kDrone);
    m->AddBox({4.0, -14.0, 2.0}, {20.0, 14.0, 14.0}, 3000);  // 0.56 in a cubic metre
  });
  // At the range from its first position chains of strays would never end.
  const Eigen::Vector3f shift_m(20.0F, 0.0F, 0.0F);
  for (Eigen::Vector3f& point_m : maker.recording.points_m) point_m += shift_m;
  for (FrameInfo& frame : maker.recording.frames) frame.carrier.shift_m = shift_m;
  RobustConfig config;
  const Found found = FindPlots(maker.recording, config);
  config.disabled_rules = {Rule::kStrayGroups};
  const Found without = FindPlots(maker.recording, config);
  EXPECT_GT(ShareInPlots(maker, found, kDrone), ShareInPlots(maker, without, kDrone) + 0.3);
}

// A sky without structure: everything would float in it.
std::vector<Plot> PlotsInTheSky(const Recording& recording) {
  const RobustConfig config;
  const Ground ground;
  const Support support(ground, config.support);
  FramePlotter plotter;
  std::vector<Plot> plots;
  for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
    const FrameInfo& frame = recording.frames[f];
    std::vector<std::uint32_t> candidates(frame.last_return - frame.first_return);
    std::iota(candidates.begin(), candidates.end(), frame.first_return);
    const FramePlots& found = plotter.Find(
        recording, f, &candidates, ground, {}, [](const Eigen::Vector3f&) { return StrayRate(); },
        config);
    for (std::size_t p = 0; p < found.plots.size(); ++p) {
      const IndexView returns = plotter.ReturnsOf(p);
      plots.push_back(found.plots[p]);
      plots.back().returns = {returns.begin(), returns.end()};
    }
  }
  MarkFloating(recording, support, config, &plots);
  return plots;
}

// Share of the plots with a label that float.
double ShareFloating(const RecordingMaker& maker, int label) {
  double all = 0.0;
  double floating = 0.0;
  for (const Plot& plot : PlotsInTheSky(maker.recording)) {
    if (maker.labels[plot.returns.front()] != label) continue;
    all += 1.0;
    floating += plot.is_floating ? 1.0 : 0.0;
  }
  EXPECT_GT(all, 0.0);
  return floating / all;
}

const Eigen::Vector3d kHover_m(10.0, 0.0, 10.0);  // the reach is 2.9 m

// A drone that hovers, and what `fill` adds.
RecordingMaker HoverWith(int num_frames, const std::function<void(int, RecordingMaker*)>& fill,
                         std::uint32_t seed = 14) {
  RecordingMaker maker(seed);
  for (int i = 0; i < num_frames; ++i) {
    maker.BeginFrame(i * kPeriodS);
    maker.AddBlob(kHover_m, 0.1, 4, kDrone);
    fill(i, &maker);
  }
  return maker;
}

TEST(Plots, FloatWhereNothingIsBesideThem) {
  EXPECT_EQ(ShareFloating(HoverWith(60, [](int, RecordingMaker*) {}), kDrone), 1.0);
  // What is farther away is no company.
  const RecordingMaker far = HoverWith(60, [](int, RecordingMaker* maker) {
    maker->AddBlob(kHover_m + Eigen::Vector3d(0.0, 4.0, 0.0), 0.1, 4, kBody);
  });
  EXPECT_EQ(ShareFloating(far, kDrone), 1.0);
  EXPECT_EQ(ShareFloating(far, kBody), 1.0);
  // Nor is what is so near that it is a part of the same thing.
  const RecordingMaker part = HoverWith(60, [](int, RecordingMaker* maker) {
    maker->AddBlob(kHover_m + Eigen::Vector3d(0.0, 1.1, 0.0), 0.03, 4, kBody);
  });
  EXPECT_EQ(ShareFloating(part, kDrone), 1.0);
}

TEST(Plots, DoNotFloatWhereAnotherIsBesideThemAtTheSameTime) {
  const RecordingMaker maker = HoverWith(60, [](int i, RecordingMaker* m) {
    if (i < 40) m->AddBlob(kHover_m + Eigen::Vector3d(0.0, 2.2, 0.0), 0.1, 4, kBody);
    m->AddBlob(kHover_m + Eigen::Vector3d(0.0, 15.0, 0.0), 0.1, 4, kFarSide);
  });
  EXPECT_EQ(ShareFloating(maker, kDrone), 0.0);  // nor when the other one is not seen
  EXPECT_EQ(ShareFloating(maker, kBody), 0.0);
  EXPECT_EQ(ShareFloating(maker, kFarSide), 1.0);
}

TEST(Plots, WhatWasBesideThemAtOtherTimesIsNoCompany) {
  RecordingMaker maker(15);
  for (int i = 0; i < 60; ++i) {  // it flies on by 2.2 m
    maker.BeginFrame(i * kPeriodS);
    if (i < 25) maker.AddBlob(kHover_m, 0.1, 4, kDrone);
    if (i > 30) maker.AddBlob(kHover_m + Eigen::Vector3d(0.0, 2.2, 0.0), 0.1, 4, kDrone);
  }
  EXPECT_EQ(ShareFloating(maker, kDrone), 1.0);
}

TEST(Plots, CompanyInEvenRainSaysNothing) {
  const auto rain = [](const Eigen::Vector3d& half_m) {
    return HoverWith(20, [=](int, RecordingMaker* maker) {
      const int count = maker->random.Poisson(0.004 * 8.0 * half_m.prod());
      maker->AddBox(kHover_m - half_m, kHover_m + half_m, count, kBody);
    });
  };
  EXPECT_EQ(ShareFloating(rain({18.0, 18.0, 18.0}), kDrone), 1.0);
  EXPECT_EQ(ShareFloating(rain({2.5, 2.5, 2.5}), kDrone), 1.0);  // it does not stand still
}

TEST(Plots, WhatIsSeenAtAPlaceOnceOrTwiceOnlyDoesNotFloat) {
  for (const int times : {1, 2, 3, 6}) {
    RecordingMaker maker(17);
    for (int i = 0; i < 60; ++i) {
      maker.BeginFrame(i * kPeriodS);
      if (i % 10 == 4 && i < 10 * times) maker.AddBlob(kHover_m, 0.1, 4, kDrone);
      maker.AddBlob({10.0, 0.8 * i - 24.0, 4.0}, 0.1, 4, kBody);  // passes at 8 m/s
    }
    EXPECT_EQ(ShareFloating(maker, kDrone), times < 3 ? 0.0 : 1.0) << times;
    EXPECT_EQ(ShareFloating(maker, kBody), 0.0) << times;
  }
}

void AddRain(RecordingMaker* maker) {
  const Eigen::Vector3d half_m(18.0, 18.0, 18.0);
  maker->AddBox(kHover_m - half_m, kHover_m + half_m, maker->random.Poisson(300.0), kFarSide);
}

TEST(Plots, ADroneThatHoversFloatsAlsoInRainAndTheRainDoesNot) {
  constexpr std::array<std::uint32_t, 3> kSeeds = {1, 8, 14};
  for (std::size_t k = 0; k < testing::Draws(kSeeds.size()); ++k) {
    const std::uint32_t seed = kSeeds.at(k);
    const RecordingMaker maker = HoverWith(
        200, [](int, RecordingMaker* drone_maker) { AddRain(drone_maker); }, seed);
    EXPECT_GT(ShareFloating(maker, kDrone), 0.95) << seed;
    EXPECT_LT(ShareFloating(maker, kFarSide), 0.05) << seed;
  }
}

TEST(Plots, ALampBesideATwigDoesNotFloatAlsoNotInRain) {
  for (const bool is_raining : {false, true}) {
    const RecordingMaker maker = HoverWith(60, [&](int i, RecordingMaker* m) {
      if (i % 3 == 0) m->AddBlob(kHover_m + Eigen::Vector3d(0.0, 2.2, 0.0), 0.1, 2, kBody);
      if (is_raining) AddRain(m);
    });
    EXPECT_LT(ShareFloating(maker, kDrone), is_raining ? 0.05 : 1e-9);
    EXPECT_LT(ShareFloating(maker, kBody), is_raining ? 0.05 : 1e-9);
  }
}

TEST(Plots, RepeatedFramesDoNotFloat) {
  RecordingMaker maker(16);
  std::vector<Eigen::Vector3d> before_m;
  for (int i = 0; i < 60; ++i) {
    maker.BeginFrame(i * kPeriodS);
    std::vector<Eigen::Vector3d> points_m;
    for (int k = 0; k < 4; ++k) points_m.push_back(kHover_m + maker.random.NormalVector(0.1));
    const bool is_replay = i % 10 == 9;
    if (is_replay) points_m = before_m;
    for (const Eigen::Vector3d& p : points_m) maker.Add(p, kDrone);
    before_m = points_m;
  }
  const std::vector<Plot> plots = PlotsInTheSky(maker.recording);
  ASSERT_EQ(plots.size(), 60U);
  for (std::size_t i = 0; i < plots.size(); ++i) EXPECT_EQ(plots[i].is_floating, i % 10 < 8) << i;
}

}  // namespace
}  // namespace unlidar
