#include "unlidar/robust/background.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "unlidar/robust/depth_map.hpp"

namespace unlidar {
namespace {

// When a place was hit and when it could have been, summed up so that each stay there is judged in
// constant time, however long the recording.
class PlaceHistory {
 public:
  // What the bins outside a stay show.
  struct Rest {
    double num_exposed = 0.0;
    double num_occupied = 0.0;
  };

  // All per bin. `profile`: returns at the place; `depths_m`: of what is seen in its direction,
  // which hides the place if it is nearer than `visible_m`. A stay is occupied bins with breaks of
  // at most `max_break` bins.
  void Assign(const std::vector<std::uint32_t>& profile, const std::vector<char>& is_watched,
              const float* depths_m, double visible_m, std::size_t max_break) {
    const std::size_t n = profile.size();
    sums_.assign(n + 1, {});
    is_behind_.resize(n);
    stay_of_.resize(n);
    stays_.clear();
    for (std::size_t b = 0; b < n; ++b) {
      is_behind_[b] = static_cast<double>(depths_m[b]) < visible_m;
      const bool is_occupied = profile[b] > 0;
      Sums& sums = sums_[b + 1];
      sums = sums_[b];
      if (is_watched[b]) {
        sums.watched += 1U;
        sums.exposed += is_occupied || !is_behind_[b] ? 1U : 0U;
        sums.occupied += is_occupied ? 1U : 0U;
      }
      if (!is_occupied) continue;
      if (stays_.empty() || b - stays_.back().second > max_break + 1) stays_.emplace_back(b, b);
      stays_.back().second = b;
      stay_of_[b] = stays_.size() - 1;
    }
  }

  // Outside the stay that holds `bin`, an occupied one.
  Rest Outside(std::size_t bin) const {
    const auto [first, last] = stays_[stay_of_[bin]];
    const Sums& all = sums_.back();
    const Sums& from = sums_[first];
    const Sums& to = sums_[last + 1];
    // What is seen through the gaps of something nearer can be seen so at other times, too.
    const std::uint32_t exposed = is_behind_[bin] ? all.watched - (to.watched - from.watched)
                                                  : all.exposed - (to.exposed - from.exposed);
    return {static_cast<double>(exposed),
            static_cast<double>(all.occupied - (to.occupied - from.occupied))};
  }

 private:
  struct Sums {
    std::uint32_t watched = 0;
    std::uint32_t exposed = 0;
    std::uint32_t occupied = 0;
  };

  std::vector<Sums> sums_;       // over the bins before each, and over all
  std::vector<char> is_behind_;  // something nearer, per bin
  std::vector<std::size_t> stay_of_;
  std::vector<std::pair<std::size_t, std::size_t>> stays_;  // first and last bin
};

}  // namespace

Background::Background(const Recording& recording, const BackgroundConfig& config)
    : config_(config),
      bin_ns_(static_cast<TimeNs>(std::llround(config.bin_s * 1e9))),
      grid_(config.place, 0) {
  if (recording.frames.empty()) return;
  MakeBins(recording);
  grid_ = RangeGrid(config.place, num_bins());
  Classify(recording);
}

void Background::MakeBins(const Recording& recording) {
  begin_ns_ = std::min_element(
                  recording.frames.begin(), recording.frames.end(),
                  [](const FrameInfo& a, const FrameInfo& b) { return a.begin_ns < b.begin_ns; })
                  ->begin_ns;
  for (const FrameInfo& frame : recording.frames) {
    const TimeNs last = (frame.end_ns - begin_ns_) / bin_ns_;
    for (TimeNs k = (frame.begin_ns - begin_ns_) / bin_ns_; k <= last; ++k) watched_bins_[k] = 0;
  }
  const auto longest_pause = static_cast<TimeNs>(config_.max_break_s / config_.bin_s) + 2;
  TimeNs before = -1;
  for (auto& [k, bin] : watched_bins_) {
    is_watched_.resize(is_watched_.size() +
                       static_cast<std::size_t>(std::min(k - before - 1, longest_pause)));
    bin = is_watched_.size();
    is_watched_.push_back(1);
    before = k;
  }
  frames_in_bin_.assign(recording.sensors.size(), std::vector<double>(num_bins(), 0.0));
  for (const FrameInfo& frame : recording.frames) {
    frames_in_bin_[frame.sensor][BinOf(frame.begin_ns)] += 1.0;
  }
}

std::size_t Background::BinOf(TimeNs time_ns) const {
  const TimeNs k = std::max<TimeNs>(0, time_ns - begin_ns_) / bin_ns_;
  const auto next = watched_bins_.upper_bound(k);
  const auto [watched, bin] = *std::prev(next);
  const std::size_t end = next == watched_bins_.end() ? num_bins() : next->second;
  return static_cast<std::size_t>(
      std::min(static_cast<TimeNs>(bin) + k - watched, static_cast<TimeNs>(end) - 1));
}

void Background::Classify(const Recording& recording) {
  const std::size_t n = recording.points_m.size();
  std::vector<std::uint32_t> bins(n);
  std::vector<std::pair<std::uint64_t, std::uint32_t>> by_place(n);
  for (std::size_t i = 0; i < n; ++i) {
    bins[i] = static_cast<std::uint32_t>(BinOf(recording.times_ns[i]));
    grid_.Add(recording.points_m[i], bins[i]);
    by_place[i] = {grid_.Key(recording.points_m[i]), static_cast<std::uint32_t>(i)};
  }
  std::sort(by_place.begin(), by_place.end());
  place_rate_.assign(n, 0.0F);
  const DepthMap depth(recording.points_m, bins, num_bins(), config_.occluder_cell_deg);

  const auto max_break = static_cast<std::size_t>(config_.max_break_s / config_.bin_s);
  const double min_exposed = config_.min_exposure * static_cast<double>(watched_bins_.size());
  const double frames_per_bin =
      static_cast<double>(recording.frames.size()) / static_cast<double>(watched_bins_.size());
  std::vector<std::uint32_t> profile;
  PlaceHistory history;
  for (std::size_t first = 0; first < n;) {
    const Eigen::Vector3f& place_m = recording.points_m[by_place[first].second];
    profile.assign(num_bins(), 0);
    grid_.Collect(place_m, &profile);
    history.Assign(profile, is_watched_, depth.MediansM(place_m),
                   static_cast<double>(place_m.norm()) - config_.occluder_margin_m, max_break);
    const double volume_m3 = grid_.VolumeM3(place_m);
    std::size_t i = first;
    for (; i < n && by_place[i].first == by_place[first].first; ++i) {
      const std::uint32_t index = by_place[i].second;
      const PlaceHistory::Rest rest = history.Outside(bins[index]);
      // Structure, or too little is known to tell.
      if (rest.num_exposed < min_exposed ||
          rest.num_occupied > config_.max_occupancy * rest.num_exposed) {
        structure_.push_back(index);
        continue;
      }
      unexplained_.push_back(index);
      if (rest.num_occupied <= 1.0) continue;  // a single one may be a passing target's
      // Poisson, from the share of bins with a hit.
      const double hits_per_bin = -std::log1p(-(rest.num_occupied - 1.0) / rest.num_exposed);
      place_rate_[index] = static_cast<float>(hits_per_bin / frames_per_bin / volume_m3);
    }
    first = i;
  }
  std::sort(structure_.begin(), structure_.end());
  std::sort(unexplained_.begin(), unexplained_.end());
}

double Background::RateOutside(const Eigen::Vector3f& place_m, TimeNs from_ns, TimeNs to_ns) const {
  std::vector<std::uint32_t> profile(num_bins(), 0);
  grid_.Collect(place_m, &profile);
  const std::size_t from = BinOf(from_ns);
  const std::size_t to = BinOf(to_ns);
  double returns = 0.0;
  double frames = 0.0;
  double bins = 0.0;
  for (std::size_t b = 0; b < num_bins(); ++b) {
    if (!is_watched_[b] || (b >= from && b <= to)) continue;
    returns += profile[b];
    for (const std::vector<double>& of_sensor : frames_in_bin_) frames += of_sensor[b];
    bins += 1.0;
  }
  if (bins < config_.min_exposure * static_cast<double>(watched_bins_.size())) return -1.0;
  return returns / (frames * grid_.VolumeM3(place_m));
}

}  // namespace unlidar
