#include "live/track_fit.hpp"

#include <algorithm>
#include <iterator>

namespace unlidar {
namespace {

constexpr TimeNs kScalesNs = 1'500'000'000;  // reuse of the scales of a fit

}  // namespace

void TrackFit::Clear() {
  measurements_.clear();
  plot_refs_.clear();
}

void TrackFit::AddEarlier(const Measurement& measurement, const PlotRef& plot_ref) {
  measurements_.push_back(measurement);
  plot_refs_.push_back(plot_ref);
}

void TrackFit::Fit(TrajectoryFitter& fitter) {
  SortByTime();
  const TimeNs now_ns = measurements_.back().time_ns;
  if (scales_ns_ && now_ns - *scales_ns_ <= kScalesNs) {
    fitter.Refit(measurements_, trajectory_.scales, trajectory_);
    if (!IsNewestOutlier()) return;
  }
  fitter.Fit(measurements_, trajectory_);
  scales_ns_ = now_ns;
}

// Insertion sort: nearly sorted, except for plots of one frame or of several sensors; does not
// allocate.
void TrackFit::SortByTime() {
  std::reverse(measurements_.begin(), measurements_.end());
  std::reverse(plot_refs_.begin(), plot_refs_.end());
  for (auto at = measurements_.begin(); at != measurements_.end(); ++at) {
    const auto place = std::upper_bound(
        measurements_.begin(), at, *at,
        [](const Measurement& a, const Measurement& b) { return a.time_ns < b.time_ns; });
    const auto plot_ref = plot_refs_.begin() + (at - measurements_.begin());
    std::rotate(plot_refs_.begin() + (place - measurements_.begin()), plot_ref,
                std::next(plot_ref));
    std::rotate(place, at, std::next(at));
  }
}

// True if a measurement newer than the scales is an outlier. With the scales of a hover, a
// departing target is one.
bool TrackFit::IsNewestOutlier() const {
  for (std::size_t i = measurements_.size(); i > 0; --i) {
    if (measurements_[i - 1].time_ns <= *scales_ns_) return false;
    if (IsOutlier(i - 1)) return true;
  }
  return false;
}

bool TrackFit::IsInlier(const Plot& plot) const {
  for (std::size_t i = 0; i < plot_refs_.size(); ++i) {
    if (plot_refs_[i].frame == plot.frame && plot_refs_[i].position_m == plot.position_m) {
      return !IsOutlier(i);
    }
  }
  return false;
}

std::vector<Measurement> TrackFit::InlierMeasurements() const {
  std::vector<Measurement> fitted;
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    if (!IsOutlier(i)) fitted.push_back(measurements_[i]);
  }
  return fitted;
}

int TrackFit::ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const {
  int sum = 0;
  for (const PlotRef& one : plot_refs_) {
    if (one.stamp_ns >= from_ns && one.stamp_ns < to_ns) sum += one.num_returns;
  }
  return sum;
}

}  // namespace unlidar
