#include "scene/watched_elevations.hpp"

#include <algorithm>
#include <numeric>

namespace unlidar {
namespace {

// A band is watched if it has this share of the mean of the bands within two degrees: what stands
// there makes some bands richer than others, but not by as much as beams those between them.
constexpr std::ptrdiff_t kBandsBeside = 20;
constexpr double kMinShareOfMean = 0.05;
constexpr double kLeastRangeM = 1e-6;  // what is nearer has no direction
constexpr std::uint32_t kMaxReturns = 1U << 30U;

}  // namespace

WatchedElevations::WatchedElevations() {
  std::iota(watched_below_.begin(), watched_below_.end(), 0.0F);
}

void WatchedElevations::AddFrame(PointsView points_m, const CarrierPose& carrier) {
  const Eigen::Vector3f up = carrier.rotation * Eigen::Vector3f::UnitZ();
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    const Eigen::Vector3f ray_m = points_m[i] - carrier.shift_m;
    const float range_m = ray_m.norm();
    if (range_m < kLeastRangeM) continue;
    const float share = (1.0F + up.dot(ray_m) / range_m) / 2.0F;
    const auto band = static_cast<std::size_t>(share * static_cast<float>(kBands));
    ++returns_[std::min(band, kBands - 1)];
  }
  num_returns_ += static_cast<std::uint32_t>(points_m.size());
  if (num_returns_ < kMaxReturns) return;
  for (std::uint32_t& returns : returns_) returns /= 2;
  num_returns_ /= 2;
}

void WatchedElevations::Update() {
  const auto num_bands = static_cast<std::ptrdiff_t>(kBands);
  for (std::ptrdiff_t band = 0; band < num_bands; ++band) {
    const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, band - kBandsBeside);
    const std::ptrdiff_t last = std::min(num_bands, band + kBandsBeside + 1);
    const double mean = std::accumulate(returns_.begin() + first, returns_.begin() + last, 0.0) /
                        static_cast<double>(last - first);
    const auto b = static_cast<std::size_t>(band);
    const bool is_watched = returns_[b] > 0 && returns_[b] > kMinShareOfMean * mean;
    watched_below_[b + 1] = watched_below_[b] + (is_watched ? 1.0F : 0.0F);
  }
}

double WatchedElevations::Share(const Eigen::Vector3d& from_m, const Eigen::Vector3d& to_m) const {
  const auto at = [](const Eigen::Vector3d& ray_m) {
    const double range_m = std::max(ray_m.norm(), kLeastRangeM);
    return (1.0 + ray_m.z() / range_m) / 2.0 * static_cast<double>(kBands);
  };
  const auto below = [this](double bands) {
    const std::size_t band = std::min(static_cast<std::size_t>(bands), kBands - 1);
    const double first = watched_below_[band];
    return first + (bands - static_cast<double>(band)) * (watched_below_[band + 1] - first);
  };
  const double from = at(from_m);
  const double to = at(to_m);
  return to > from ? (below(to) - below(from)) / (to - from) : 1.0;
}

}  // namespace unlidar
