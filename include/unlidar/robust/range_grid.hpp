// Voxels whose size grows with range, with one time profile each: what is where, and when.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace unlidar {

// Radius of a neighbourhood as a function of range: constant_m + slope * range. The constant stands
// for the size of things, the slope for the spacing of rays, which no place can resolve better.
struct RangeRadius {
  double constant_m = 0.35;
  double slope = 0.012;

  double At(double range_m) const { return constant_m + slope * range_m; }
};

// Counts of points per voxel and time bin. A neighbourhood is the block of 3 x 3 x 3 voxels about a
// point; voxels have an edge of 2/3 of the radius, so that the block reaches from 2/3 to 4/3 of it.
// Radii are stepped by sqrt(2) in shells of range. A point near a shell's border is counted in
// both shells, so that no neighbourhood ends there.
class RangeGrid {
 public:
  RangeGrid(RangeRadius radius, std::size_t num_bins);

  void Add(const Eigen::Vector3f& point_m, std::size_t bin, std::uint32_t count = 1);

  // Points per bin in the neighbourhood of `point_m`, added to `profile` (num_bins).
  void Collect(const Eigen::Vector3f& point_m, std::vector<std::uint32_t>* profile) const;

  // The voxel of a point and its shell: points with one key have one neighbourhood.
  std::uint64_t Key(const Eigen::Vector3f& point_m) const;

  // Volume of the neighbourhood of a point, m^3.
  double VolumeM3(const Eigen::Vector3f& point_m) const;

  std::size_t num_bins() const { return num_bins_; }

 private:
  struct Cell {
    int shell;
    std::array<std::int64_t, 3> index;
  };

  struct BinCount {
    std::uint32_t bin;
    std::uint32_t count;
  };

  int Shell(double range_m) const;
  int LastShell() const { return static_cast<int>(edge_m_.size()) - 1; }
  double BeginM(int shell) const { return begin_m_[static_cast<std::size_t>(shell)]; }
  double EdgeM(int shell) const { return edge_m_[static_cast<std::size_t>(shell)]; }
  Cell CellOf(const Eigen::Vector3f& point_m, int shell) const;
  static std::uint64_t Pack(const Cell& cell);

  RangeRadius radius_;
  std::size_t num_bins_;
  std::vector<double> begin_m_;  // per shell: its least range,
  std::vector<double> edge_m_;   // and the edge of its voxels
  std::unordered_map<std::uint64_t, std::uint32_t> slots_;
  // Per slot: the bins with points, ascending. Most places are hit in a few bins only, however long
  // the recording.
  std::vector<std::vector<BinCount>> counts_;
};

}  // namespace unlidar
