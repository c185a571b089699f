#include "collection/cloud.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "collection/body.hpp"
#include "tests/fit_trajectory.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::MiddleS;
using testing::RecordingMaker;

constexpr int kFrames = 80;
const Eigen::Vector3d kChimneyM(15.0, 4.0, 3.0);
const Eigen::Vector3d kWindMps(0.8, 0.3, 1.2);

// Something that is about at some time, its returns spread with a standard deviation.
struct Thing {
  double from_s;
  double to_s;
  double spread_m;
  std::function<Eigen::Vector3d(double time_s)> at;
  double growth_mps = 0.0;
  double grows_after_s = 0.0;
};

Thing Puff(double from_s, double spread_m) {
  return {from_s, from_s + 4.0, spread_m, [from_s](double time_s) {
            return Eigen::Vector3d(kChimneyM + (time_s - from_s) * kWindMps);
          }};
}

// Narrow at first, and no wider than a drone on average.
Thing Dust() {
  Thing puff = Puff(0.0, 0.08);
  puff.growth_mps = 0.07;
  return puff;
}

Thing Drone(const Eigen::Vector3d& from_m, const Eigen::Vector3d& velocity_mps) {
  return {0.0, 8.0, 0.1,
          [=](double time_s) { return Eigen::Vector3d(from_m + time_s * velocity_mps); }};
}

// The sky with some things, three returns each, and `strays` a frame about the chimney, as many on
// each metre of a ray, up to this slope above and below the chimney.
class Sky {
 public:
  explicit Sky(const std::vector<Thing>& things, int strays = 0, double max_slope = 0.65)
      : maker_(3) {
    const Eigen::Vector3d half(10.0, 0.7, max_slope);
    const Eigen::Vector3d middle(kChimneyM.x(), kChimneyM.y() / kChimneyM.x(),
                                 kChimneyM.z() / kChimneyM.x());
    for (int i = 0; i < kFrames; ++i) {
      maker_.BeginFrame(i * kPeriodS);
      const double time_s = MiddleS(i);
      for (std::size_t k = 0; k < things.size(); ++k) {
        if (time_s < things[k].from_s || time_s > things[k].to_s) continue;
        const double spread_m = things[k].spread_m +
                                std::max(time_s - things[k].from_s - things[k].grows_after_s, 0.0) *
                                    things[k].growth_mps;
        maker_.AddBlob(things[k].at(time_s), spread_m, 3, static_cast<int>(k));
      }
      for (int k = 0; k < strays; ++k) {
        const Eigen::Vector3d at = maker_.random.InBox(middle - half, middle + half);
        maker_.Add({at.x(), at.x() * at.y(), at.x() * at.z()}, kStray);
      }
    }
    for (std::size_t k = 0; k < things.size(); ++k)
      targets_.push_back(TargetOf(static_cast<int>(k)));
  }

  // By the order of the things.
  std::vector<double> Kept(const RobustConfig& config = RobustConfig()) const {
    const std::vector<StationModel> station_models = {{Eigen::Vector3f::Zero(), nullptr, nullptr}};
    const std::vector<Rejection> rejections =
        ShapeRejections(maker_.recording, station_models, Plots(), targets_, config);
    std::vector<double> kept;
    for (std::size_t t = 0; t < targets_.size(); ++t) {
      if (rejections[t] == Rejection::kNone) kept.push_back(targets_[t].score);
    }
    return kept;
  }

 private:
  static constexpr int kStray = -1;

  // Its first two returns of each frame: what was collected of it.
  Target TargetOf(int label) const {
    const Recording& recording = maker_.recording;
    Target target;
    target.score = label;
    for (const FrameInfo& frame : recording.frames) {
      Measurement m;
      m.time_ns = frame.middle_ns();
      m.support = 0;
      for (std::uint32_t i = frame.first_return; i < frame.last_return && m.support < 2; ++i) {
        if (maker_.labels[i] != label) continue;
        target.returns.push_back(i);
        m.position_m += 0.5 * recording.points_m[i].cast<double>();
        ++m.support;
      }
      m.covariance_m2 *= 0.02;
      if (m.support > 0) target.measurements.push_back(m);
    }
    target.trajectory = FitTrajectory(target.measurements, {});
    return target;
  }

  // Every return is one.
  std::vector<Plot> Plots() const {
    std::vector<Plot> plots;
    const Recording& recording = maker_.recording;
    for (std::uint32_t f = 0; f < recording.frames.size(); ++f) {
      const FrameInfo& frame = recording.frames[f];
      for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
        Plot plot;
        plot.frame = f;
        plot.frame_time_ns = plot.time_ns = frame.middle_ns();
        plot.position_m = recording.points_m[i].cast<double>();
        plot.lowest_m = 5.0;
        plot.returns = {i};
        plots.push_back(plot);
      }
    }
    return plots;
  }

  RecordingMaker maker_;
  std::vector<Target> targets_;
};

TEST(ShapeRejections, WhatLiesWiderThanADroneIsNone) {
  const Sky sky({Puff(0.0, 0.6), Drone({-10.0, 5.0, 8.0}, {0.5, 1.0, 0.0})});
  EXPECT_EQ(sky.Kept(), std::vector<double>({1}));
}

TEST(ShapeRejections, ASmallPieceThatGoesTheWayOfACloudIsPartOfIt) {
  Thing piece = Puff(4.0, 0.1);
  piece.to_s = 6.0;
  EXPECT_EQ(Sky({piece, Puff(0.0, 0.6)}).Kept(), std::vector<double>());
}

TEST(ShapeRejections, WhatStaysNarrowForLongerThanPiecesOfACloudIsNone) {
  const Sky sky({Puff(4.0, 0.1), Puff(0.0, 0.6)});
  EXPECT_EQ(sky.Kept(), std::vector<double>({0}));
  RobustConfig without;
  without.disabled_rules = {Rule::kGrowth};
  EXPECT_EQ(sky.Kept(without), std::vector<double>());
}

TEST(ShapeRejections, WhatGrowsIsACloudBeforeItIsWide) {
  const Sky sky({Dust()});
  EXPECT_EQ(sky.Kept(), std::vector<double>());
  RobustConfig without;
  without.disabled_rules = {Rule::kGrowth};
  EXPECT_EQ(sky.Kept(without), std::vector<double>({0}));
}

// Returns at which a body or a cloud scatters, relative to its centre.
using Scatterer =
    std::function<Eigen::Vector3d(testing::Random* random, const Eigen::Vector3d& ray, int frame)>;

// Judges what is seen in 30 frames while it passes at 12 m/s: of two returns each at first, then of
// eight.
bool IsCloud(const Scatterer& scatterer, bool is_timed, const RobustConfig& config,
             int num_sparse = 0) {
  testing::Random random(7);
  Shape shape(config);
  for (int i = 0; i < 30; ++i) {
    TrajectoryRow at;
    at.time_ns = static_cast<TimeNs>(i) * 100'000'000;
    at.velocity_mps = {12.0, -1.0, 0.5};
    at.position_m = Eigen::Vector3d(-16.0, 14.0, 8.0) + 0.1 * i * at.velocity_mps;
    std::vector<ReturnCluster> clusters(i < num_sparse ? 2 : 8);
    for (ReturnCluster& one : clusters) {
      one.time_ns = at.time_ns + static_cast<TimeNs>(random.Uniform(-4e7, 4e7));
      one.is_own = true;
      one.position_m = at.position_m + scatterer(&random, at.position_m.normalized(), i) +
                       SecondsOf(one.time_ns - at.time_ns) * at.velocity_mps;
      if (!is_timed) one.time_ns = at.time_ns;
    }
    shape.Add(at, Eigen::Vector3d::Zero(), StreakM2(is_timed ? 0.0 : 0.08, at.velocity_mps),
              clusters);
  }
  return shape.IsCloud({});
}

TEST(Shape, WhatScattersAsAVolumeIsACloud) {
  const Scatterer in_ball = [](testing::Random* random, const Eigen::Vector3d&, int) {
    const Eigen::Vector3d half_m = Eigen::Vector3d::Constant(0.5);
    Eigen::Vector3d one_m = random->InBox(-half_m, half_m);
    while (one_m.norm() > 0.5) one_m = random->InBox(-half_m, half_m);
    return one_m;
  };
  const Scatterer on_ball = [](testing::Random* random, const Eigen::Vector3d& ray, int) {
    return random->OnFacingSide(0.6, ray);
  };
  // A multicopter that is seen through and banks by up to 20 degrees.
  const Scatterer flat = [](testing::Random* random, const Eigen::Vector3d&, int frame) {
    const Eigen::Vector3d half_m(0.7, 0.7, 0.2);
    const Eigen::Vector3d axis(std::cos(frame), std::sin(frame), 0.0);
    const Eigen::AngleAxisd attitude(0.35 * std::sin(2.0 * frame), axis);
    return Eigen::Vector3d(attitude * random->InBox(-half_m, half_m));
  };
  // One beam of a ring tells nothing of the height.
  const Scatterer in_ring = [&](testing::Random* random, const Eigen::Vector3d& ray, int frame) {
    const Eigen::Vector3d up = (Eigen::Vector3d::UnitZ() - ray.z() * ray).normalized();
    const Eigen::Vector3d one_m = in_ball(random, ray, frame);
    return Eigen::Vector3d(one_m - one_m.dot(up) * up);
  };
  const RobustConfig config;
  EXPECT_TRUE(IsCloud(in_ball, true, config));
  EXPECT_FALSE(IsCloud(on_ball, true, config));
  EXPECT_FALSE(IsCloud(flat, true, config));
  EXPECT_FALSE(IsCloud(flat, false, config));
  EXPECT_FALSE(IsCloud(in_ring, true, config));
  // A drone of two returns a frame whose path ends in a cloud, too late to be one.
  EXPECT_TRUE(IsCloud(in_ball, true, config, 13));
  EXPECT_FALSE(IsCloud(in_ball, true, config, 17));
  RobustConfig without;
  without.disabled_rules = {Rule::kVolumeScattering};
  EXPECT_FALSE(IsCloud(in_ball, true, without));
}

TEST(ShapeRejections, AWideBodyDoesNotGrow) {
  EXPECT_EQ(Sky({Puff(0.0, 0.25)}).Kept(), std::vector<double>({0}));
}

TEST(ShapeRejections, WhatIsWideAtItsEndAloneHasNotGrown) {
  Thing drone = Puff(0.0, 0.08);
  drone.to_s = 6.0;
  drone.growth_mps = 0.5;
  drone.grows_after_s = 4.2;
  EXPECT_EQ(Sky({drone}).Kept(), std::vector<double>({0}));
}

TEST(ShapeRejections, ASmallBodyMayGrowAsNoiseDoes) {
  Thing drone = Puff(0.0, 0.03);
  drone.growth_mps = 0.02;
  EXPECT_EQ(Sky({drone}).Kept(), std::vector<double>({0}));
}

TEST(ShapeRejections, ASmallThingWithoutACloudIsADrone) {
  const Sky sky({Puff(4.0, 0.1), Puff(0.0, 0.1)});
  EXPECT_EQ(sky.Kept(), std::vector<double>({0, 1}));
}

TEST(ShapeRejections, WhatLiesCloserTogetherThanAnyDroneIsAnInsect) {
  const auto is_kept = [](double spread_m, double for_s) {
    Thing thing = Drone({2.0, -3.0, 2.5}, {0.3, 0.8, 0.1});
    thing.spread_m = spread_m;
    thing.to_s = for_s;
    return !Sky({thing}).Kept().empty();
  };
  EXPECT_FALSE(is_kept(0.01, 8.0));
  EXPECT_TRUE(is_kept(0.03, 8.0));
  EXPECT_TRUE(is_kept(0.1, 8.0));
  // Of five frames nobody knows.
  EXPECT_TRUE(is_kept(0.01, 0.5));
}

TEST(ShapeRejections, AWayThatTurnsMakesAnInsectNoDrone) {
  // The returns of a frame tell, not how well a smooth way goes through them.
  Thing insect = Drone({0, 0, 0}, {0, 0, 0});
  insect.spread_m = 0.01;
  insect.at = [](double time_s) {
    return Eigen::Vector3d(2.0 + 0.3 * std::sin(9.0 * time_s), 1.0 + 0.3 * std::cos(7.0 * time_s),
                           2.5);
  };
  EXPECT_TRUE(Sky({insect}).Kept().empty());
}

TEST(ShapeRejections, ADroneThatPassesACloudIsKept) {
  const Sky sky({Drone(kChimneyM + Eigen::Vector3d(-8.0, 1.0, 3.0), {2.0, 0.0, 0.0}),
                 Drone(kChimneyM + Eigen::Vector3d(1.5, 0.5, 9.0), {0.0, 0.0, -1.0}),
                 Puff(0.0, 0.6)});
  EXPECT_EQ(sky.Kept(), std::vector<double>({0, 1}));
}

TEST(ShapeRejections, StraysAllAboutADroneDoNotWidenIt) {
  const Sky sky({Drone(kChimneyM - Eigen::Vector3d(0.0, 4.0, 0.0), {0.0, 1.0, 0.0})}, 400);
  EXPECT_EQ(sky.Kept(), std::vector<double>({0}));
}

TEST(ShapeRejections, StraysInANarrowViewDoNotWidenADrone) {
  const Thing drone = Drone(kChimneyM - Eigen::Vector3d(0.0, 4.0, 0.0), {0.0, 1.0, 0.0});
  EXPECT_EQ(Sky({drone}, 400, 0.13).Kept(), std::vector<double>({0}));
  EXPECT_TRUE(Sky({Puff(0.0, 0.6)}, 400, 0.13).Kept().empty());
}

}  // namespace
}  // namespace unlidar
