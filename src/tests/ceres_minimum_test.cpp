// The minimum that Ceres finds for what is written of a recording, against that of the banded
// solver, and what both minimise.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "tests/draws.hpp"
#include "tests/fit_trajectory.hpp"
#include "tests/synthetic_recording.hpp"
#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_fitter.hpp"
#include "trajectory/trajectory_model.hpp"

namespace unlidar {
namespace {

using testing::Random;

struct Flight {
  double rate_hz = 10.0;
  double duration_s = 10.0;
  double gap_s = 0.0;  // amid it
  double sigma_m = 0.1;
  double outliers = 0.0;  // share of them, from a little to far beyond the limit of the loss
  bool is_hover = false;
};

std::vector<Measurement> Measure(const Flight& flight, Random* random) {
  const Eigen::Vector3d centre_m = random->NormalVector(30.0);
  const Eigen::Vector3d velocity_mps = random->NormalVector(2.0);
  const Eigen::Vector3d sine_m = random->NormalVector(8.0);
  const Eigen::Vector3d cosine_m = random->NormalVector(8.0);
  const double turn_radps = random->Uniform(0.2, 0.7);
  std::vector<Measurement> measurements;
  for (int i = 0; i < flight.rate_hz * flight.duration_s; ++i) {
    const double time_s = (i + random->Uniform(0.0, 0.9)) / flight.rate_hz;
    if (std::abs(time_s - 0.5 * flight.duration_s) < 0.5 * flight.gap_s) continue;
    Measurement m;
    m.time_ns = testing::kBeginNs + static_cast<TimeNs>(time_s * 1e9);
    m.covariance_m2 = flight.sigma_m * flight.sigma_m * Eigen::Matrix3d::Identity();
    m.covariance_m2(0, 1) = m.covariance_m2(1, 0) = 0.4 * m.covariance_m2(0, 0);
    m.position_m = centre_m + random->NormalVector(flight.sigma_m);
    if (!flight.is_hover) {
      m.position_m += velocity_mps * time_s + std::sin(turn_radps * time_s) * sine_m +
                      std::cos(turn_radps * time_s) * cosine_m;
    }
    if (random->Uniform(0.0, 1.0) < flight.outliers) {
      const double far = random->Uniform(0.0, 1.0) < 0.5 ? 4.0 : 40.0;
      m.position_m += random->NormalVector(far * flight.sigma_m);
    }
    measurements.push_back(m);
  }
  return measurements;
}

std::vector<Flight> Flights() {
  std::vector<Flight> flights;
  for (const double outliers : {0.0, 0.08, 0.2}) {
    for (const double sigma_m : {0.05, 0.2}) {
      for (const double duration_s : {4.0, 25.0}) {
        flights.push_back({10.0, duration_s, 0.0, sigma_m, outliers, false});
        flights.push_back({4.0, duration_s, 0.4 * duration_s, sigma_m, outliers, false});
        flights.push_back({1.0, duration_s + 5.0, 0.0, sigma_m, outliers, false});
        flights.push_back({4.0, duration_s, 0.0, sigma_m, outliers, true});
      }
    }
  }
  return flights;
}

double LargestDistance(const std::vector<Eigen::Vector3d>& a,
                       const std::vector<Eigen::Vector3d>& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest_m = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest_m = std::max(largest_m, (a[i] - b[i]).norm());
  }
  return largest_m;
}

// The model of a fit, at the agility that was found.
SplineModel ModelOf(const std::vector<Measurement>& measurements, const Trajectory& fitted) {
  SplineModel model;
  BuildSplineModel(measurements, {}, model);
  SetSmoothness(fitted.scales.acceleration_time_s, model);
  for (std::size_t i = 1; i < model.smoothness.size(); ++i) {
    model.smoothness[i].sqrt_information = fitted.agility[(i - 1) / 2].inverse();
  }
  return model;
}

TEST(CeresMinimum, IsThatOfTheBandedSolver) {
  constexpr int kSeeds = testing::Draws(3);
  std::ptrdiff_t num_partial = 0;
  Random random(1);
  for (int seed = 0; seed < kSeeds; ++seed) {
    for (const Flight& flight : Flights()) {
      const std::vector<Measurement> measurements = Measure(flight, &random);
      const Trajectory banded = FitTrajectory(measurements, {});
      const Trajectory ceres = FitTrajectoryByCeres(measurements, {});
      const std::string what = std::to_string(flight.rate_hz) + " Hz, " +
                               std::to_string(flight.duration_s) + " s, outliers " +
                               std::to_string(flight.outliers) + ", seed " + std::to_string(seed);
      EXPECT_TRUE(banded.minimum.converged) << what;
      EXPECT_TRUE(ceres.minimum.converged) << what;
      EXPECT_LT(LargestDistance(banded.control_points_m, ceres.control_points_m), 1e-6) << what;
      for (std::size_t i = 0; i < measurements.size(); ++i) {
        const TimeNs at_ns = measurements[i].time_ns;
        const Eigen::Vector3d sigma_m = banded.At(at_ns).sigma_m;
        EXPECT_LT((ceres.At(at_ns).sigma_m - sigma_m).norm(), 1e-4 * sigma_m.norm()) << what;
        EXPECT_NEAR(ceres.weights[i], banded.weights[i], 1e-4) << what;
      }
      num_partial += std::count_if(ceres.weights.begin(), ceres.weights.end(),
                                   [](double weight) { return weight > 0.0 && weight < 1.0; });
    }
  }
  EXPECT_GT(num_partial, 50 * kSeeds) << "else the loss is not tested where it bends";
}

TEST(CeresMinimum, IsWhereTheSlopeOfTheSumVanishes) {
  Random random(2);
  const std::vector<Measurement> measurements =
      Measure({10.0, 8.0, 1.0, 0.1, 0.15, false}, &random);
  const Trajectory fitted = FitTrajectoryByCeres(measurements, {});
  const SplineModel model = ModelOf(measurements, fitted);
  const TruncatedLoss loss = LossOf(fitted.scales);
  std::vector<Eigen::Vector3d> slope(fitted.control_points_m.size(), Eigen::Vector3d::Zero());
  double steepest = 0.0;  // of one measurement
  double cost = 0.0;
  const auto add = [&](const SplineRow& row, double weight, double value) {
    const Eigen::Vector3d residual = Residual(row, fitted.control_points_m);
    for (int j = 0; j < 4; ++j) {
      const Eigen::Vector3d part = weight * Jacobian(row, j).transpose() * residual;
      slope[static_cast<std::size_t>(row.first + j)] += part;
      steepest = std::max(steepest, part.norm());
    }
    cost += 0.5 * value;
  };
  for (const auto& row : model.measurements) {
    const double s = Residual(row, fitted.control_points_m).squaredNorm();
    add(row, loss.Weight(s), loss.Value(s));
  }
  const double ratio = fitted.scales.acceleration_mps2 / fitted.scales.noise;
  for (const auto& row : model.smoothness) {
    const double s = Residual(row, fitted.control_points_m).squaredNorm();
    add(row, 1.0 / (ratio * ratio), s / (ratio * ratio));
  }
  for (const auto& row : model.start) {
    add(row, 1.0, Residual(row, fitted.control_points_m).squaredNorm());
  }
  for (const auto& part : slope) EXPECT_LT(part.norm(), 1e-7 * steepest);
  EXPECT_NEAR(fitted.minimum.final_cost, cost, 1e-9 * cost);
}

TEST(CeresMinimum, IsReported) {
  Random random(3);
  const std::vector<Measurement> measurements =
      Measure({10.0, 8.0, 0.0, 0.1, 0.15, false}, &random);
  const MinimumReport report = FitTrajectoryByCeres(measurements, {}).minimum;
  EXPECT_STREQ(report.solver, "ceres");
  EXPECT_STREQ(report.termination, "CONVERGENCE");
  EXPECT_GT(report.iterations, 1);
  EXPECT_LT(report.final_cost, report.initial_cost);
  const MinimumReport banded = FitTrajectory(measurements, {}).minimum;
  EXPECT_STREQ(banded.solver, "banded");
  EXPECT_STREQ(banded.termination, "");
}

TEST(CeresMinimum, TheSameMeasurementsGiveTheSameBits) {
  Random random(4);
  const std::vector<Measurement> measurements = Measure({4.0, 8.0, 0.0, 0.1, 0.1, false}, &random);
  const Trajectory a = FitTrajectoryByCeres(measurements, {});
  const Trajectory b = FitTrajectoryByCeres(measurements, {});
  EXPECT_EQ(a.control_points_m, b.control_points_m);
  EXPECT_EQ(a.covariance_m2, b.covariance_m2);
}

TEST(CeresMinimum, WhereCeresDoesNotConvergeItIsThatOfTheBandedSolver) {
  Random random(5);
  const std::vector<Measurement> measurements =
      Measure({10.0, 8.0, 0.0, 0.1, 0.15, false}, &random);
  Trajectory cut_short;
  TrajectoryFitter(TrajectoryConfig(), Minimiser::kCeres, 2).Fit(measurements, cut_short);
  EXPECT_FALSE(cut_short.minimum.converged);
  EXPECT_STREQ(cut_short.minimum.solver, "banded");
  EXPECT_STREQ(cut_short.minimum.termination, "NO_CONVERGENCE");
  const Trajectory whole = FitTrajectoryByCeres(measurements, {});
  EXPECT_LT(LargestDistance(cut_short.control_points_m, whole.control_points_m), 1e-6);
}

TEST(CeresMinimum, OneAndTwoMeasurementsHaveOne) {
  Random random(6);
  for (const double duration_s : {0.1, 0.2}) {
    const std::vector<Measurement> measurements =
        Measure({10.0, duration_s, 0.0, 0.1, 0.0, false}, &random);
    const Trajectory fitted = FitTrajectoryByCeres(measurements, {});
    EXPECT_TRUE(fitted.minimum.converged);
    EXPECT_LT(
        LargestDistance(fitted.control_points_m, FitTrajectory(measurements, {}).control_points_m),
        1e-6);
  }
}

TEST(SplineRow, JacobiansAreTheDerivativesOfTheResidual) {
  Random random(7);
  std::vector<Eigen::Vector3d> control = {{1, 2, 3}, {0, 5, 1}, {2, 2, 2}, {4, 0, 1}, {3, 3, 0}};
  SplineRow row;
  row.first = 1;
  row.basis = {0.2, 0.5, 0.2, 0.1};
  row.value_m = random.NormalVector(1.0);
  row.sqrt_information << random.NormalVector(1.0), random.NormalVector(1.0),
      random.NormalVector(1.0);
  const Eigen::Vector3d here = Residual(row, control);
  for (int j = 0; j < 4; ++j) {
    const Eigen::Vector3d step_m = random.NormalVector(1.0);
    std::vector<Eigen::Vector3d> moved = control;
    moved[static_cast<std::size_t>(row.first + j)] += step_m;  // the residual is linear
    EXPECT_LT((Residual(row, moved) - here - Jacobian(row, j) * step_m).norm(), 1e-12);
  }
}

TEST(TruncatedLoss, WeightAndCurvatureAreItsDerivativesAndItIsBounded) {
  const TruncatedLoss loss{20.0};
  for (const double s : {0.5, 9.0, 11.0, 20.0, 39.0, 41.0, 1e6}) {
    constexpr double kStep = 1e-4;
    EXPECT_NEAR(loss.Weight(s), (loss.Value(s + kStep) - loss.Value(s - kStep)) / (2.0 * kStep),
                1e-5)
        << s;
    EXPECT_NEAR(loss.Curvature(s),
                (loss.Weight(s + kStep) - loss.Weight(s - kStep)) / (2.0 * kStep), 1e-5)
        << s;
    EXPECT_LE(loss.Value(s), loss.squared_limit);
  }
}

}  // namespace
}  // namespace unlidar
