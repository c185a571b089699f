#include "scene/floating.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <unordered_map>

#include "base/point_tree.hpp"

namespace unlidar {
namespace {

// Returns, per plot, whether it floats and all its returns recur in another frame with identical
// coordinates: no LiDAR measures the same coordinates twice, so these are replays of one frame.
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
  // Holds floating plots alone, as strays would add many more.
  std::unordered_map<std::array<float, 3>, Frames, Hash> frames_of;
  for (const Plot& plot : plots) {
    if (!plot.is_floating) continue;
    for (const std::uint32_t i : plot.returns) {
      frames_of.try_emplace(key(i), Frames{plot.frame, false});
    }
  }
  for (const Plot& plot : plots) {
    for (const std::uint32_t i : plot.returns) {
      const auto known = frames_of.find(key(i));
      if (known != frames_of.end() && known->second.first != plot.frame) {
        known->second.is_repeated = true;
      }
    }
  }
  std::vector<char> are_replayed;
  are_replayed.reserve(plots.size());
  for (const Plot& plot : plots) {
    const auto is_repeated = [&](std::uint32_t i) { return frames_of.at(key(i)).is_repeated; };
    are_replayed.push_back(plot.is_floating &&
                           std::all_of(plot.returns.begin(), plot.returns.end(), is_repeated));
  }
  return are_replayed;
}

// Frequency and time with which the place of a plot is occupied.
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
  StaticPlaces static_places(place);
  for (const Plot& plot : plots) static_places.Add(plot.position_m.cast<float>(), plot.frame);
  BinSet seen(recording.frames.size());
  std::vector<std::uint32_t> frames;
  std::vector<Persistence> persistences(plots.size(), Persistence::kIncidental);
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const Eigen::Vector3f place_m = plots[i].position_m.cast<float>();
    if (!static_places.IsStatic(place_m)) continue;
    static_places.places().InsertBins(place_m, &seen);
    frames.clear();
    seen.MoveTo(&frames);
    const bool is_transient = IsTransient(static_places.places().Count(place_m), recording.frames,
                                          frames.front(), frames.back());
    persistences[i] = is_transient ? Persistence::kTransient : Persistence::kPersistent;
  }
  return persistences;
}

// Static plots of one time.
struct StaticDetections {
  TimeNs time_ns;
  PointTree<double> places_m;
};

std::vector<StaticDetections> ByTime(const std::vector<Plot>& plots,
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

// Counts the static plots around a plot.
struct NeighbourCount {
  const Eigen::Vector3d& position_m;
  double reach_m;
  Neighbours neighbours{};

  // Adds the places of a node: all at once where the nearest and the farthest point of its box are
  // counted alike.
  void Add(const PointTree<double>& places_m, std::uint32_t id) {
    const PointTree<double>::Node& node = places_m.nodes()[id];
    const Eigen::Vector3d below_m = position_m - node.low_m;
    const Eigen::Vector3d above_m = node.high_m - position_m;
    const double nearest_m = (-below_m).cwiseMax(-above_m).cwiseMax(0.0).norm();
    const double farthest_m = below_m.cwiseAbs().cwiseMax(above_m.cwiseAbs()).norm();
    const auto size = static_cast<std::int32_t>(node.end - node.begin);
    if (Neighbours::AreAlike(nearest_m, farthest_m, reach_m)) {
      neighbours.Add(nearest_m, reach_m, size);
    } else if (node.IsLeaf()) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        neighbours.Add((position_m - places_m.points_m()[i]).norm(), reach_m);
      }
    } else {
      Add(places_m, node.left);
      Add(places_m, node.right);
    }
  }
};

// Adds the floating plots, with the static ones around them at the same time.
void AddFloating(const std::vector<Plot>& plots, const std::vector<Persistence>& persistences,
                 const Support& support, NeighbourTest* test) {
  constexpr TimeNs kSameTimeNs = 300'000'000;  // at most so much earlier or later
  const std::vector<StaticDetections> all_static = ByTime(plots, persistences);
  auto first = all_static.begin();
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const Plot& plot = plots[i];
    const TimeNs from_ns = plot.frame_time_ns - kSameTimeNs;
    const TimeNs to_ns = plot.frame_time_ns + kSameTimeNs;
    while (first != all_static.end() && first->time_ns < from_ns) ++first;
    if (!plot.is_floating) continue;
    const Eigen::Vector3f place_m = plot.position_m.cast<float>();
    const bool is_transient = persistences[i] == Persistence::kTransient;
    NeighbourCount count{plot.position_m, support.ReachM(place_m, is_transient)};
    for (auto at = first; at != all_static.end() && at->time_ns <= to_ns; ++at) {
      count.Add(at->places_m, 0);
    }
    test->Add(place_m, count.neighbours);
  }
}

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
  NeighbourTest neighbour_test;
  AddFloating(*plots, persistences, support, &neighbour_test);
  const std::vector<char> are_replayed = AreReplayed(recording, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = plot.is_floating && !are_replayed[i] &&
                       !neighbour_test.HasNeighbours(plot.position_m.cast<float>());
  }
}

BinRange FloatingPlots::RecentBins(std::uint32_t bin) {
  return {bin + 1 - std::min(bin + 1, kRecentBins), bin + 1};
}

void FloatingPlots::Add(const Support& support, std::uint32_t bin, std::uint32_t num_recent_frames,
                        Plot* plot) {
  constexpr double kPersistentShare = 0.2;  // of the recent frames of its sensor with a plot there
  const Eigen::Vector3f place_m = plot->PlaceM().cast<float>();
  if (bin >= first_bin_ + 2 * kKeptBins) {
    first_bin_ = bin - kKeptBins;
    for (RangeGrid& places : places_) places.Forget(first_bin_);
  }
  while (places_.size() <= plot->sensor) places_.emplace_back(place_);
  RangeGrid& own_places = places_[plot->sensor];
  static_places_.Add(place_m, bin);
  own_places.Add(place_m, bin);
  // An object that is hit only occasionally is a twig or a wire, whatever is beside it.
  const bool is_persistent =
      own_places.Count(place_m, RecentBins(bin)) >= kPersistentShare * num_recent_frames;
  plot->is_floating =
      static_places_.IsStatic(place_m) && is_persistent && support.IsFloating(place_m);
}

void FloatingPlots::Forget(std::uint32_t before_bin) {
  static_places_.Forget(before_bin);
  for (RangeGrid& places : places_) places.Forget(std::max(before_bin, first_bin_));
}

}  // namespace unlidar
