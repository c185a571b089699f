#include "scene/range_grid.hpp"

#include <algorithm>
#include <utility>

namespace unlidar {

std::uint32_t RangeGrid::NewBinCount(const BinCount& value) {
  if (free_ == kNone) {
    bin_counts_.push_back(value);
    return static_cast<std::uint32_t>(bin_counts_.size() - 1);
  }
  const std::uint32_t index = std::exchange(free_, bin_counts_[free_].earlier);
  bin_counts_[index] = value;
  return index;
}

// Frees a bin and all earlier ones of its voxel.
void RangeGrid::Free(std::uint32_t first) {
  for (std::uint32_t at = first; at != kNone;) {
    const std::uint32_t earlier = std::exchange(bin_counts_[at].earlier, free_);
    free_ = std::exchange(at, earlier);
  }
}

void RangeGrid::Add(const Eigen::Vector3f& point_m, std::uint32_t bin, std::int32_t count) {
  ++version_;
  places_.VisitOverlappingShells({&point_m, 1}, {}, [&](std::size_t, Profile& profile, bool) {
    profile.total += count;
    // Points arrive mostly in temporal order.
    BinCount& latest = profile.latest;
    if (latest.bin == bin) {
      latest.count += count;
    } else if (latest.bin == kNone) {
      latest = {bin, count, kNone};
    } else if (latest.bin < bin) {
      const std::uint32_t before = NewBinCount(latest);
      latest = {bin, count, before};
    } else {
      std::uint32_t later = kNone;
      std::uint32_t at = latest.earlier;
      while (at != kNone && bin_counts_[at].bin > bin) {
        later = at;
        at = bin_counts_[at].earlier;
      }
      if (at != kNone && bin_counts_[at].bin == bin) {
        bin_counts_[at].count += count;
        return;
      }
      const std::uint32_t added = NewBinCount({bin, count, at});
      (later == kNone ? latest.earlier : bin_counts_[later].earlier) = added;
    }
  });
}

void RangeGrid::Forget(std::uint32_t before_bin) {
  ++version_;
  places_.EraseIf([&](Profile& profile) {
    if (profile.latest.bin < before_bin) {
      Free(profile.latest.earlier);
      return true;
    }
    std::uint32_t* end = &profile.latest.earlier;
    while (*end != kNone && bin_counts_[*end].bin >= before_bin) end = &bin_counts_[*end].earlier;
    for (std::uint32_t at = *end; at != kNone; at = bin_counts_[at].earlier) {
      profile.total -= bin_counts_[at].count;
    }
    Free(std::exchange(*end, kNone));
    return false;
  });
}

// Calls visit(bin_count) for the bins of a voxel from its latest on, while it returns true.
template <class Visit>
void RangeGrid::VisitBins(const Profile& profile, const Visit& visit) const {
  if (!visit(profile.latest)) return;
  for (std::uint32_t at = profile.latest.earlier; at != kNone; at = bin_counts_[at].earlier) {
    if (!visit(bin_counts_[at])) return;
  }
}

// Sums `count_of(profile)` over the neighbourhood of a point, unless it is known.
template <class CountOf>
std::uint32_t RangeGrid::SumAround(const Eigen::Vector3f& point_m, BinRange bins, std::size_t which,
                                   const CountOf& count_of) const {
  Counted* known = nullptr;
  std::uint32_t voxel = VoxelNumbers::kNone;
  if (count_cache_ == CountCache::kPerVoxel) voxel = places_.NumberOf(point_m);
  if (voxel != VoxelNumbers::kNone) {
    if (counted_.empty()) counted_.resize(kNumCounted);
    known = &counted_[voxel % kNumCounted][which];
    if (known->version == version_ && known->voxel == voxel && known->bins == bins) {
      return static_cast<std::uint32_t>(known->count);
    }
  }
  std::int32_t sum = 0;
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) { sum += count_of(profile); });
  if (known != nullptr) *known = {version_, voxel, sum, bins};
  return static_cast<std::uint32_t>(sum);
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m) const {
  return SumAround(point_m, {}, 0, [](const Profile& profile) { return profile.total; });
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m, BinRange bins) const {
  return SumAround(point_m, bins, 1, [&](const Profile& profile) {
    std::int32_t sum = 0;
    VisitBins(profile, [&](const BinCount& at) {
      if (at.bin < bins.first) return false;
      if (at.bin < bins.last) sum += at.count;
      return true;
    });
    return sum;
  });
}

BinRange RangeGrid::SpanOf(const Eigen::Vector3f& point_m) const {
  BinRange span{kNone, 0};
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) {
    VisitBins(profile, [&](const BinCount& at) {
      if (at.count > 0) span = {std::min(span.first, at.bin), std::max(span.last, at.bin + 1)};
      return true;
    });
  });
  return span;
}

}  // namespace unlidar
