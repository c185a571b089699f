// The pieces below a trajectory: banded matrices and B-splines.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "trajectory/banded.hpp"
#include "trajectory/spline_model.hpp"

namespace unlidar {
namespace {

struct DenseAndBanded {
  Eigen::MatrixXd dense;
  BandedMatrix banded;
};

DenseAndBanded RandomPositiveMatrix(int size) {
  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(size, size);
  for (int i = 0; i < size; ++i) {
    for (int j = std::max(0, i - kBandRows + 1); j <= i; ++j) factor(i, j) = normal(generator);
    factor(i, i) = 3.0 + std::abs(factor(i, i));
  }
  DenseAndBanded matrix{factor * factor.transpose(), {}};
  SetZeroBanded(size, matrix.banded);
  for (int j = 0; j < size; ++j) {
    for (int p = 0; p < kBandRows && j + p < size; ++p) {
      matrix.banded[static_cast<std::size_t>(j)][p] = matrix.dense(j + p, j);
    }
  }
  return matrix;
}

TEST(Banded, SolutionDeterminantAndInverseAreThoseOfTheDenseMatrix) {
  constexpr int kSize = 45;
  auto [dense, banded] = RandomPositiveMatrix(kSize);
  ASSERT_TRUE(FactoriseBanded(banded));
  const Eigen::VectorXd right = Eigen::VectorXd::LinSpaced(kSize, -1.0, 2.0);
  std::vector<double> x(right.begin(), right.end());
  SolveBanded(banded, x);
  EXPECT_LT((dense * Eigen::Map<Eigen::VectorXd>(x.data(), kSize) - right).norm(), 1e-10);
  EXPECT_NEAR(LogDeterminantBanded(banded), std::log(dense.determinant()), 1e-9);
  const Eigen::MatrixXd inverse = dense.inverse();
  BandedMatrix within;
  InvertWithinBand(banded, within);
  for (int j = 0; j < kSize; ++j) {
    for (int p = 0; p < kBandRows && j + p < kSize; ++p) {
      EXPECT_NEAR(within[static_cast<std::size_t>(j)][p], inverse(j + p, j), 1e-12);
    }
  }
}

TEST(Banded, AMatrixThatIsNotPositiveDefiniteIsRefused) {
  auto banded = RandomPositiveMatrix(20).banded;
  banded[11][0] = -1.0;
  EXPECT_FALSE(FactoriseBanded(banded));
}

TEST(BSpline, KnotsAreFineWhereTimesAreDenseAndCoverThemAll) {
  std::vector<double> times_s;
  for (int i = 0; i < 500; ++i) times_s.push_back(0.01 * i);  // dense up to 5 s
  times_s.push_back(8.0);
  std::vector<double> knots_s;
  PlaceKnots(times_s, 5.0, knots_s);
  EXPECT_LE(knots_s[3], -5.0);
  EXPECT_GE(knots_s[knots_s.size() - 4], 13.0);
  for (std::size_t i = 1; i < knots_s.size(); ++i) {
    const double length_s = knots_s[i] - knots_s[i - 1];
    EXPECT_GE(length_s, kMinKnotSpacingS - 1e-9);
    EXPECT_LE(length_s, kMaxKnotSpacingS + 1e-9);
    if (knots_s[i - 1] > 0.0 && knots_s[i] < 4.9) {
      EXPECT_NEAR(length_s, kMinKnotSpacingS, 1e-9);
    }
    if (knots_s[i - 1] > 5.1 && knots_s[i] < 7.9) {
      EXPECT_NEAR(length_s, kMaxKnotSpacingS, 1e-9);
    }
  }
}

TEST(BSpline, BasisSumsToOneAndJoinsWithTwoDerivativesAtUnevenKnots) {
  const std::vector<double> knots_s = {-1.0, -0.4, -0.3, 0.0, 0.2, 0.9, 1.0, 1.05, 2.0, 2.1, 3.0};
  for (int interval = 0; interval + 1 < static_cast<int>(knots_s.size()) - 7; ++interval) {
    const auto begin = static_cast<std::size_t>(interval + 3);
    const double length_s = knots_s[begin + 1] - knots_s[begin];
    const Eigen::Matrix4d here = BasisPolynomials(knots_s, interval);
    const Eigen::Matrix4d next = BasisPolynomials(knots_s, interval + 1);
    EXPECT_NEAR(EvaluateBasis(here, 0.3 * length_s, 0).sum(), 1.0, 1e-12);
    EXPECT_GE(EvaluateBasis(here, 0.3 * length_s, 0).minCoeff(), 0.0);
    for (int derivative = 0; derivative <= 2; ++derivative) {
      const Eigen::Vector4d left = EvaluateBasis(here, length_s, derivative);
      const Eigen::Vector4d right = EvaluateBasis(next, 0.0, derivative);
      const double tolerance = 1e-11 * (1.0 + left.norm());
      EXPECT_NEAR(left[0], 0.0, tolerance);
      EXPECT_NEAR((left.tail<3>() - right.head<3>()).norm(), 0.0, tolerance);
      EXPECT_NEAR(right[3], 0.0, tolerance);
    }
  }
}

TEST(BSpline, DerivativesAreThoseOfNumericDifferences) {
  const std::vector<double> knots_s = {-1.0, -0.4, -0.3, 0.0, 0.2, 0.9, 1.0, 1.05};
  const Eigen::Matrix4d basis = BasisPolynomials(knots_s, 0);
  constexpr double kStep_s = 1e-5;
  for (int derivative = 1; derivative <= 3; ++derivative) {
    const Eigen::Vector4d numeric = (EvaluateBasis(basis, 0.1 + kStep_s, derivative - 1) -
                                     EvaluateBasis(basis, 0.1 - kStep_s, derivative - 1)) /
                                    (2.0 * kStep_s);
    const Eigen::Vector4d exact = EvaluateBasis(basis, 0.1, derivative);
    EXPECT_LT((numeric - exact).norm(), 1e-6 * (1.0 + exact.norm()));
  }
}

TEST(SplineSolver, TheDeterminantOfTheSmoothnessIsThatOfItsRowsAlsoWhenAMinuteIsLong) {
  for (const double duration_s : {2.0, 60.0}) {
    std::vector<Measurement> measurements(2);
    measurements[1].time_ns = static_cast<TimeNs>(duration_s * 1e9);
    measurements[1].position_m = {3.0, 4.0, 5.0};
    SplineModel model;
    BuildSplineModel(measurements, {}, model);
    SetSmoothness(0.5, model);
    Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(
        static_cast<Eigen::Index>(model.smoothness.size() + model.start.size()),
        model.num_control_points());
    Eigen::Index i = 0;
    constexpr double kSigmaMps2 = 0.7;
    for (const auto& row : model.smoothness) {
      dense.row(i++).segment<4>(row.first) = row.basis / kSigmaMps2;
    }
    for (const auto& row : model.start) dense.row(i++).segment<4>(row.first) = row.basis;
    // Of three axes, each with all but two numbers from the smoothness.
    const double log_determinant = 6.0 * (Eigen::HouseholderQR<Eigen::MatrixXd>(dense)
                                              .matrixQR()
                                              .diagonal()
                                              .array()
                                              .abs()
                                              .log()
                                              .sum() +
                                          (model.num_control_points() - 2) * std::log(kSigmaMps2));
    SplineSolver solver;
    EXPECT_NEAR(solver.LogDeterminantOfSmoothness(model), log_determinant, 1e-5) << duration_s;
  }
}

}  // namespace
}  // namespace unlidar
