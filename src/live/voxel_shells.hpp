// Which voxels a point belongs to when their size grows with range.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "unlidar/robust/range_grid.hpp"

namespace unlidar {

// The voxels of a RangeGrid by their keys, for tables that count other things than points per bin.
class VoxelShells {
 public:
  explicit VoxelShells(RangeRadius radius) : radius_(radius) {
    const double most = std::log2(radius.At(kMaxRange_m) / radius.constant_m);
    for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
      begin_m_.push_back((std::exp2(0.5 * (shell - 0.5)) - 1.0) * radius.constant_m / radius.slope);
      edge_m_.push_back(2.0 / 3.0 * radius.constant_m * std::exp2(0.5 * shell));
    }
  }

  // Calls visit(key) for the voxel of a point in each shell whose neighbourhoods may reach it.
  template <class Visit>
  void ForEachHome(const Eigen::Vector3f& point_m, const Visit& visit) const {
    const double range_m = static_cast<double>(point_m.norm());
    const auto reach_m = [&](int shell) { return 2.0 * std::sqrt(3.0) * EdgeM(shell); };
    const int last_shell = static_cast<int>(edge_m_.size()) - 1;
    int first = ShellOf(range_m);
    int last = first;
    while (first > 0 && range_m - BeginM(first) <= reach_m(first - 1)) --first;
    while (last < last_shell && BeginM(last + 1) - range_m <= reach_m(last + 1)) ++last;
    for (int shell = first; shell <= last; ++shell) visit(Pack(shell, IndexOf(point_m, shell)));
  }

  // The voxel of a point in its own shell.
  std::uint64_t KeyOf(const Eigen::Vector3f& point_m) const {
    const int shell = ShellOf(static_cast<double>(point_m.norm()));
    return Pack(shell, IndexOf(point_m, shell));
  }

  // The 27 voxels of the neighbourhood of a point.
  std::array<std::uint64_t, 27> NeighboursOf(const Eigen::Vector3f& point_m) const {
    const int shell = ShellOf(static_cast<double>(point_m.norm()));
    const std::array<std::int64_t, 3> home = IndexOf(point_m, shell);
    std::array<std::uint64_t, 27> keys{};
    std::size_t k = 0;
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz) {
          keys[k++] = Pack(shell, {home[0] + dx, home[1] + dy, home[2] + dz});
        }
      }
    }
    return keys;
  }

  // Of the neighbourhood of a point.
  double VolumeM3(const Eigen::Vector3f& point_m) const {
    const double side_m = 3.0 * EdgeM(ShellOf(static_cast<double>(point_m.norm())));
    return side_m * side_m * side_m;
  }

 private:
  static constexpr double kMaxRange_m = 1e6;  // voxels grow no more beyond
  static constexpr int kIndexBits = 19;

  int ShellOf(double range_m) const {
    const double growth = std::log2(radius_.At(range_m) / radius_.constant_m);
    return std::min(static_cast<int>(std::floor(2.0 * growth + 0.5)),
                    static_cast<int>(edge_m_.size()) - 1);
  }
  double BeginM(int shell) const { return begin_m_[static_cast<std::size_t>(shell)]; }
  double EdgeM(int shell) const { return edge_m_[static_cast<std::size_t>(shell)]; }

  std::array<std::int64_t, 3> IndexOf(const Eigen::Vector3f& point_m, int shell) const {
    const double edge_m = EdgeM(shell);
    const auto index = [&](float x) {
      return static_cast<std::int64_t>(std::floor(static_cast<double>(x) / edge_m));
    };
    return {index(point_m.x()), index(point_m.y()), index(point_m.z())};
  }

  static std::uint64_t Pack(int shell, const std::array<std::int64_t, 3>& index) {
    constexpr std::int64_t kOffset = std::int64_t{1} << (kIndexBits - 1);
    constexpr std::int64_t kMask = (std::int64_t{1} << kIndexBits) - 1;
    auto key = static_cast<std::uint64_t>(shell & 0x7F);
    for (const std::int64_t i : index) {
      key = (key << kIndexBits) | static_cast<std::uint64_t>((i + kOffset) & kMask);
    }
    return key;
  }

  RangeRadius radius_;
  std::vector<double> begin_m_;  // per shell: its least range,
  std::vector<double> edge_m_;   // and the edge of its voxels
};

// Spreads the bits of a key: neighbours have neighbouring keys.
struct VoxelHash {
  std::size_t operator()(std::uint64_t key) const {
    key ^= key >> 31;
    key *= 0x9E3779B97F4A7C15ULL;
    return key ^ (key >> 29);
  }
};

}  // namespace unlidar
