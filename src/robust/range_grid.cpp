#include "unlidar/robust/range_grid.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr double kEdgePerRadius = 2.0 / 3.0;
constexpr double kMaxRange_m = 1e6;  // voxels grow no more beyond
constexpr int kIndexBits = 19;
constexpr int kShellMask = (1 << (64 - 3 * kIndexBits)) - 1;

}  // namespace

RangeGrid::RangeGrid(RangeRadius radius, std::size_t num_bins)
    : radius_(radius), num_bins_(num_bins) {
  const double most = std::log2(radius_.At(kMaxRange_m) / radius_.constant_m);
  for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
    begin_m_.push_back((std::exp2(0.5 * (shell - 0.5)) - 1.0) * radius_.constant_m / radius_.slope);
    edge_m_.push_back(kEdgePerRadius * radius_.constant_m * std::exp2(0.5 * shell));
  }
}

int RangeGrid::Shell(double range_m) const {
  const double growth = std::log2(radius_.At(range_m) / radius_.constant_m);
  return std::min(static_cast<int>(std::floor(2.0 * growth + 0.5)), LastShell());
}

RangeGrid::Cell RangeGrid::CellOf(const Eigen::Vector3f& point_m, int shell) const {
  const double edge_m = EdgeM(shell);
  Cell cell{shell, {}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    cell.index[axis] = static_cast<std::int64_t>(
        std::floor(static_cast<double>(point_m[static_cast<Eigen::Index>(axis)]) / edge_m));
  }
  return cell;
}

std::uint64_t RangeGrid::Pack(const Cell& cell) {
  constexpr std::int64_t kOffset = std::int64_t{1} << (kIndexBits - 1);
  constexpr std::int64_t kMask = (std::int64_t{1} << kIndexBits) - 1;
  std::uint64_t key = static_cast<std::uint64_t>(cell.shell & kShellMask);
  for (const std::int64_t index : cell.index) {
    key = (key << kIndexBits) | static_cast<std::uint64_t>((index + kOffset) & kMask);
  }
  return key;
}

std::uint64_t RangeGrid::Key(const Eigen::Vector3f& point_m) const {
  return Pack(CellOf(point_m, Shell(static_cast<double>(point_m.norm()))));
}

void RangeGrid::Add(const Eigen::Vector3f& point_m, std::size_t bin, std::uint32_t count) {
  if (count == 0) return;
  // The shells with a place near enough: a block reaches two edges along each axis.
  const double range_m = static_cast<double>(point_m.norm());
  const auto reach_m = [&](int shell) { return 2.0 * std::sqrt(3.0) * EdgeM(shell); };
  int first = Shell(range_m);
  int last = first;
  while (first > 0 && range_m - BeginM(first) <= reach_m(first - 1)) --first;
  while (last < LastShell() && BeginM(last + 1) - range_m <= reach_m(last + 1)) ++last;
  for (int shell = first; shell <= last; ++shell) {
    const auto [slot, is_new] =
        slots_.try_emplace(Pack(CellOf(point_m, shell)), static_cast<std::uint32_t>(slots_.size()));
    if (is_new) counts_.emplace_back();
    std::vector<BinCount>& counts = counts_[slot->second];
    auto at = counts.end();  // as points mostly come in order of time
    if (!counts.empty() && counts.back().bin >= bin) {
      at = std::lower_bound(counts.begin(), counts.end(), bin,
                            [](const BinCount& a, std::size_t b) { return a.bin < b; });
    }
    if (at == counts.end() || at->bin != bin) {
      at = counts.insert(at, {static_cast<std::uint32_t>(bin), 0});
    }
    at->count += count;
  }
}

void RangeGrid::Collect(const Eigen::Vector3f& point_m, std::vector<std::uint32_t>* profile) const {
  const Cell home = CellOf(point_m, Shell(static_cast<double>(point_m.norm())));
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const Cell cell{home.shell, {home.index[0] + dx, home.index[1] + dy, home.index[2] + dz}};
        const auto slot = slots_.find(Pack(cell));
        if (slot == slots_.end()) continue;
        for (const BinCount& at : counts_[slot->second]) (*profile)[at.bin] += at.count;
      }
    }
  }
}

double RangeGrid::VolumeM3(const Eigen::Vector3f& point_m) const {
  return std::pow(3.0 * EdgeM(Shell(static_cast<double>(point_m.norm()))), 3);
}

}  // namespace unlidar
