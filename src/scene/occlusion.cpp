#include "scene/occlusion.hpp"

#include <algorithm>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

constexpr float kMarginM = 2.0F;  // an occluder is nearer than the place by more than its own size
constexpr float kQuantumM = 0.05F;
constexpr std::uint16_t kNothing = 0xFFFF;
constexpr std::uint32_t kNone = ~std::uint32_t{0};
// Medians need few returns: of a larger frame every second, third, ... is taken.
constexpr std::size_t kEnoughReturns = 4096;

std::uint16_t QuantaOf(float range_m) {
  return static_cast<std::uint16_t>(std::min(range_m / kQuantumM, kNothing - 1.0F));
}

// A place may have been seen from this much farther than now.
constexpr float kFarther = 1.25F;

// True if the median of a direction is nearer than a place by more than its own size.
bool IsNearer(std::uint16_t quanta, float range_m) {
  return static_cast<float>(quanta) * kQuantumM < range_m - kMarginM;
}

}  // namespace

Occlusion::Occlusion() : rows_(DirectionCells::kCount, kNone), carriers_(RecentBins::kWindow) {}

void Occlusion::Add(PointsView points_m, std::int64_t bin, const CarrierPose& carrier) {
  field_of_view_.AddFrame(points_m, carrier);
  if (bin < bin_) return;
  while (bin_ < bin) {
    FinishBin();
    bin_ = std::max(bin_ + 1, bin - RecentBins::kWindow + 1);
    carriers_[RecentBins::SlotOf(bin_)] = carrier;
  }
  const std::size_t step = 1 + points_m.size() / kEnoughReturns;
  for (std::size_t i = 0; i < points_m.size(); i += step) {
    const Eigen::Vector3f ray_m = points_m[i] - carrier.shift_m;
    cell_of_.push_back(static_cast<std::uint32_t>(DirectionCells::CellOf(ray_m)));
    quanta_.push_back(QuantaOf(ray_m.norm()));
  }
}

// Replaces the depths of the bin that left the window.
void Occlusion::FinishBin() {
  if (bin_ < 0) return;
  const std::size_t slot = RecentBins::SlotOf(bin_);
  for (std::size_t at = slot; at < depths_.size(); at += RecentBins::kWindow)
    depths_[at] = kNothing;
  sorted_.resize(quanta_.size());
  SortByGroup(cell_of_, rows_.size(), &begins_,
              [&](std::size_t i, std::uint32_t at) { sorted_[at] = quanta_[i]; });
  for (std::size_t cell = 0; cell < rows_.size(); ++cell) {
    const auto begin = sorted_.begin() + begins_[cell];
    const auto end = sorted_.begin() + begins_[cell + 1];
    if (begin == end) continue;
    if (rows_[cell] == kNone) {
      rows_[cell] = static_cast<std::uint32_t>(depths_.size());
      depths_.resize(depths_.size() + RecentBins::kWindow, kNothing);
    }
    depths_[rows_[cell] + slot] = NthSmallest(begin, end, (end - begin) / 2);
  }
  cell_of_.clear();
  quanta_.clear();
}

Occlusion::Hidden Occlusion::HiddenBins(const Eigen::Vector3f& place_m, std::int64_t bin,
                                        std::int64_t newest) const {
  Hidden hidden;
  if (!field_of_view_.is_carrier_moving()) {
    // All bins are of one direction, and most hide nothing.
    const std::uint32_t row = rows_[DirectionCells::CellOf(place_m)];
    if (row == kNone) return hidden;
    const std::uint16_t* const depths = depths_.data() + row;
    const float range_m = place_m.norm();
    const auto num_used = static_cast<int>(std::min<std::int64_t>(bin_, RecentBins::kWindow));
    std::uint16_t nearest = kNothing;
    for (int slot = 0; slot < num_used; ++slot) nearest = std::min(nearest, depths[slot]);
    if (!IsNearer(nearest, range_m)) return hidden;
    for (int slot = 0; slot < num_used; ++slot) {
      if (IsNearer(depths[slot], range_m)) Insert(slot, newest, &hidden.behind);
    }
    return hidden;
  }
  const float farthest_m = kFarther * (place_m - carriers_[RecentBins::SlotOf(bin)].shift_m).norm();
  for (int slot = 0; slot < RecentBins::kWindow; ++slot) {
    const auto at = static_cast<std::size_t>(slot);
    const CarrierPose& carrier = carriers_[at];
    const Eigen::Vector3f ray_m = place_m - carrier.shift_m;
    const float range_m = ray_m.norm();
    if (range_m > farthest_m || !field_of_view_.Contains(carrier.rotation.conjugate() * ray_m)) {
      Insert(slot, newest, &hidden.unseen);
      continue;
    }
    const std::uint32_t row = rows_[DirectionCells::CellOf(ray_m)];
    if (row != kNone && IsNearer(depths_[row + at], range_m)) {
      Insert(slot, newest, &hidden.behind);
    }
  }
  return hidden;
}

// Inserts the last bin of a slot before bin_ by its age.
void Occlusion::Insert(int slot, std::int64_t newest, RecentBins* bins) const {
  const std::int64_t last = bin_ - 1;
  const std::int64_t bin =
      last - ((last - slot) % RecentBins::kWindow + RecentBins::kWindow) % RecentBins::kWindow;
  const std::int64_t age = newest - bin;
  if (bin < 0 || age >= RecentBins::kWindow) return;
  bins->Insert(static_cast<int>(age));
  if (bin == last) bins->Insert(static_cast<int>(age) - 1);
}

const Eigen::Vector3f& Occlusion::ViewpointM() const {
  return carriers_[RecentBins::SlotOf(std::max<std::int64_t>(bin_, 0))].shift_m;
}

}  // namespace unlidar
