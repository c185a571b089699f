#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <cstdint>

#include "live/track_fit.hpp"
#include "tests/draws.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodNs;
using testing::Random;

// A covariance of variances about `variance_m2` along random axes.
Eigen::Matrix3d CovarianceAbout(double variance_m2, Random* random) {
  Eigen::Matrix3d root;
  for (int i = 0; i < 3; ++i) root.col(i) = random->NormalVector(1.0);
  const Eigen::Matrix3d square = root * root.transpose() + 0.3 * Eigen::Matrix3d::Identity();
  return 3.0 * variance_m2 / square.trace() * square;
}

// An error of a prediction that is off by `ratio` of the variance that it states.
PredictionError DrawnError(TimeNs time_ns, double ratio, double predicted_m2, double measured_m2,
                           Random* random) {
  PredictionError drawn;
  drawn.time_ns = time_ns;
  drawn.predicted_m2 = CovarianceAbout(predicted_m2, random);
  drawn.measured_m2 = CovarianceAbout(measured_m2, random);
  const Eigen::Matrix3d covariance = ratio * drawn.predicted_m2 + drawn.measured_m2;
  drawn.error_m = covariance.llt().matrixL() * random->NormalVector(1.0);
  return drawn;
}

double PriorRatio() { return PredictionScale().VarianceRatioAt(0); }

// Mean of e' (lambda P)^-1 e of what is predicted next, where predictions are off by `ratio`.
double NeesWhereOffBy(double ratio) {
  double sum = 0.0;
  int count = 0;
  for (std::uint32_t seed = 1; seed <= testing::Draws(40U); ++seed) {
    Random random(seed);
    PredictionScale scale;
    for (int i = 0; i < 100; ++i) {
      const TimeNs time_ns = i * kPeriodNs;
      if (i >= 20) {  // two seconds after it was first seen
        const Eigen::Vector3d error = random.NormalVector(std::sqrt(ratio));
        sum += error.squaredNorm() / scale.VarianceRatioAt(time_ns);
        ++count;
      }
      scale.Observe(DrawnError(time_ns, ratio, 0.04, 0.01, &random));
    }
  }
  return sum / count;
}

TEST(PredictionScale, SigmasAreTrueWhateverTheFitStates) {
  for (const double ratio : {0.25, 0.5, 1.0, 2.0, 4.0, 16.0, 64.0}) {
    EXPECT_GT(NeesWhereOffBy(ratio), 2.0) << ratio;
    EXPECT_LT(NeesWhereOffBy(ratio), 4.0) << ratio;
  }
}

// By Bayes' rule over a grid, with the density of the error instead of eigenvectors.
TEST(PredictionScale, OneErrorWeighsTheLevelsByItsLikelihood) {
  constexpr double kStep = 0.34657359028;  // half an octave
  Random random(1);
  for (int trial = 0; trial < testing::Draws(200); ++trial) {
    const double ratio = std::exp(random.Uniform(-2.0, 5.0));
    const PredictionError error = DrawnError(0, ratio, 0.04, random.Uniform(0.001, 0.2), &random);
    double sum = 0.0;
    double mean = 0.0;
    for (int m = -2; m <= 2; ++m) {
      double norm = 0.0;
      for (int i = -8; i <= 16; ++i) {
        norm += std::exp(-0.5 * std::pow((i + 1 - 2 * m) * kStep / 1.2, 2));
      }
      for (int i = -8; i <= 16; ++i) {
        const double level = std::exp(i * kStep);
        const Eigen::Matrix3d covariance = level * error.predicted_m2 + error.measured_m2;
        const double share =
            std::exp(-0.5 * std::pow(2 * m * kStep / 0.7, 2)) / norm *
            std::exp(-0.5 * std::pow((i + 1 - 2 * m) * kStep / 1.2, 2)) *
            std::exp(-0.5 * error.error_m.dot(covariance.inverse() * error.error_m)) /
            std::sqrt(covariance.determinant());
        sum += share;
        mean += share * level;
      }
    }
    PredictionScale scale;
    scale.Observe(error);
    EXPECT_NEAR(scale.VarianceRatioAt(0), mean / sum, 1e-6 * mean / sum);
  }
}

TEST(PredictionScale, MeasurementsCoarserThanThePredictionTellNothing) {
  Random random(1);
  PredictionScale scale;
  for (int i = 0; i < 50; ++i) {
    scale.Observe(DrawnError(i * kPeriodNs, 1.0, 1e-6, 1.0, &random));
  }
  EXPECT_NEAR(scale.VarianceRatioAt(49 * kPeriodNs), PriorRatio(), 0.05 * PriorRatio());
}

TEST(PredictionScale, AStopIsKnownFromTheFirstMeasurementBehindIt) {
  Random random(1);
  PredictionScale scale;
  TimeNs time_ns = 0;
  for (; time_ns < 50 * kPeriodNs; time_ns += kPeriodNs) {
    scale.Observe(DrawnError(time_ns, 0.5, 0.01, 0.01, &random));
  }
  const double before = scale.VarianceRatioAt(time_ns);
  PredictionError stop = DrawnError(time_ns, 1.0, 0.01, 0.01, &random);
  stop.error_m = Eigen::Vector3d(0.8, 0.0, 0.0);  // 8 sigmas of the prediction
  scale.Observe(stop);
  EXPECT_GT(scale.VarianceRatioAt(time_ns), 10.0 * before);
  for (int i = 0; i < 40; ++i, time_ns += kPeriodNs) {
    scale.Observe(DrawnError(time_ns, 0.5, 0.01, 0.01, &random));
  }
  EXPECT_LT(scale.VarianceRatioAt(time_ns), 2.0 * before);
}

TEST(PredictionScale, NeverFallsWhileNothingIsSeen) {
  for (const double ratio : {0.1, 1.0, 30.0}) {
    Random random(1);
    PredictionScale scale;
    for (int i = 0; i < 30; ++i) {
      scale.Observe(DrawnError(i * kPeriodNs, ratio, 0.04, 0.01, &random));
    }
    double before = 0.0;
    for (int i = 30; i < 130; ++i) {
      const double now = scale.VarianceRatioAt(i * kPeriodNs);
      EXPECT_GE(now, before) << ratio << ' ' << i;
      before = now;
    }
  }
}

TEST(PredictionScale, WhatIsNotFiniteChangesNothing) {
  for (const double value : {std::nan(""), HUGE_VAL}) {
    PredictionScale scale;
    PredictionError error;
    error.predicted_m2 = Eigen::Matrix3d::Identity();
    error.error_m.setConstant(value);
    scale.Observe(error);
    EXPECT_EQ(scale.VarianceRatioAt(0), PriorRatio());
    error.error_m.setZero();
    error.predicted_m2 *= value;
    scale.Observe(error);
    EXPECT_EQ(scale.VarianceRatioAt(0), PriorRatio());
  }
}

}  // namespace
}  // namespace unlidar
