// Rates of returns at places, and of the strays before them.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/maths.hpp"
#include "scene/occupancy.hpp"

namespace unlidar {
namespace {

// Places between the viewpoint and a place at which strays are looked for.
constexpr std::array<float, 2> kSharesOfRay{0.5F, 0.75F};
constexpr double kChanceSigmas = 2.0;
constexpr double kMaxOccupancy = 0.999;  // the rate of a place that is always hit is unbounded

// Hits per bin of a Poisson process that hits a place in `occupied` of `exposed` bins.
double HitsPerBin(double occupied, double exposed) {
  return -std::log1p(-std::min(kMaxOccupancy, occupied / exposed));
}

}  // namespace

// Place at a share of the way from the viewpoint to another.
Eigen::Vector3f Occupancy::NearerPlaceM(const Eigen::Vector3f& point_m, float share) const {
  const Eigen::Vector3f& viewpoint_m = occlusion_.ViewpointM();
  return viewpoint_m + share * (point_m - viewpoint_m);
}

RecentBins Occupancy::HitsOf(const Place& place) const {
  RecentBins hits = place.hits;
  hits.Age(newest_ - place.bin);
  return hits;
}

RecentBins Occupancy::HitsAround(const Eigen::Vector3f& point_m) const {
  RecentBins hits;
  places_.VisitNeighbourhood(point_m, [&](const Place& place) { hits |= HitsOf(place); });
  return hits;
}

// Returns per frame and m^3 at a place that is hit in `occupied` of `exposed` bins, by a Poisson
// process.
double Occupancy::RateOf(double occupied, double exposed, const Eigen::Vector3f& point_m) const {
  return HitsPerBin(occupied, exposed) * observed_.Size() / num_frames_ / places_.VolumeM3(point_m);
}

double Occupancy::RateOutside(const Eigen::Vector3f& place_m, std::int64_t first,
                              std::int64_t last) const {
  const auto age_of = [&](std::int64_t bin) {
    return static_cast<int>(std::clamp<std::int64_t>(newest_ - bin, -1, RecentBins::kWindow));
  };
  const int youngest = std::max(age_of(last - 1), 0);
  const int oldest = age_of(first);
  RecentBins visible = observed_;
  if (field_of_view().is_carrier_moving()) {
    const std::int64_t bin =
        std::clamp<std::int64_t>(last - 1, newest_ - RecentBins::kWindow + 1, newest_);
    visible =
        observed_ - occlusion_.HiddenBins(place_m, std::max<std::int64_t>(bin, 0), newest_).unseen;
  }
  const int num_outside = visible.SizeOutside(youngest, oldest);
  if (num_outside < MinExposed()) return -1.0;
  double num_returns = 0.0;
  places_.VisitNeighbourhood(place_m,
                             [&](const Place& place) { num_returns += place.num_returns; });
  const RecentBins hits = HitsAround(place_m);
  const double share = hits.SizeOutside(youngest, oldest) / std::max<double>(hits.Size(), 1.0);
  const double num_frames = static_cast<double>(num_frames_) * num_outside / observed_.Size();
  return std::max(kJeffreysCount, share * num_returns) / (num_frames * places_.VolumeM3(place_m));
}

double Occupancy::RateThroughout(const RecentBins& hits, const Eigen::Vector3f& point_m) const {
  return RateOf((hits & observed_).Size(), observed_.Size(), point_m);
}

double Occupancy::UsualStrayRate(const Eigen::Vector3f& point_m) const {
  if (!knows_strays_) return 0.0;
  double rate = std::numeric_limits<double>::infinity();
  for (const float share : kSharesOfRay) {
    const Eigen::Vector3f nearer_m = NearerPlaceM(point_m, share);
    const RecentBins hits = HitsAround(nearer_m);
    // A single bin may be a passing target.
    if ((hits & observed_).Size() <= 1) return 0.0;
    rate = std::min(rate, RateThroughout(hits, nearer_m));
  }
  return rate;
}

// Returns the rate of a place by how often each of its voxels is hit. Where strays and crowns both
// fill a place in every bin, strays still hit a voxel of it seldom. A target that is in a voxel at
// `age` is left out if that leaves enough to judge by.
double Occupancy::VoxelRate(const Eigen::Vector3f& point_m, std::optional<int> age) const {
  const int num_observed = observed_.Size();
  double hits_per_bin = 0.0;
  places_.VisitNeighbourhood(point_m, [&](const Place& place) {
    const RecentBins hits = HitsOf(place);
    double occupied = hits.Size();
    double exposed = num_observed;
    if (age) {
      const Dwell dwell = DwellAt(hits, *age, max_break_);
      const int outside = observed_.SizeOutside(dwell.youngest, dwell.oldest);
      if (outside >= MinExposed()) {
        exposed = outside;
        occupied = hits.SizeOutside(dwell.youngest, dwell.oldest);
      }
    }
    hits_per_bin += HitsPerBin(occupied, exposed);
  });
  return hits_per_bin * num_observed / num_frames_ / places_.VolumeM3(point_m);
}

// Same in these of the observed bins if each voxel is hit as often as the others, as strays hit
// them. Surfaces before a place fill some voxels in every bin, and leave the rest empty: summed
// over these, they would explain anything behind them.
double Occupancy::EvenRate(const Eigen::Vector3f& point_m, const RecentBins& bins) const {
  double num_hits = 0.0;
  places_.VisitNeighbourhood(
      point_m, [&](const Place& place) { num_hits += (HitsOf(place) & bins).Size(); });
  constexpr double kNumVoxels = ShellTable<Place>::kNumNeighbourhoodVoxels;
  return kNumVoxels * RateOf(num_hits, kNumVoxels * bins.Size(), point_m);
}

StrayRate Occupancy::StrayRateIn(const Eigen::Vector3f& point_m, std::int64_t bin) const {
  StrayRate rate{UsualStrayRate(point_m), 0.0};
  const auto age = static_cast<int>(newest_ - bin);
  if (rate.usual == 0.0 || age < 0 || age + 1 >= RecentBins::kWindow) return rate;
  RecentBins present;
  present.Insert(age);
  present.Insert(age + 1);
  present = present & observed_;
  rate.present = std::numeric_limits<double>::infinity();
  for (const float share : kSharesOfRay) {
    const Eigen::Vector3f nearer_m = NearerPlaceM(point_m, share);
    rate.present = std::min(rate.present, EvenRate(nearer_m, present));
  }
  return rate;
}

// False if a place has a larger VoxelRate() than strays before it explain, beyond chance. Rays
// spread, and a metre of a ray returns no more strays the farther away it is, so that their density
// falls with the square of range at least.
bool Occupancy::AreStraysEnough(const Eigen::Vector3f& point_m, double voxel_rate) const {
  const auto variance = [&](const Eigen::Vector3f& at_m, double rate) {
    return rate / (num_frames_ * places_.VolumeM3(at_m));
  };
  const double own_variance = Square(kMinStrayShare) * variance(point_m, voxel_rate);
  return std::all_of(kSharesOfRay.begin(), kSharesOfRay.end(), [&](float share) {
    const Eigen::Vector3f nearer_m = NearerPlaceM(point_m, share);
    const double nearer_rate = EvenRate(nearer_m, observed_);
    const double spread = Square(static_cast<double>(share));
    const double sigma = std::sqrt(own_variance + Square(spread) * variance(nearer_m, nearer_rate));
    return kMinStrayShare * voxel_rate - spread * nearer_rate < kChanceSigmas * sigma;
  });
}

}  // namespace unlidar
