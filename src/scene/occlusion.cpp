#include "scene/occlusion.hpp"

#include <algorithm>

namespace unlidar {
namespace {

constexpr float kMarginM = 2.0F;  // an occluder is nearer than the place by more than its own size
constexpr float kQuantumM = 0.05F;
constexpr std::uint32_t kRangeBits = 16;
constexpr std::uint16_t kNothing = 0xFFFF;
constexpr std::uint32_t kNone = ~std::uint32_t{0};
// Medians need few returns: of a larger frame every second, third, ... is taken.
constexpr std::size_t kEnoughReturns = 4096;

std::uint16_t QuantaOf(float range_m) {
  return static_cast<std::uint16_t>(std::min(range_m / kQuantumM, kNothing - 1.0F));
}

std::size_t SlotOf(std::int64_t bin) { return static_cast<std::size_t>(bin % RecentBins::kWindow); }

}  // namespace

Occlusion::Occlusion() : cells_(kHidingCellDeg), rows_(cells_.size(), kNone) {}

void Occlusion::Add(PointsView points_m, std::int64_t bin) {
  if (bin < bin_) return;
  while (bin_ < bin) {
    FinishBin();
    bin_ = std::max(bin_ + 1, bin - RecentBins::kWindow + 1);
  }
  const std::size_t step = 1 + points_m.size() / kEnoughReturns;
  for (std::size_t i = 0; i < points_m.size(); i += step) {
    returns_.push_back(static_cast<std::uint32_t>(cells_.CellOf(points_m[i])) << kRangeBits |
                       QuantaOf(points_m[i].norm()));
  }
}

// Replaces the depths of the bin that left the window.
void Occlusion::FinishBin() {
  if (bin_ < 0) return;
  const std::size_t slot = SlotOf(bin_);
  for (std::size_t at = slot; at < depths_.size(); at += RecentBins::kWindow)
    depths_[at] = kNothing;
  std::sort(returns_.begin(), returns_.end());
  for (auto begin = returns_.begin(); begin != returns_.end();) {
    const std::uint32_t cell = *begin >> kRangeBits;
    const auto end = std::find_if(begin, returns_.end(),
                                  [&](std::uint32_t one) { return one >> kRangeBits != cell; });
    if (rows_[cell] == kNone) {
      rows_[cell] = static_cast<std::uint32_t>(depths_.size());
      depths_.resize(depths_.size() + RecentBins::kWindow, kNothing);
    }
    depths_[rows_[cell] + slot] = static_cast<std::uint16_t>(*(begin + (end - begin) / 2));
    begin = end;
  }
  returns_.clear();
}

RecentBins Occlusion::HiddenBins(const Eigen::Vector3f& place_m, std::int64_t newest) const {
  RecentBins hidden;
  const float visible_m = place_m.norm() - kMarginM;
  if (visible_m <= 0.0F) return hidden;
  const std::uint32_t row = rows_[cells_.CellOf(place_m)];
  if (row == kNone) return hidden;
  const std::uint16_t* const depths = depths_.data() + row;
  for (int slot = 0; slot < RecentBins::kWindow; ++slot) {
    if (static_cast<float>(depths[slot]) * kQuantumM >= visible_m) continue;
    // The last bin of this slot before bin_.
    const std::int64_t last = bin_ - 1;
    const std::int64_t bin =
        last - ((last - slot) % RecentBins::kWindow + RecentBins::kWindow) % RecentBins::kWindow;
    const std::int64_t age = newest - bin;
    if (bin < 0 || age >= RecentBins::kWindow) continue;
    hidden.Insert(static_cast<int>(age));
    if (bin == last) hidden.Insert(static_cast<int>(age) - 1);
  }
  return hidden;
}

}  // namespace unlidar
