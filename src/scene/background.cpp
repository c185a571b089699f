#include "scene/background.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "scene/depth_map.hpp"

namespace unlidar {
namespace {

// Memory is prefetched this many returns ahead: the data of all returns exceed the cache.
constexpr std::size_t kPrefetchDistance = 16;

// Bins in which a place was hit, and in which it could have been, accumulated so that each dwell is
// evaluated in constant time, however long the recording.
class PlaceHistory {
 public:
  // Occupancy in the bins outside a dwell.
  struct OutsideOccupancy {
    double num_exposed = 0.0;
    double num_occupied = 0.0;
  };

  // `hits`: bins, ascending, in which the place was hit. `depths`: depths in its direction; nearer
  // than `visible_m` they occlude the place. `breaks_dwell(a, b)`: true if consecutive hits in bins
  // a and b are too far apart for one dwell.
  template <class BreaksDwell>
  void Assign(const std::vector<std::uint32_t>& hits, std::size_t num_bins,
              const DepthMap::Depths& depths, double visible_m, const BreaksDwell& breaks_dwell) {
    hits_ = &hits;
    num_bins_ = num_bins;
    is_occluded_.assign(hits.size(), 0);
    dwell_of_.resize(hits.size());
    dwells_.clear();
    num_occluded_ = 0;
    const DepthMap::Depth* depth = depths.begin();
    // Adds the bins before `end` in which the place is occluded; returns true if it is in `end`.
    const auto occludes = [&](std::uint32_t end, std::size_t* num_occluded) {
      const auto is_near = [&] { return static_cast<double>(depth->median_m) < visible_m; };
      for (; depth != depths.end() && depth->bin < end; ++depth)
        *num_occluded += is_near() ? 1U : 0U;
      return depth != depths.end() && depth->bin == end && is_near();
    };
    for (std::size_t k = 0; k < hits.size(); ++k) {
      std::size_t num_between = 0;
      is_occluded_[k] = occludes(hits[k], &num_between) ? 1 : 0;
      if (depth != depths.end() && depth->bin == hits[k]) ++depth;
      num_occluded_ += num_between;
      if (k == 0 || breaks_dwell(hits[k - 1], hits[k])) {
        dwells_.push_back({k, k, 0});
      } else {
        dwells_.back().num_occluded += num_between;
      }
      dwells_.back().last = k;
      dwell_of_[k] = dwells_.size() - 1;
    }
    occludes(static_cast<std::uint32_t>(num_bins), &num_occluded_);
  }

  // Returns the occupancy outside the dwell that contains `bin`, one of the hits.
  OutsideOccupancy Outside(std::uint32_t bin) const {
    const auto k = static_cast<std::size_t>(std::lower_bound(hits_->begin(), hits_->end(), bin) -
                                            hits_->begin());
    const Dwell& dwell = dwells_[dwell_of_[k]];
    const std::size_t num_outside = num_bins_ - ((*hits_)[dwell.last] + 1 - (*hits_)[dwell.first]);
    // A place seen now through gaps of something nearer can be seen so at other times, too.
    const std::size_t num_occluded = is_occluded_[k] != 0 ? 0 : num_occluded_ - dwell.num_occluded;
    return {static_cast<double>(num_outside - num_occluded),
            static_cast<double>(hits_->size() - (dwell.last + 1 - dwell.first))};
  }

 private:
  struct Dwell {
    std::size_t first;  // index of its first hit
    std::size_t last;
    std::size_t num_occluded;  // bins between them in which the place was occluded
  };

  const std::vector<std::uint32_t>* hits_ = nullptr;
  std::size_t num_bins_ = 0;
  std::size_t num_occluded_ = 0;  // bins without a hit in which the place was occluded
  // Per hit:
  std::vector<char> is_occluded_;  // by something nearer
  std::vector<std::size_t> dwell_of_;
  std::vector<Dwell> dwells_;
};

// Indices grouped by place, ascending within each.
struct PlaceOrder {
  std::vector<std::uint32_t> indices;
  std::vector<std::uint32_t> ends;  // (places) end of each in `indices`
};

PlaceOrder OrderByPlace(const std::vector<std::uint32_t>& places, std::size_t num_places) {
  PlaceOrder order{std::vector<std::uint32_t>(places.size()),
                   std::vector<std::uint32_t>(num_places + 1, 0)};
  std::vector<std::uint32_t>& next = order.ends;
  for (const std::uint32_t place : places) ++next[place + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  for (std::size_t i = 0; i < places.size(); ++i) {
    order.indices[next[places[i]]++] = static_cast<std::uint32_t>(i);
  }
  next.pop_back();
  return order;
}

// Count for a place without returns: Jeffreys' prior of a Poisson rate.
constexpr double kJeffreysReturns = 0.5;

}  // namespace

Background::Background(const Recording& recording, const BackgroundConfig& config)
    : config_(config), bin_ns_(NsOf(config.bin_s)), grid_(config.place) {
  if (recording.frames.empty()) return;
  MakeBins(recording);
  Classify(recording);
}

void Background::MakeBins(const Recording& recording) {
  begin_ns_ = std::min_element(
                  recording.frames.begin(), recording.frames.end(),
                  [](const FrameInfo& a, const FrameInfo& b) { return a.begin_ns < b.begin_ns; })
                  ->begin_ns;
  std::vector<std::pair<Tick, Tick>> spans;
  spans.reserve(recording.frames.size());
  for (const FrameInfo& frame : recording.frames) {
    spans.emplace_back(TickOf(frame.begin_ns), TickOf(frame.end_ns));
  }
  std::sort(spans.begin(), spans.end());
  for (const auto& [first, last] : spans) {
    Tick tick = ticks_.empty() ? first : std::max(first, ticks_.back() + 1);
    for (; tick <= last; ++tick) ticks_.push_back(tick);
  }
  frames_before_.assign(recording.sensors.size(), std::vector<std::uint32_t>(num_bins() + 1, 0));
  for (const FrameInfo& frame : recording.frames) {
    ++frames_before_[frame.sensor][BinOf(frame.begin_ns) + 1];
  }
  for (auto& before : frames_before_)
    std::partial_sum(before.begin(), before.end(), before.begin());
}

Background::Tick Background::TickOf(TimeNs time_ns) const {
  if (time_ns <= begin_ns_) return 0;
  // Unsigned: the difference of two times may exceed the range of TimeNs.
  return (static_cast<std::uint64_t>(time_ns) - static_cast<std::uint64_t>(begin_ns_)) /
         static_cast<std::uint64_t>(bin_ns_);
}

std::uint32_t Background::FirstBinFrom(Tick tick) const {
  return static_cast<std::uint32_t>(std::lower_bound(ticks_.begin(), ticks_.end(), tick) -
                                    ticks_.begin());
}

std::uint32_t Background::BinOf(TimeNs time_ns) const { return FirstBinFrom(TickOf(time_ns)); }

BinRange Background::BinsAround(std::uint32_t bin, std::uint32_t margin) const {
  const Tick tick = ticks_[bin];
  return {FirstBinFrom(tick - std::min<Tick>(tick, margin)), FirstBinFrom(tick + margin + 1)};
}

std::vector<std::uint32_t> Background::AddToGrid(const Recording& recording,
                                                 const std::vector<std::uint32_t>& bins) {
  const std::size_t n = recording.points_m.size();
  std::vector<std::uint32_t> places(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (i + kPrefetchDistance < n) grid_.Prefetch(recording.points_m[i + kPrefetchDistance]);
    places[i] = grid_.Add(recording.points_m[i], bins[i]);
  }
  return places;
}

void Background::Classify(const Recording& recording) {
  const std::size_t n = recording.points_m.size();
  std::vector<std::uint32_t> bins(n);
  for (std::size_t i = 0; i < n; ++i) bins[i] = BinOf(recording.times_ns[i]);
  const DepthMap depth(recording.points_m, bins, num_bins(), config_.occluder_cell_deg);
  const std::vector<std::uint32_t> places = AddToGrid(recording, bins);
  const auto [order, ends] = OrderByPlace(places, grid_.num_places());

  const auto max_break = static_cast<Tick>(config_.max_break_s / config_.bin_s);
  const auto breaks_dwell = [&](std::uint32_t a, std::uint32_t b) {
    return ticks_[b] - ticks_[a] > max_break + 1;
  };
  const double min_exposed = config_.min_exposure * static_cast<double>(num_bins());
  const double frames_per_bin =
      static_cast<double>(recording.frames.size()) / static_cast<double>(num_bins());
  std::vector<char> is_structure(n, 0);
  BinSet occupied(num_bins());
  std::vector<std::uint32_t> hits;
  PlaceHistory history;
  std::size_t at = 0;
  for (const std::uint32_t end : ends) {
    if (at == end) continue;
    const Eigen::Vector3f& place_m = recording.points_m[order[at]];
    hits.clear();
    grid_.InsertBins(place_m, &occupied);
    occupied.MoveTo(&hits);
    history.Assign(hits, num_bins(), depth.DepthsAt(place_m),
                   static_cast<double>(place_m.norm()) - config_.occluder_margin_m, breaks_dwell);
    const double volume_m3 = grid_.VolumeM3(place_m);
    for (; at < end; ++at) {
      const std::uint32_t index = order[at];
      if (at + kPrefetchDistance < n) __builtin_prefetch(&bins[order[at + kPrefetchDistance]]);
      const PlaceHistory::OutsideOccupancy outside = history.Outside(bins[index]);
      // Structure, or too seldom exposed to decide.
      if (outside.num_exposed < min_exposed ||
          outside.num_occupied > config_.max_occupancy * outside.num_exposed) {
        is_structure[index] = 1;
        continue;
      }
      if (outside.num_occupied <= 1.0) continue;  // a single bin may be a passing target
      // Poisson rate from the share p of bins with a hit: -log(1 - p).
      const double hits_per_bin = -std::log1p(-(outside.num_occupied - 1.0) / outside.num_exposed);
      place_rates_.emplace_back(index,
                                static_cast<float>(hits_per_bin / frames_per_bin / volume_m3));
    }
  }
  std::sort(place_rates_.begin(), place_rates_.end());
  const auto num_structure =
      static_cast<std::size_t>(std::count(is_structure.begin(), is_structure.end(), 1));
  structure_.reserve(num_structure);
  unexplained_.reserve(n - num_structure);
  for (std::uint32_t i = 0; i < n; ++i) {
    (is_structure[i] != 0 ? structure_ : unexplained_).push_back(i);
  }
}

double Background::PlaceRate(std::uint32_t i) const {
  const auto rate =
      std::lower_bound(place_rates_.begin(), place_rates_.end(), std::make_pair(i, 0.0F));
  return rate == place_rates_.end() || rate->first != i ? 0.0 : static_cast<double>(rate->second);
}

double Background::RateOutside(const Eigen::Vector3f& place_m, TimeNs from_ns, TimeNs to_ns) const {
  const BinRange inside = BinsTouching(from_ns, to_ns);
  const std::uint32_t num_outside = num_bins() - (inside.last - inside.first);
  if (num_outside < config_.min_exposure * static_cast<double>(num_bins())) return -1.0;
  const std::uint32_t returns = grid_.Count(place_m) - grid_.Count(place_m, inside);
  return std::max<double>(returns, kJeffreysReturns) /
         (NumFramesOutside(inside) * grid_.VolumeM3(place_m));
}

std::uint32_t Background::NumFramesOutside(BinRange inside) const {
  std::uint32_t frames = 0;
  for (std::size_t sensor = 0; sensor < frames_before_.size(); ++sensor) {
    frames += NumFrames(sensor, {0, num_bins()}) - NumFrames(sensor, inside);
  }
  return frames;
}

}  // namespace unlidar
