// Symmetric positive definite matrices of a narrow band, as splines give them: everything is linear
// in their size.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace unlidar {

// Eigen and the band count in int, containers do not.
inline std::size_t Index(int i) { return static_cast<std::size_t>(i); }

// Four neighbouring control points of three coordinates each hang together.
inline constexpr int kBandRows = 12;

// Lower triangle: entry p of column j is element (j + p, j). Columns beyond the matrix are zero, so
// that no loop has to stop early at its end.
using BandedMatrix = std::vector<Eigen::Matrix<double, kBandRows, 1>>;

// Makes it a zero matrix of this size. No memory is taken where it was as large before; the same
// holds of the others that fill what they are handed.
void SetZeroBanded(int size, BandedMatrix& matrix);

// L of L L' = A, in place. False where A is not positive definite.
bool FactoriseBanded(BandedMatrix& matrix);

// log det A from its factor L.
double LogDeterminantBanded(const BandedMatrix& factor);

// x of A x = b, in place, from the factor L of A.
void SolveBanded(const BandedMatrix& factor, std::vector<double>& x);

// The elements of inv(A) within the band, from the factor L of A (Takahashi, Fagan and Chen 1973).
void InvertWithinBand(const BandedMatrix& factor, BandedMatrix& inverse);

}  // namespace unlidar
