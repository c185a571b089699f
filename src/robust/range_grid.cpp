#include "unlidar/robust/range_grid.hpp"

#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr double kEdgePerRadius = 2.0 / 3.0;
constexpr double kMaxRange_m = 1e6;  // voxels grow no more beyond

}  // namespace

void BinSet::MoveTo(std::vector<std::uint32_t>* bins) {
  for (std::size_t word = first_; word < last_; ++word) {
    for (std::uint64_t& bits = words_[word]; bits != 0; bits &= bits - 1) {
      bins->push_back(static_cast<std::uint32_t>(word * kBits) +
                      static_cast<std::uint32_t>(__builtin_ctzll(bits)));
    }
  }
  first_ = words_.size();
  last_ = 0;
}

RangeGrid::RangeGrid(RangeRadius radius) : radius_(radius) {
  const double most = std::log2(radius_.At(kMaxRange_m) / radius_.constant_m);
  for (int shell = 0; shell <= static_cast<int>(std::floor(2.0 * most + 0.5)); ++shell) {
    shells_.push_back({(std::exp2(0.5 * (shell - 0.5)) - 1.0) * radius_.constant_m / radius_.slope,
                       kEdgePerRadius * radius_.constant_m * std::exp2(0.5 * shell),
                       {}});
  }
}

std::size_t RangeGrid::ShellAt(double range_m) const {
  const double growth = std::log2(radius_.At(range_m) / radius_.constant_m);
  return std::min(static_cast<std::size_t>(std::floor(2.0 * growth + 0.5)), shells_.size() - 1);
}

std::uint32_t RangeGrid::Add(const Eigen::Vector3f& point_m, std::uint32_t bin,
                             std::uint32_t count) {
  // The shells with a place near enough: a block reaches two edges along each axis.
  const double range_m = static_cast<double>(point_m.norm());
  const auto reach_m = [&](std::size_t shell) {
    return 2.0 * std::sqrt(3.0) * shells_[shell].edge_m;
  };
  const std::size_t home = ShellAt(range_m);
  std::size_t first = home;
  std::size_t last = home;
  while (first > 0 && range_m - shells_[first].begin_m <= reach_m(first - 1)) --first;
  while (last + 1 < shells_.size() && shells_[last + 1].begin_m - range_m <= reach_m(last + 1)) {
    ++last;
  }
  std::uint32_t place_of_home = 0;
  for (std::size_t shell = first; shell <= last; ++shell) {
    const VoxelKey key = VoxelOf(point_m, shells_[shell].edge_m);
    const auto [place, is_new] = shells_[shell].places.try_emplace(key, num_places());
    if (is_new) profiles_.emplace_back();
    if (shell == home) place_of_home = place->second;
    Profile& profile = profiles_[place->second];
    profile.total += count;
    auto at = profile.bins.end();  // as points mostly come in order of time
    if (at != profile.bins.begin() && profile.bins.back().bin >= bin) {
      at = std::lower_bound(profile.bins.begin(), profile.bins.end(), bin,
                            [](const BinCount& a, std::uint32_t b) { return a.bin < b; });
    }
    if (at == profile.bins.end() || at->bin != bin) at = profile.bins.insert(at, {bin, 0});
    at->count += count;
  }
  return place_of_home;
}

template <class Visit>
void RangeGrid::VisitBlock(const Eigen::Vector3f& point_m, const Visit& visit) const {
  const Shell& shell = shells_[ShellAt(static_cast<double>(point_m.norm()))];
  const Voxel home = VoxelAt(point_m, shell.edge_m);
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const auto place = shell.places.find(KeyOf({home.x + dx, home.y + dy, home.z + dz}));
        if (place != shell.places.end()) visit(profiles_[place->second]);
      }
    }
  }
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m) const {
  std::uint32_t sum = 0;
  VisitBlock(point_m, [&](const Profile& profile) { sum += profile.total; });
  return sum;
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m, BinRange bins) const {
  std::uint32_t sum = 0;
  VisitBlock(point_m, [&](const Profile& profile) {
    auto at = std::lower_bound(profile.bins.begin(), profile.bins.end(), bins.first,
                               [](const BinCount& a, std::uint32_t b) { return a.bin < b; });
    for (; at != profile.bins.end() && at->bin < bins.last; ++at) sum += at->count;
  });
  return sum;
}

void RangeGrid::InsertBins(const Eigen::Vector3f& point_m, BinSet* bins) const {
  VisitBlock(point_m, [&](const Profile& profile) {
    for (const BinCount& at : profile.bins) bins->Insert(at.bin);
  });
}

double RangeGrid::VolumeM3(const Eigen::Vector3f& point_m) const {
  return std::pow(3.0 * shells_[ShellAt(static_cast<double>(point_m.norm()))].edge_m, 3);
}

}  // namespace unlidar
