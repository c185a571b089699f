#include "live/backward_extension.hpp"

#include <algorithm>

#include "live/track_follower.hpp"
#include "scene/support.hpp"
#include "tracking/scan_schedule.hpp"

namespace unlidar {
namespace {

// A flight is followed back only once, so more hypotheses are affordable than kMaxHypotheses. They
// are needed across a pause of seconds among strays, where only the plots before the pause make the
// true hypothesis likelier than the others.
constexpr std::size_t kMaxHypothesesBack = 400;

// Reverses the time of a plot about 0, and the order of frames.
LivePlot InReverse(LivePlot seen) {
  seen.plot = TimeReversed(seen.plot);
  seen.plot.frame = ~seen.plot.frame;
  seen.time_s = -seen.time_s;
  return seen;
}

// Reverses the time of its frame likewise. Sensors may have been added since.
FrameTime FrameTimeInReverse(const Plot& plot, const RecentFrameTimes& frame_times,
                             const std::vector<std::uint32_t>& num_frames) {
  FrameTime at = frame_times.At(plot.frame);
  at.time_s = -at.time_s;
  at.frames_before.resize(num_frames.size(), 0);
  for (std::uint32_t s = 0; s < num_frames.size(); ++s) {
    std::uint32_t& before = at.frames_before[s];
    const std::uint32_t until = before + (s == plot.sensor ? 1U : 0U);
    before = num_frames[s] - std::min(num_frames[s], until);
  }
  return at;
}

}  // namespace

std::vector<std::uint32_t> ExtendBackwards(const Flight& flight, const RecentPlots& seen,
                                           const std::vector<char>& are_free,
                                           const RecentFrameTimes& frame_times,
                                           const std::vector<std::uint32_t>& num_frames,
                                           const std::vector<TrackModel>& models,
                                           const Config& config) {
  Flight back;
  back.log_birth = flight.log_birth;
  for (auto plot = flight.plots.rbegin(); plot != flight.plots.rend(); ++plot) {
    back.plots.push_back(InReverse(*plot));
    back.frame_times.push_back(FrameTimeInReverse(plot->plot, frame_times, num_frames));
  }
  const Plot& first = flight.plots.front().plot;
  const RobustConfig& robust = config.robust;
  TrackFollower follower(back, models, robust, kMaxHypothesesBack);
  const bool floats = Floats(flight.plots);
  const auto is_before = [&](const LivePlot& one) {
    return one.plot.frame_time_ns < first.frame_time_ns;
  };
  for (std::size_t end = seen.PartitionPoint(is_before); end > 0;) {
    std::size_t begin = end - 1;
    while (begin > 0 && seen[begin - 1].plot.frame == seen[end - 1].plot.frame) --begin;
    std::vector<LivePlot> plots;
    for (std::size_t i = begin; i < end; ++i) {
      if (!are_free[i]) continue;
      plots.push_back(InReverse(seen[i]));
      const double apart_m = (seen[i].plot.position_m - first.position_m).norm();
      // An unsupported target was unsupported before that was known.
      if (floats && apart_m < kObjectRadiusM) {
        plots.back().plot.log_clutter = seen[i].log_surrounding_clutter;
      }
    }
    end = begin;
    if (plots.empty()) continue;
    follower.Extend(plots, std::vector<char>(plots.size(), 1),
                    FrameTimeInReverse(seen[begin].plot, frame_times, num_frames));
  }
  std::vector<std::uint32_t> past;
  std::vector<LivePlot> path;
  follower.GetLikeliestPath(&path);
  for (const LivePlot& one : path) {
    const auto is_same_plot = [&](const LivePlot& other) {
      return other.plot.frame == ~one.plot.frame && other.plot.position_m == one.plot.position_m;
    };
    std::uint32_t at = 0;
    while (at < seen.size() && !is_same_plot(seen[at])) ++at;
    if (at < seen.size() && is_before(seen[at])) past.push_back(at);
  }
  std::sort(past.begin(), past.end());
  return past;
}

}  // namespace unlidar
