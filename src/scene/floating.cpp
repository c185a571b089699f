#include "scene/floating.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <unordered_map>

#include "scene/point_tree.hpp"

namespace unlidar {
namespace {

// Returns, per plot, whether all its returns recur in another frame with identical coordinates: no
// LiDAR measures the same coordinates twice, so these are replays of one frame.
std::vector<char> AreReplayed(const Recording& recording, const std::vector<Plot>& plots) {
  struct Hash {
    std::size_t operator()(const std::array<float, 3>& p) const {
      std::size_t h = 0;
      for (const float x : p) h = h * 1000003U + std::hash<float>()(x);
      return h;
    }
  };
  const auto key = [&](std::uint32_t i) {
    const Eigen::Vector3f& p = recording.points_m[i];
    return std::array<float, 3>{p.x(), p.y(), p.z()};
  };
  struct Frames {
    std::uint32_t first;
    bool is_repeated;
  };
  std::unordered_map<std::array<float, 3>, Frames, Hash> frames_of;
  for (const Plot& plot : plots) {
    for (const std::uint32_t i : plot.returns) {
      Frames& frames = frames_of.try_emplace(key(i), Frames{plot.frame, false}).first->second;
      frames.is_repeated = frames.is_repeated || frames.first != plot.frame;
    }
  }
  std::vector<char> are_replayed;
  are_replayed.reserve(plots.size());
  for (const Plot& plot : plots) {
    are_replayed.push_back(
        std::all_of(plot.returns.begin(), plot.returns.end(),
                    [&](std::uint32_t i) { return frames_of.at(key(i)).is_repeated; }));
  }
  return are_replayed;
}

// How often, and when, the place of a plot is occupied.
enum class Persistence : char {
  kIncidental,  // no more often than its surroundings
  kPersistent,  // repeatedly
  kTransient,   // repeatedly, but for a part of the recording only
};

// True if the plots of a place, all within [first_frame, last_frame], are of a transient object:
// n plots of one that is always there fall within a share s of the frames with a probability of at
// most n s^(n - 1), here below 1 in 100, and swaying objects return within less than 20 s.
bool IsTransient(std::uint32_t num_plots, const std::vector<FrameInfo>& frames,
                 std::uint32_t first_frame, std::uint32_t last_frame) {
  constexpr double kMaxChanceProbability = 0.01;
  constexpr TimeNs kLongestSwayNs = 20'000'000'000;
  const double share = (last_frame - first_frame + 1.0) / static_cast<double>(frames.size());
  const TimeNs before_ns = frames[first_frame].begin_ns - frames.front().begin_ns;
  const TimeNs after_ns = frames.back().end_ns - frames[last_frame].end_ns;
  return num_plots * std::pow(share, num_plots - 1.0) < kMaxChanceProbability &&
         before_ns + after_ns > kLongestSwayNs;
}

std::vector<Persistence> PersistencesOf(const Recording& recording, const std::vector<Plot>& plots,
                                        const RangeRadius& place) {
  constexpr double kWider = 3.0;
  constexpr std::uint32_t kMinPlots = 3;
  RangeGrid places(place);
  RangeGrid regions({kWider * place.constant_m, kWider * place.slope});
  for (const Plot& plot : plots) {
    places.Add(plot.position_m.cast<float>(), plot.frame);
    regions.Add(plot.position_m.cast<float>(), 0);
  }
  BinSet seen(recording.frames.size());
  std::vector<std::uint32_t> frames;
  std::vector<Persistence> persistences(plots.size(), Persistence::kIncidental);
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const Eigen::Vector3f place_m = plots[i].position_m.cast<float>();
    const std::uint32_t here = places.Count(place_m);
    const double chance =
        regions.Count(place_m) * places.VolumeM3(place_m) / regions.VolumeM3(place_m);
    if (here < kMinPlots || here <= chance + 3.0 * std::sqrt(chance)) continue;
    places.InsertBins(place_m, &seen);
    frames.clear();
    seen.MoveTo(&frames);
    persistences[i] = IsTransient(here, recording.frames, frames.front(), frames.back())
                          ? Persistence::kTransient
                          : Persistence::kPersistent;
  }
  return persistences;
}

// Compares the static plots beside each floating plot at the same time with those farther around.
class NeighbourTest {
 public:
  NeighbourTest(const std::vector<Plot>& plots, const std::vector<Persistence>& persistences,
                const Support& support)
      : tallies_({kObjectRadiusM, 0.01}) {
    constexpr TimeNs kSameTimeNs = 300'000'000;
    const std::vector<StaticDetections> all_static = ByTime(plots, persistences);
    auto first = all_static.begin();
    for (std::size_t i = 0; i < plots.size(); ++i) {
      const Plot& plot = plots[i];
      while (first != all_static.end() && first->time_ns < plot.frame_time_ns - kSameTimeNs)
        ++first;
      if (!plot.is_floating) continue;
      const double reach_m =
          support.ReachM(plot.position_m.cast<float>(), persistences[i] == Persistence::kTransient);
      const auto tally_at = [&](double distance_m) {
        if (distance_m >= kOuterReachFactor * reach_m) return kNone;
        return distance_m <= kObjectRadiusM ? kSelf
               : distance_m < reach_m       ? kNeighbouring
                                            : kSurrounding;
      };
      Tallies tallies{};
      tallies[kPlots] = 1;
      for (auto detections = first; detections != all_static.end() &&
                                    detections->time_ns <= plot.frame_time_ns + kSameTimeNs;
           ++detections) {
        Count(detections->places_m, 0, plot.position_m, tally_at, &tallies);
      }
      for (std::uint32_t t = 0; t < kNone; ++t) {
        if (tallies[t] > 0) tallies_.Add(plot.position_m.cast<float>(), t, tallies[t]);
      }
    }
  }

  // True if a floating plot has more neighbours than chance allows.
  bool HasNeighbours(const Plot& plot) const {
    const auto sum_of = [&](Tally tally) {
      return tallies_.Count(plot.position_m.cast<float>(), {tally, tally + 1U});
    };
    // Each neighbour was counted once for every plot of this place near it in time.
    const double times = static_cast<double>(sum_of(kSelf)) / sum_of(kPlots);
    const double chance = sum_of(kSurrounding) / times /
                          (kOuterReachFactor * kOuterReachFactor * kOuterReachFactor - 1.0);
    return sum_of(kNeighbouring) / times > chance + 2.0 * std::sqrt(chance);
  }

 private:
  static constexpr double kOuterReachFactor = 5.0;  // times the reach
  // The first three and kNone are in order of distance.
  enum Tally : std::uint32_t { kSelf, kNeighbouring, kSurrounding, kPlots, kNone, kNumTallies };
  using Tallies = std::array<std::uint32_t, kNumTallies>;

  // Static plots of one time.
  struct StaticDetections {
    TimeNs time_ns;
    PointTree<double> places_m;
  };

  static std::vector<StaticDetections> ByTime(const std::vector<Plot>& plots,
                                              const std::vector<Persistence>& persistences) {
    std::vector<StaticDetections> all_static;
    std::vector<Eigen::Vector3d> places_m;
    for (std::size_t i = 0; i < plots.size(); ++i) {
      if (persistences[i] != Persistence::kIncidental) places_m.push_back(plots[i].position_m);
      const bool is_last =
          i + 1 == plots.size() || plots[i + 1].frame_time_ns != plots[i].frame_time_ns;
      if (!is_last || places_m.empty()) continue;
      all_static.push_back({plots[i].frame_time_ns, PointTree<double>(places_m)});
      places_m.clear();
    }
    return all_static;
  }

  // Adds each place of a node to the tally of its distance from a position: all at once where the
  // nearest and the farthest point of its box have the same tally.
  template <class TallyAt>
  static void Count(const PointTree<double>& places_m, std::uint32_t id,
                    const Eigen::Vector3d& position_m, const TallyAt& tally_at, Tallies* tallies) {
    const PointTree<double>::Node& node = places_m.nodes()[id];
    const Eigen::Vector3d below_m = position_m - node.low_m;
    const Eigen::Vector3d above_m = node.high_m - position_m;
    const double nearest_m = (-below_m).cwiseMax(-above_m).cwiseMax(0.0).norm();
    const Tally tally = tally_at(nearest_m);
    if (tally == tally_at(below_m.cwiseAbs().cwiseMax(above_m.cwiseAbs()).norm())) {
      (*tallies)[tally] += node.end - node.begin;
    } else if (node.IsLeaf()) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        ++(*tallies)[tally_at((position_m - places_m.points_m()[i]).norm())];
      }
    } else {
      Count(places_m, node.left, position_m, tally_at, tallies);
      Count(places_m, node.right, position_m, tally_at, tallies);
    }
  }

  RangeGrid tallies_;  // the Tally takes the place of the time bin
};

}  // namespace

void MarkFloating(const Recording& recording, const Support& support, const RobustConfig& config,
                  std::vector<Plot>* plots) {
  if (plots->empty()) return;
  std::vector<Persistence> persistences =
      PersistencesOf(recording, *plots, config.background.place);
  if (!config.Uses(Rule::kTransient)) {
    std::replace(persistences.begin(), persistences.end(), Persistence::kTransient,
                 Persistence::kPersistent);
  }
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = persistences[i] != Persistence::kIncidental &&
                       support.IsFloating(plot.position_m.cast<float>(),
                                          persistences[i] == Persistence::kTransient);
  }
  const NeighbourTest neighbour_test(*plots, persistences, support);
  const std::vector<char> are_replayed = AreReplayed(recording, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = plot.is_floating && !neighbour_test.HasNeighbours(plot) && !are_replayed[i];
  }
}

}  // namespace unlidar
