#include "trajectory/banded.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

std::size_t Size(const BandedMatrix& matrix) { return matrix.size() - (kBandRows - 1); }

// A column padded with zeros, so that loops have a fixed length known to the compiler.
using Padded = Eigen::Matrix<double, 2 * kBandRows, 1>;

// Block for the points i and i + d.
Eigen::Matrix3d BlockOf(const BandedMatrix& matrix, int i, int d) {
  Eigen::Matrix3d block;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      const int low = std::min(3 * i + r, 3 * (i + d) + c);
      const int high = std::max(3 * i + r, 3 * (i + d) + c);
      block(r, c) = matrix[Index(low)][high - low];
    }
  }
  return block;
}

}  // namespace

void SetZeroBanded(int size, BandedMatrix& matrix) {
  matrix.assign(static_cast<std::size_t>(size + kBandRows - 1), BandedMatrix::value_type::Zero());
}

bool FactoriseBanded(BandedMatrix& matrix) {
  for (std::size_t j = 0; j < Size(matrix); ++j) {
    auto& column = matrix[j];
    if (!(column[0] > 0.0) || !std::isfinite(column[0])) return false;
    column /= std::sqrt(column[0]);
    Padded source = Padded::Zero();
    source.head<kBandRows>() = column;
    for (int p = 1; p < kBandRows; ++p) {
      // Dominates the time of a fit. Plain loops, because with sanitizers expressions are not
      // inlined and take ten times as long.
      double* const target = matrix[j + Index(p)].data();
      const double* const from = source.data() + p;
      const double by = column[p];
      for (int r = 0; r < kBandRows; ++r) target[r] -= by * from[r];
    }
  }
  return true;
}

double LogDeterminantBanded(const BandedMatrix& factor) {
  double sum = 0.0;
  for (std::size_t j = 0; j < Size(factor); ++j) sum += std::log(factor[j][0]);
  return 2.0 * sum;
}

void SolveBanded(const BandedMatrix& factor, std::vector<double>& x) {
  const std::size_t size = Size(factor);
  const auto below = [&](std::size_t j) {
    return Eigen::Map<Eigen::Matrix<double, kBandRows - 1, 1>>(&x[j + 1]);
  };
  x.resize(factor.size());
  below(size - 1).setZero();
  for (std::size_t j = 0; j < size; ++j) {
    const auto& column = factor[j];
    x[j] /= column[0];
    below(j) -= x[j] * column.tail<kBandRows - 1>();
  }
  below(size - 1).setZero();
  for (std::size_t j = size; j-- > 0;) {
    const auto& column = factor[j];
    x[j] = (x[j] - column.tail<kBandRows - 1>().dot(below(j))) / column[0];
  }
  x.resize(size);
}

Eigen::Matrix3d CovarianceOfSum(int first, const Eigen::Vector4d& basis,
                                const BandedMatrix& covariance) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (int a = 0; a < 4; ++a) {
    for (int b = a; b < 4; ++b) {
      const Eigen::Matrix3d ab = BlockOf(covariance, first + a, b - a);
      sum += (a == b ? 0.5 : 1.0) * basis[a] * basis[b] * (ab + ab.transpose());
    }
  }
  return sum;
}

void InvertWithinBand(const BandedMatrix& factor, BandedMatrix& inverse) {
  inverse.assign(factor.size(), BandedMatrix::value_type::Zero());
  // Z = inv(L') inv(L) gives L' Z = inv(L); its upper rows, from the last to the first. With c the
  // column of L below its diagonal, and S the block of Z next to it: z = -S c / L_jj.
  Padded below = Padded::Zero();
  for (std::size_t j = Size(factor); j-- > 0;) {
    const auto& column = factor[j];
    below.head<kBandRows>() = column;
    Padded product = Padded::Zero();  // S c; entries beyond the band are not used
    for (int k = 1; k < kBandRows; ++k) {
      const auto& known = inverse[j + static_cast<std::size_t>(k)];
      product.segment<kBandRows>(k) += column[k] * known;
      product[k] += known.tail<kBandRows - 1>().dot(below.segment<kBandRows - 1>(k + 1));
    }
    auto& own = inverse[j];
    own = product.head<kBandRows>() / -column[0];
    own[0] =
        (1.0 / column[0] - column.tail<kBandRows - 1>().dot(own.tail<kBandRows - 1>())) / column[0];
  }
}

}  // namespace unlidar
