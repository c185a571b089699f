#include "unlidar/robust/background.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace unlidar {
namespace {

// Median range per direction cell and time bin.
class DepthMap {
 public:
  DepthMap(const Recording& recording, const std::vector<std::uint32_t>& bins, std::size_t num_bins,
           double cell_deg)
      : num_bins_(num_bins),
        cell_rad_(cell_deg * M_PI / 180.0),
        columns_(static_cast<std::size_t>(std::ceil(2.0 * M_PI / cell_rad_)) + 1),
        rows_(static_cast<std::size_t>(std::ceil(M_PI / cell_rad_)) + 1) {
    constexpr double kQuantum_m = 0.05;
    std::vector<std::uint64_t> entries(recording.points_m.size());
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const double quanta = std::min(65535.0, recording.points_m[i].norm() / kQuantum_m);
      entries[i] =
          (Index(recording.points_m[i], bins[i]) << 16) | static_cast<std::uint64_t>(quanta);
    }
    std::sort(entries.begin(), entries.end());
    median_m_.assign(columns_ * rows_ * num_bins_, 1e9F);
    for (std::size_t first = 0; first < entries.size();) {
      std::size_t last = first;
      while (last < entries.size() && entries[last] >> 16 == entries[first] >> 16) ++last;
      median_m_[entries[first] >> 16] = static_cast<float>(
          kQuantum_m * static_cast<double>(entries[(first + last) / 2] & 0xFFFF));
      first = last;
    }
  }

  float MedianM(const Eigen::Vector3f& point_m, std::size_t bin) const {
    return median_m_[Index(point_m, bin)];
  }

 private:
  std::uint64_t Index(const Eigen::Vector3f& p, std::size_t bin) const {
    const double azimuth = std::atan2(p.y(), p.x()) + M_PI;
    const double elevation = std::atan2(p.z(), std::hypot(p.x(), p.y())) + M_PI / 2;
    const auto column = static_cast<std::size_t>(azimuth / cell_rad_);
    const auto row = static_cast<std::size_t>(elevation / cell_rad_);
    return (row * columns_ + column) * num_bins_ + bin;
  }

  std::size_t num_bins_;
  double cell_rad_;
  std::size_t columns_;
  std::size_t rows_;
  std::vector<float> median_m_;
};

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
  frames_in_bin_.assign(is_watched_.size(), 0.0);
  for (const FrameInfo& frame : recording.frames) frames_in_bin_[BinOf(frame.begin_ns)] += 1.0;
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
  const DepthMap depth(recording, bins, num_bins(), config_.occluder_cell_deg);

  const auto max_break = static_cast<std::size_t>(config_.max_break_s / config_.bin_s);
  const double min_exposed = config_.min_exposure * static_cast<double>(watched_bins_.size());
  std::vector<std::uint32_t> profile(num_bins());
  // Whether the bins outside the stay about `bin` show structure, or too little to tell.
  const auto is_structure = [&](const Eigen::Vector3f& place_m, std::size_t bin) {
    const double visible_m = static_cast<double>(place_m.norm()) - config_.occluder_margin_m;
    const auto [stay_first, stay_last] = Stay(profile, bin, max_break);
    double num_exposed = 0.0;
    double num_occupied = 0.0;
    for (std::size_t b = 0; b < num_bins(); ++b) {
      if (!is_watched_[b] || (b >= stay_first && b <= stay_last)) continue;
      if (profile[b] > 0) {
        num_exposed += 1.0;
        num_occupied += 1.0;
      } else if (static_cast<double>(depth.MedianM(place_m, b)) >= visible_m) {
        num_exposed += 1.0;
      }
    }
    return num_exposed < min_exposed || num_occupied > config_.max_occupancy * num_exposed;
  };
  enum class Verdict : char { kUnknown, kStructure, kUnexplained };
  std::vector<Verdict> verdicts(num_bins());
  for (std::size_t first = 0; first < n;) {
    const Eigen::Vector3f& place_m = recording.points_m[by_place[first].second];
    std::fill(profile.begin(), profile.end(), 0);
    std::fill(verdicts.begin(), verdicts.end(), Verdict::kUnknown);
    grid_.Collect(place_m, &profile);
    std::size_t i = first;
    for (; i < n && by_place[i].first == by_place[first].first; ++i) {
      const std::uint32_t index = by_place[i].second;
      Verdict& verdict = verdicts[bins[index]];
      if (verdict == Verdict::kUnknown) {
        verdict = is_structure(place_m, bins[index]) ? Verdict::kStructure : Verdict::kUnexplained;
      }
      if (verdict == Verdict::kUnexplained) unexplained_.push_back(index);
    }
    first = i;
  }
  std::sort(unexplained_.begin(), unexplained_.end());
}

std::vector<Eigen::Vector3f> Background::StructurePoints(const Recording& recording) const {
  std::vector<Eigen::Vector3f> points_m;
  std::size_t next = 0;
  for (std::size_t i = 0; i < recording.points_m.size(); ++i) {
    if (next < unexplained_.size() && unexplained_[next] == i) {
      ++next;
    } else {
      points_m.push_back(recording.points_m[i]);
    }
  }
  return points_m;
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
    frames += frames_in_bin_[b];
    bins += 1.0;
  }
  if (bins < config_.min_exposure * static_cast<double>(watched_bins_.size())) return -1.0;
  return returns / (frames * grid_.VolumeM3(place_m));
}

}  // namespace unlidar
