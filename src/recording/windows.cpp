// Targets of recordings of any length, in bounded memory.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <set>
#include <utility>

#include "base/algorithms.hpp"
#include "recording/robust.hpp"

namespace unlidar {
namespace {

// A return of a target, which outlives its window.
struct KeptReturn {
  std::uint64_t frame;  // among all frames of the recording,
  std::uint32_t index;  // and within it
  TimeNs stamp_ns;      // of the frame
  TimeNs time_ns;
  Eigen::Vector3f point_m;

  friend bool operator<(const KeptReturn& a, const KeptReturn& b) {
    return std::make_pair(a.frame, a.index) < std::make_pair(b.frame, b.index);
  }
};

// A target whose returns are stored outside of a recording.
struct Tracklet {
  Target target;                    // without returns
  std::vector<KeptReturn> returns;  // ascending
  bool is_fitted = true;            // false: cut or joined since its trajectory was fitted
};

std::size_t CountShared(const Tracklet& a, const Tracklet& b) {
  std::vector<KeptReturn> shared;
  std::set_intersection(a.returns.begin(), a.returns.end(), b.returns.begin(), b.returns.end(),
                        std::back_inserter(shared));
  return shared.size();
}

// Keeps the part before a time, or the rest; the score shrinks to the share of the returns kept.
void Cut(TimeNs at_ns, bool keeps_before, Tracklet* tracklet) {
  const auto goes = [&](TimeNs time_ns) { return (time_ns < at_ns) != keeps_before; };
  const auto all = static_cast<double>(tracklet->returns.size());
  const auto cut = [&](auto* items, const auto& time_of) {
    EraseIf(items, [&](const auto& item) { return goes(time_of(item)); });
  };
  cut(&tracklet->returns, [](const KeptReturn& kept) { return kept.stamp_ns; });
  cut(&tracklet->target.measurements, [](const Measurement& m) { return m.time_ns; });
  cut(&tracklet->target.alternative_modes,
      [](const AlternativeMode& mode) { return mode.time_ns; });
  tracklet->target.score *= static_cast<double>(tracklet->returns.size()) / all;
  tracklet->is_fitted = false;
}

class WindowSearch {
 public:
  WindowSearch(const RobustConfig& config, const TrajectoryConfig& trajectory_config,
               const TraceSink& trace)
      : config_(config),
        trajectory_config_(trajectory_config),
        trace_(trace),
        margin_ns_(NsOf(config.window_margin_s)) {}

  // Searches the recording up to a stamp, without the frames that earlier windows have dropped.
  void Search(const FrameFeed& feed, TimeNs begin_ns, TimeNs end_ns, double false_alarms) {
    DropBefore(begin_ns - margin_ns_);  // before more is read: never more than a window is held
    const std::size_t known = window_.frames.size();
    const bool is_last = end_ns == std::numeric_limits<TimeNs>::max();
    next_stamp_ns_ = feed(is_last ? end_ns : end_ns + margin_ns_, &window_);
    frames_.insert(frames_.end(), window_.frames.begin() + static_cast<std::ptrdiff_t>(known),
                   window_.frames.end());
    RobustConfig config = config_;
    config.false_alarms_per_recording = false_alarms;
    RobustResult found = FindTargetsRobust(window_, config, trajectory_config_, trace_);
    counts_.unexplained_returns += found.counts.unexplained_returns;
    counts_.body_returns += found.counts.body_returns;
    counts_.plots += found.counts.plots;
    counts_.paths += found.counts.paths;
    counts_.score_threshold = std::max(counts_.score_threshold, found.counts.score_threshold);
    counts_.false_alarms += found.counts.false_alarms;
    std::vector<Tracklet> tracklets;
    for (Target& target : found.targets) tracklets.push_back(TrackletOf(std::move(target)));
    Join(begin_ns, std::move(tracklets));
  }

  // The stamp of the first frame that is not before a time.
  TimeNs NextStampNs(TimeNs from_ns) const {
    const auto next = FirstFrom(window_.frames, &FrameInfo::stamp_ns, from_ns);
    return next != window_.frames.end() ? next->stamp_ns : next_stamp_ns_;
  }

  RobustResult Finish(Recording* recording) {
    RobustResult result;
    result.counts = counts_;
    std::stable_sort(
        tracklets_.begin(), tracklets_.end(),
        [](const Tracklet& a, const Tracklet& b) { return a.target.score > b.target.score; });
    // A return belongs to at most one target.
    std::set<KeptReturn> all;
    for (Tracklet& tracklet : tracklets_) {
      auto& returns = tracklet.returns;
      EraseIf(&returns, [&](const KeptReturn& kept) { return all.count(kept) > 0; });
      all.insert(returns.begin(), returns.end());
    }
    recording->sensors = std::move(window_.sensors);
    recording->counts = window_.counts;
    recording->warnings = std::move(window_.warnings);
    recording->frames = std::move(frames_);
    auto kept = all.begin();
    for (std::size_t frame = 0; frame < recording->frames.size(); ++frame) {
      FrameInfo& info = recording->frames[frame];
      info.first_return = static_cast<std::uint32_t>(recording->points_m.size());
      for (; kept != all.end() && kept->frame == frame; ++kept) {
        recording->points_m.push_back(kept->point_m);
        recording->times_ns.push_back(kept->time_ns);
      }
      info.last_return = static_cast<std::uint32_t>(recording->points_m.size());
    }
    const std::vector<KeptReturn> order(all.begin(), all.end());
    for (Tracklet& tracklet : tracklets_) {
      if (tracklet.returns.empty()) continue;
      if (!tracklet.is_fitted) {
        tracklet.target.trajectory =
            FitTrajectoryByCeres(tracklet.target.measurements, trajectory_config_);
      }
      for (const KeptReturn& own : tracklet.returns) {
        tracklet.target.returns.push_back(static_cast<std::uint32_t>(
            std::lower_bound(order.begin(), order.end(), own) - order.begin()));
      }
      result.targets.push_back(std::move(tracklet.target));
    }
    return result;
  }

 private:
  // Forgets the frames before a stamp.
  void DropBefore(TimeNs stamp_ns) {
    const auto first = FirstFrom(window_.frames, &FrameInfo::stamp_ns, stamp_ns);
    const std::uint32_t gone = first == window_.frames.begin() ? 0 : std::prev(first)->last_return;
    first_frame_ += static_cast<std::uint64_t>(first - window_.frames.begin());
    window_.frames.erase(window_.frames.begin(), first);
    DropFirst(gone, &window_.points_m);
    window_.times_ns.DropFirst(gone);
    for (FrameInfo& frame : window_.frames) {
      frame.first_return -= gone;
      frame.last_return -= gone;
    }
  }

  Tracklet TrackletOf(Target target) const {
    Tracklet tracklet;
    std::size_t frame = 0;
    for (const std::uint32_t i : target.returns) {
      while (window_.frames[frame].last_return <= i) ++frame;
      const FrameInfo& info = window_.frames[frame];
      tracklet.returns.push_back({first_frame_ + frame, i - info.first_return, info.stamp_ns,
                                  window_.times_ns[i], window_.points_m[i]});
    }
    target.returns.clear();
    tracklet.target = std::move(target);
    return tracklet;
  }

  // Adds the targets of the window that begins at a border.
  void Join(TimeNs border_ns, std::vector<Tracklet> found) {
    struct Pair {
      std::size_t shared;
      std::size_t before;
      std::size_t behind;
    };
    const std::size_t num_before = tracklets_.size();
    std::move(found.begin(), found.end(), std::back_inserter(tracklets_));
    std::vector<Pair> pairs;
    for (std::size_t i = 0; i < num_before; ++i) {
      if (tracklets_[i].returns.back().stamp_ns < border_ns - margin_ns_) continue;
      for (std::size_t k = num_before; k < tracklets_.size(); ++k) {
        const std::size_t shared = CountShared(tracklets_[i], tracklets_[k]);
        if (shared > 0) pairs.push_back({shared, i, k});
      }
    }
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const Pair& a, const Pair& b) { return a.shared > b.shared; });
    const auto about_border = [&](const Tracklet& tracklet) {
      return static_cast<std::size_t>(std::count_if(
          tracklet.returns.begin(), tracklet.returns.end(), [&](const KeptReturn& kept) {
            return border_ns - margin_ns_ <= kept.stamp_ns &&
                   kept.stamp_ns < border_ns + margin_ns_;
          }));
    };
    std::vector<char> is_cut(tracklets_.size(), 0);
    for (const Pair& pair : pairs) {
      Tracklet& before = tracklets_[pair.before];
      Tracklet& behind = tracklets_[pair.behind];
      const bool are_one = !is_cut[pair.before] && !is_cut[pair.behind] &&
                           2 * pair.shared >= std::min(about_border(before), about_border(behind));
      if (!std::exchange(is_cut[pair.before], 1)) Cut(border_ns, true, &before);
      if (!std::exchange(is_cut[pair.behind], 1)) Cut(border_ns, false, &behind);
      if (!are_one) continue;
      before.target.score += behind.target.score;
      before.target.common_errors =
          LargerErrors(before.target.common_errors, behind.target.common_errors);
      const auto append = [](const auto& from, auto* to) {
        to->insert(to->end(), from.begin(), from.end());
      };
      append(behind.returns, &before.returns);
      append(behind.target.measurements, &before.target.measurements);
      append(behind.target.alternative_modes, &before.target.alternative_modes);
      behind.returns.clear();
    }
    // Targets entirely beyond the border belong to the window there, which saw more of them.
    for (std::size_t i = 0; i < tracklets_.size(); ++i) {
      std::vector<KeptReturn>& returns = tracklets_[i].returns;
      if (returns.empty()) continue;
      const bool is_beyond = i < num_before ? !is_cut[i] && returns.front().stamp_ns >= border_ns
                                            : returns.back().stamp_ns < border_ns;
      if (is_beyond) returns.clear();
    }
    EraseIf(&tracklets_, [](const Tracklet& tracklet) {
      return tracklet.returns.empty() || tracklet.target.measurements.empty();
    });
  }

  const RobustConfig& config_;
  const TrajectoryConfig& trajectory_config_;
  const TraceSink& trace_;
  TimeNs margin_ns_;
  Recording window_;
  TimeNs next_stamp_ns_ = 0;       // of the first frame that was not fed yet
  std::uint64_t first_frame_ = 0;  // of the window, among all
  std::vector<FrameInfo> frames_;  // all
  std::vector<Tracklet> tracklets_;
  RobustCounts counts_;
};

}  // namespace

RobustResult FindTargetsInWindows(const FrameFeed& feed, TimeNs first_stamp_ns,
                                  TimeNs last_stamp_ns, const RobustConfig& config,
                                  const TrajectoryConfig& trajectory_config, const TraceSink& trace,
                                  Recording* recording) {
  const double duration_s = SecondsOf(last_stamp_ns - first_stamp_ns);
  const double num_windows = std::max(1.0, std::ceil(duration_s / config.window_s));
  const TimeNs window_ns = NsOf(duration_s / num_windows) + 1;  // the last frame is in the last one
  WindowSearch search(config, trajectory_config, trace);
  for (TimeNs begin_ns = first_stamp_ns;;) {
    const bool is_last = last_stamp_ns - begin_ns < window_ns;
    const TimeNs end_ns = is_last ? std::numeric_limits<TimeNs>::max() : begin_ns + window_ns;
    search.Search(feed, begin_ns, end_ns, config.false_alarms_per_recording / num_windows);
    if (is_last) break;
    begin_ns = search.NextStampNs(end_ns);
  }
  return search.Finish(recording);
}

}  // namespace unlidar
