#include "trajectory/banded.hpp"

#include <cmath>
#include <cstddef>

namespace unlidar {
namespace {

std::size_t Size(const BandedMatrix& matrix) { return matrix.size() - (kBandRows - 1); }

}  // namespace

BandedMatrix ZeroBandedMatrix(int size) {
  return BandedMatrix(static_cast<std::size_t>(size + kBandRows - 1),
                      BandedMatrix::value_type::Zero());
}

bool FactoriseBanded(BandedMatrix& matrix) {
  for (std::size_t j = 0; j < Size(matrix); ++j) {
    auto& column = matrix[j];
    if (!(column[0] > 0.0) || !std::isfinite(column[0])) return false;
    column /= std::sqrt(column[0]);
    for (int p = 1; p < kBandRows; ++p) {
      double* target = matrix[j + static_cast<std::size_t>(p)].data();
      const double* source = column.data() + p;
      const double factor = column[p];
      for (int q = 0; q < kBandRows - p; ++q) target[q] -= factor * source[q];
    }
  }
  return true;
}

double LogDeterminantBanded(const BandedMatrix& factor) {
  double sum = 0.0;
  for (std::size_t j = 0; j < Size(factor); ++j) sum += std::log(factor[j][0]);
  return 2.0 * sum;
}

void SolveBanded(const BandedMatrix& factor, Eigen::VectorXd& x) {
  const auto size = static_cast<Eigen::Index>(Size(factor));
  x.conservativeResize(size + kBandRows - 1);
  x.tail<kBandRows - 1>().setZero();
  for (Eigen::Index j = 0; j < size; ++j) {
    const auto& column = factor[static_cast<std::size_t>(j)];
    x[j] /= column[0];
    x.segment<kBandRows - 1>(j + 1) -= x[j] * column.tail<kBandRows - 1>();
  }
  x.tail<kBandRows - 1>().setZero();
  for (Eigen::Index j = size - 1; j >= 0; --j) {
    const auto& column = factor[static_cast<std::size_t>(j)];
    x[j] = (x[j] - column.tail<kBandRows - 1>().dot(x.segment<kBandRows - 1>(j + 1))) / column[0];
  }
  x.conservativeResize(size);
}

BandedMatrix InvertWithinBand(const BandedMatrix& factor) {
  BandedMatrix inverse(factor.size(), BandedMatrix::value_type::Zero());
  // Z = inv(L') inv(L) gives L' Z = inv(L); its upper rows, from the last to the first.
  for (std::size_t j = Size(factor); j-- > 0;) {
    const auto& column = factor[j];
    for (int p = kBandRows - 1; p >= 0; --p) {
      double sum = p == 0 ? 1.0 / column[0] : 0.0;
      for (int k = 1; k < kBandRows; ++k) {
        const int low = std::min(k, p);
        const int high = std::max(k, p);
        sum -= column[k] * (low == 0 ? inverse[j][high]
                                     : inverse[j + static_cast<std::size_t>(low)][high - low]);
      }
      inverse[j][p] = sum / column[0];
    }
  }
  return inverse;
}

}  // namespace unlidar
