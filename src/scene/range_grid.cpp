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

std::uint32_t RangeGrid::Add(const Eigen::Vector3f& point_m, std::uint32_t bin,
                             std::uint32_t count) {
  std::uint32_t own_place = 0;
  places_.VisitOverlappingShells(
      point_m, {}, [&](std::uint32_t place, Profile& profile, bool is_own) {
        if (is_own) own_place = place;
        profile.total += count;
        BinCount& latest = profile.latest;
        if (latest.count == 0) {
          latest = {bin, count};
        } else if (bin == latest.bin) {
          latest.count += count;
        } else if (bin > latest.bin) {  // points arrive mostly in temporal order
          profile.bins.push_back(std::exchange(latest, {bin, count}));
        } else {
          const auto at =
              std::lower_bound(profile.bins.begin(), profile.bins.end(), bin, IsEarlier);
          if (at != profile.bins.end() && at->bin == bin) {
            at->count += count;
          } else {
            profile.bins.insert(at, {bin, count});
          }
        }
      });
  return own_place;
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m) const {
  std::uint32_t sum = 0;
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) { sum += profile.total; });
  return sum;
}

std::uint32_t RangeGrid::Count(const Eigen::Vector3f& point_m, BinRange bins) const {
  std::uint32_t sum = 0;
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) {
    auto at = std::lower_bound(profile.bins.begin(), profile.bins.end(), bins.first, IsEarlier);
    for (; at != profile.bins.end() && at->bin < bins.last; ++at) sum += at->count;
    const BinCount& latest = profile.latest;
    if (bins.first <= latest.bin && latest.bin < bins.last) sum += latest.count;
  });
  return sum;
}

void RangeGrid::InsertBins(const Eigen::Vector3f& point_m, BinSet* bins) const {
  places_.VisitNeighbourhood(point_m, [&](const Profile& profile) {
    for (const BinCount& at : profile.bins) bins->Insert(at.bin);
    if (profile.latest.count > 0) bins->Insert(profile.latest.bin);
  });
}

}  // namespace unlidar
