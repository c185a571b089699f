#include "unlidar/robust/background.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "unlidar/robust/depth_map.hpp"

namespace unlidar {
namespace {

// The bins of the stay that holds `bin`: occupied bins with breaks of at most `max_break` bins.
std::pair<std::size_t, std::size_t> Stay(const std::vector<std::uint32_t>& profile, std::size_t bin,
                                         std::size_t max_break) {
  std::size_t first = bin;
  for (std::size_t b = bin; b-- > 0 && first - b <= max_break + 1;) {
    if (profile[b] > 0) first = b;
  }
  std::size_t last = bin;
  for (std::size_t b = bin + 1; b < profile.size() && b - last <= max_break + 1; ++b) {
    if (profile[b] > 0) last = b;
  }
  return {first, last};
}

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
  std::vector<std::uint32_t> profile(num_bins());
  const double frames_per_bin =
      static_cast<double>(recording.frames.size()) / static_cast<double>(watched_bins_.size());
  struct Verdict {
    bool is_known = false;
    bool is_structure = false;
    double hits_per_frame = 0.0;
  };
  // Whether the bins outside the stay about `bin` show structure, or too little to tell.
  const auto judge = [&](const Eigen::Vector3f& place_m, std::size_t bin) {
    const double visible_m = static_cast<double>(place_m.norm()) - config_.occluder_margin_m;
    // What is seen through the gaps of something nearer can be seen so at other times, too.
    const bool is_through_gaps = static_cast<double>(depth.MedianM(place_m, bin)) < visible_m;
    const auto [stay_first, stay_last] = Stay(profile, bin, max_break);
    double num_exposed = 0.0;
    double num_occupied = 0.0;
    for (std::size_t b = 0; b < num_bins(); ++b) {
      if (!is_watched_[b] || (b >= stay_first && b <= stay_last)) continue;
      if (profile[b] > 0) {
        num_exposed += 1.0;
        num_occupied += 1.0;
      } else if (is_through_gaps || static_cast<double>(depth.MedianM(place_m, b)) >= visible_m) {
        num_exposed += 1.0;
      }
    }
    Verdict verdict;
    verdict.is_known = true;
    verdict.is_structure =
        num_exposed < min_exposed || num_occupied > config_.max_occupancy * num_exposed;
    // Poisson, from the share of bins with a hit; a single one may be a passing target's.
    if (!verdict.is_structure && num_occupied > 1.0) {
      verdict.hits_per_frame = -std::log1p(-(num_occupied - 1.0) / num_exposed) / frames_per_bin;
    }
    return verdict;
  };
  std::vector<Verdict> verdicts(num_bins());
  for (std::size_t first = 0; first < n;) {
    const Eigen::Vector3f& place_m = recording.points_m[by_place[first].second];
    std::fill(profile.begin(), profile.end(), 0);
    std::fill(verdicts.begin(), verdicts.end(), Verdict());
    grid_.Collect(place_m, &profile);
    std::size_t i = first;
    for (; i < n && by_place[i].first == by_place[first].first; ++i) {
      const std::uint32_t index = by_place[i].second;
      Verdict& verdict = verdicts[bins[index]];
      if (!verdict.is_known) verdict = judge(place_m, bins[index]);
      (verdict.is_structure ? structure_ : unexplained_).push_back(index);
      place_rate_[index] = static_cast<float>(verdict.hits_per_frame / grid_.VolumeM3(place_m));
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
