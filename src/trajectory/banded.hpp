// Symmetric positive definite band matrices, as in spline fits; all operations are linear in their
// size.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace unlidar {

// Eigen and the band count in int, containers do not.
inline std::size_t Index(int i) { return static_cast<std::size_t>(i); }

// Four neighbouring control points of three coordinates each are coupled.
inline constexpr int kBandRows = 12;

// Lower triangle: entry p of column j is element (j + p, j). Columns beyond the matrix are zero, so
// that no loop has to stop early.
using BandedMatrix = std::vector<Eigen::Matrix<double, kBandRows, 1>>;

// Resets to a zero matrix of this size. Allocates only if it grows, as do all functions below that
// fill an argument.
void SetZeroBanded(int size, BandedMatrix& matrix);

// Computes L of L L' = A in place. Returns false if A is not positive definite.
bool FactoriseBanded(BandedMatrix& matrix);

// log det A from its factor L.
double LogDeterminantBanded(const BandedMatrix& factor);

// Solves A x = b in place, from the factor L of A.
void SolveBanded(const BandedMatrix& factor, std::vector<double>& x);

// (3, 3) covariance of sum_j basis[j] c[first + j] of points c, whose coordinates have this
// covariance.
Eigen::Matrix3d CovarianceOfSum(int first, const Eigen::Vector4d& basis,
                                const BandedMatrix& covariance);

// Computes inv(A) within the band from the factor L of A (Takahashi, Fagan and Chen 1973).
void InvertWithinBand(const BandedMatrix& factor, BandedMatrix& inverse);

}  // namespace unlidar
