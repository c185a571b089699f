#include "scene/range_grid.hpp"

#include <algorithm>
#include <utility>

namespace unlidar {

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

std::uint32_t RangeGrid::NewBinCount(const BinCount& value) {
  if (free_ == kNone) {
    bin_counts_.push_back(value);
    return static_cast<std::uint32_t>(bin_counts_.size() - 1);
  }
  const std::uint32_t index = std::exchange(free_, bin_counts_[free_].earlier);
  bin_counts_[index] = value;
  return index;
}

void RangeGrid::Add(const Eigen::Vector3f& point_m, std::uint32_t bin, std::int32_t count) {
  ++version_;
  places_.VisitOverlappingShells(point_m, {}, [&](std::uint32_t, Profile& profile, bool) {
    profile.total += count;
    // Points arrive mostly in temporal order.
    std::uint32_t later = kNone;
    std::uint32_t at = profile.latest;
    while (at != kNone && bin_counts_[at].bin > bin) {
      later = at;
      at = bin_counts_[at].earlier;
    }
    if (at != kNone && bin_counts_[at].bin == bin) {
      bin_counts_[at].count += count;
      return;
    }
    const std::uint32_t added = NewBinCount({bin, count, at});
    (later == kNone ? profile.latest : bin_counts_[later].earlier) = added;
  });
}

void RangeGrid::Forget(std::uint32_t before_bin) {
  ++version_;
  places_.EraseIf([&](Profile& profile) {
    std::uint32_t* end = &profile.latest;
    while (*end != kNone && bin_counts_[*end].bin >= before_bin) end = &bin_counts_[*end].earlier;
    for (std::uint32_t at = std::exchange(*end, kNone); at != kNone;) {
      profile.total -= bin_counts_[at].count;
      const std::uint32_t earlier = std::exchange(bin_counts_[at].earlier, free_);
      free_ = std::exchange(at, earlier);
    }
    return profile.latest == kNone;
  });
}

// Sums `count_of(profile)` over the neighbourhood of a point, unless it is known.
template <class CountOf>
std::uint32_t RangeGrid::SumAround(const Eigen::Vector3f& point_m, BinRange bins,
                                   Counted CountedTwice::*which, const CountOf& count_of) const {
  Counted* known = nullptr;
  if (count_cache_ == CountCache::kPerVoxel) {
    if (counted_.size() < places_.size()) counted_.resize(places_.size());
    const std::uint32_t number = places_.NumberOf(point_m);
    if (number != VoxelNumbers::kNone) known = &(counted_[number].*which);
    if (known != nullptr && known->version == version_ && known->bins == bins) {
      return static_cast<std::uint32_t>(known->count);
    }
  }
  std::int32_t sum = 0;
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) { sum += count_of(profile); });
  if (known != nullptr) *known = {version_, sum, bins};
  return static_cast<std::uint32_t>(sum);
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m) const {
  return SumAround(point_m, {}, &CountedTwice::all,
                   [](const Profile& profile) { return profile.total; });
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m, BinRange bins) const {
  return SumAround(point_m, bins, &CountedTwice::some, [&](const Profile& profile) {
    std::int32_t sum = 0;
    for (std::uint32_t at = profile.latest; at != kNone && bin_counts_[at].bin >= bins.first;
         at = bin_counts_[at].earlier) {
      if (bin_counts_[at].bin < bins.last) sum += bin_counts_[at].count;
    }
    return sum;
  });
}

void RangeGrid::InsertBins(const Eigen::Vector3f& point_m, BinSet* bins) const {
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) {
    for (std::uint32_t at = profile.latest; at != kNone; at = bin_counts_[at].earlier) {
      if (bin_counts_[at].count > 0) bins->Insert(bin_counts_[at].bin);
    }
  });
}

}  // namespace unlidar
