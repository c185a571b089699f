#include "live/track_fit.hpp"

#include <algorithm>
#include <iterator>

namespace unlidar {
namespace {

constexpr TimeNs kScalesNs = 1'500'000'000;  // how long the scales of a fit last

}  // namespace

void TrackFit::Clear() {
  measurements_.clear();
  sightings_.clear();
}

void TrackFit::AddEarlier(const Measurement& measurement, const Sighting& sighting) {
  measurements_.push_back(measurement);
  sightings_.push_back(sighting);
}

void TrackFit::Fit(TrajectoryFitter& fitter) {
  SortByTime();
  const TimeNs now_ns = measurements_.back().time_ns;
  if (scales_ns_ && now_ns - *scales_ns_ <= kScalesNs) {
    fitter.Refit(measurements_, trajectory_.scales, trajectory_);
    if (!IsNewLeftOut()) return;
  }
  fitter.Fit(measurements_, trajectory_);
  scales_ns_ = now_ns;
}

// They come by time but for plots of one frame or of several sensors, and without allocating.
void TrackFit::SortByTime() {
  std::reverse(measurements_.begin(), measurements_.end());
  std::reverse(sightings_.begin(), sightings_.end());
  for (auto at = measurements_.begin(); at != measurements_.end(); ++at) {
    const auto place = std::upper_bound(
        measurements_.begin(), at, *at,
        [](const Measurement& a, const Measurement& b) { return a.time_ns < b.time_ns; });
    const auto sighting = sightings_.begin() + (at - measurements_.begin());
    std::rotate(sightings_.begin() + (place - measurements_.begin()), sighting,
                std::next(sighting));
    std::rotate(place, at, std::next(at));
  }
}

// Whether the fit takes what came since its scales were found for an outlier. A target that sets
// off from where it hovered is one by scales of before.
bool TrackFit::IsNewLeftOut() const {
  for (std::size_t i = measurements_.size(); i > 0; --i) {
    if (measurements_[i - 1].time_ns <= *scales_ns_) return false;
    if (IsLeftOut(i - 1)) return true;
  }
  return false;
}

bool TrackFit::HasFitted(const Plot& plot) const {
  for (std::size_t i = 0; i < sightings_.size(); ++i) {
    if (sightings_[i].frame == plot.frame && sightings_[i].position_m == plot.position_m) {
      return !IsLeftOut(i);
    }
  }
  return false;
}

std::vector<Measurement> TrackFit::FittedMeasurements() const {
  std::vector<Measurement> fitted;
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    if (!IsLeftOut(i)) fitted.push_back(measurements_[i]);
  }
  return fitted;
}

int TrackFit::ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const {
  int sum = 0;
  for (const Sighting& one : sightings_) {
    if (one.stamp_ns >= from_ns && one.stamp_ns < to_ns) sum += one.num_returns;
  }
  return sum;
}

}  // namespace unlidar
