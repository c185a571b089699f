#include "tracking/null_score.hpp"

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>
#include <utility>

namespace unlidar {
namespace {

// Returns the frame whose place each frame takes (frames): a random permutation per sensor.
std::vector<std::uint32_t> ShuffledFrames(const Recording& recording) {
  std::vector<std::uint32_t> places(recording.frames.size());
  std::iota(places.begin(), places.end(), 0U);
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp): deterministic for the same input
  for (std::uint32_t sensor = 0; sensor < recording.sensors.size(); ++sensor) {
    std::vector<std::uint32_t> own;
    for (std::uint32_t f = 0; f < places.size(); ++f) {
      if (recording.frames[f].sensor == sensor) own.push_back(f);
    }
    // Not std::shuffle: its draws differ between standard libraries.
    for (std::size_t k = own.size(); k > 1; --k) {
      std::swap(places[own[k - 1]], places[own[random() % k]]);
    }
  }
  return places;
}

}  // namespace

double NullScore(const Recording& recording, const std::vector<Plot>& plots,
                 const std::vector<char>& are_clutter, const ScanSchedule& scan_schedule,
                 const TrackerConfig& config) {
  const std::vector<std::uint32_t> places = ShuffledFrames(recording);
  std::vector<Plot> shuffled;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    if (are_clutter[i] == 0) continue;
    Plot plot = plots[i];
    const std::uint32_t frame = places[plot.frame];
    const TimeNs moved_ns = recording.frames[frame].middle_ns() - plot.frame_time_ns;
    plot.frame = frame;
    plot.frame_time_ns += moved_ns;
    plot.time_ns += moved_ns;
    plot.returns = {};  // not used by the search
    shuffled.push_back(std::move(plot));
  }
  SortByFrameTime(&shuffled);
  const std::vector<Path> paths = FindPaths(shuffled, scan_schedule, config);  // by falling score
  return paths.empty() ? 0.0 : paths.front().score;
}

}  // namespace unlidar
