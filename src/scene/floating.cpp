#include "scene/floating.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "base/point_tree.hpp"

namespace unlidar {
namespace {

// Returns, per plot, whether it floats and all its returns recur in another frame with identical
// coordinates: no LiDAR measures the same coordinates twice, so these are replays of one frame.
std::vector<char> AreReplayed(const Recording& recording, const std::vector<Plot>& plots) {
  const auto key = [&](std::uint32_t i) {
    const Eigen::Vector3f& p = recording.points_m[i];
    return std::array<float, 3>{p.x(), p.y(), p.z()};
  };
  struct Frames {
    std::uint32_t first;
    bool is_repeated;
  };
  // Holds floating plots alone, as strays would add many more.
  std::map<std::array<float, 3>, Frames> frames_of;
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

// True if the plots of a place, all within these frames, are of a transient object:
// n plots of one that is always there fall within a share s of the frames with a probability of at
// most n s^(n - 1), here below 1 in 100, and swaying objects return within less than 20 s.
bool IsTransient(std::uint32_t num_plots, const std::vector<FrameInfo>& frames, BinRange span) {
  constexpr double kMaxChanceProbability = 0.01;
  constexpr TimeNs kLongestSwayNs = 20'000'000'000;
  const double share =
      static_cast<double>(span.last - span.first) / static_cast<double>(frames.size());
  const TimeNs before_ns = frames[span.first].begin_ns - frames.front().begin_ns;
  const TimeNs after_ns = frames.back().end_ns - frames[span.last - 1].end_ns;
  return num_plots * std::pow(share, num_plots - 1.0) < kMaxChanceProbability &&
         before_ns + after_ns > kLongestSwayNs;
}

std::vector<Persistence> PersistencesOf(const Recording& recording, const std::vector<Plot>& plots,
                                        const RobustConfig& config) {
  StaticPlaces static_places(config.background.place);
  for (const Plot& plot : plots) static_places.Add(plot.position_m.cast<float>(), plot.frame);
  std::vector<Persistence> persistences(plots.size(), Persistence::kIncidental);
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const Eigen::Vector3f place_m = plots[i].position_m.cast<float>();
    if (!static_places.IsStatic(place_m)) continue;
    const RangeGrid& places = static_places.places();
    const bool is_transient =
        config.Uses(Rule::kTransient) &&
        IsTransient(places.Count(place_m), recording.frames, places.SpanOf(place_m));
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

// Static plots around unsupported static ones at the same times, summed over these.
struct Neighbours {
  std::int32_t plots = 0;         // unsupported ones
  std::int32_t self = 0;          // within the size of a body, themselves included,
  std::int32_t neighbouring = 0;  // within reach of a support,
  std::int32_t surrounding = 0;   // and farther away

  Neighbours& operator+=(const Neighbours& other) {
    plots += other.plots;
    self += other.self;
    neighbouring += other.neighbouring;
    surrounding += other.surrounding;
    return *this;
  }
};

constexpr double kOuterReachFactor = 5.0;  // radius of the surroundings over the reach

// Counts the static plots of a node around an unsupported one: all at once where the nearest and
// the farthest point of its box are counted alike.
void CountNeighbours(const PointTree<double>& places_m, std::uint32_t id,
                     const Eigen::Vector3d& position_m, double reach_m, Neighbours* sum) {
  const double outer_m = kOuterReachFactor * reach_m;
  const auto count_at = [&](double distance_m) {
    if (distance_m <= kObjectRadiusM) return &sum->self;
    return distance_m < reach_m ? &sum->neighbouring : &sum->surrounding;
  };
  const PointTree<double>::Node& node = places_m.nodes()[id];
  const Eigen::Vector3d below_m = position_m - node.low_m;
  const Eigen::Vector3d above_m = node.high_m - position_m;
  const double nearest_m = (-below_m).cwiseMax(-above_m).cwiseMax(0.0).norm();
  const double farthest_m = below_m.cwiseAbs().cwiseMax(above_m.cwiseAbs()).norm();
  if (nearest_m >= outer_m) return;
  std::int32_t* const count = count_at(nearest_m);
  if (count == count_at(farthest_m) && farthest_m < outer_m) {
    *count += static_cast<std::int32_t>(node.end - node.begin);
  } else if (node.IsLeaf()) {
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      const double distance_m = (position_m - places_m.points_m()[i]).norm();
      if (distance_m < outer_m) ++*count_at(distance_m);
    }
  } else {
    CountNeighbours(places_m, node.left, position_m, reach_m, sum);
    CountNeighbours(places_m, node.right, position_m, reach_m, sum);
  }
}

// The neighbours of unsupported static plots, by place.
using NeighbourTable = ShellTable<Neighbours>;

NeighbourTable NeighboursOf(const std::vector<Plot>& plots,
                            const std::vector<Persistence>& persistences, const Support& support) {
  constexpr TimeNs kSameTimeNs = 300'000'000;  // at most so much earlier or later
  NeighbourTable table({kObjectRadiusM, 0.01});
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
    const double reach_m = support.ReachM(place_m, is_transient);
    Neighbours own{1};
    for (auto at = first; at != all_static.end() && at->time_ns <= to_ns; ++at) {
      CountNeighbours(at->places_m, 0, plot.position_m, reach_m, &own);
    }
    table.VisitOverlappingShells({&place_m, 1}, {},
                                 [&](std::size_t, Neighbours& sum, bool) { sum += own; });
  }
  return table;
}

// True if the unsupported static plots of a place, at least one, have more static neighbours within
// reach than chance allows, as the density farther away tells: objects hit too seldom to be
// structure can hold them up as well. Static plots at other times do not count, as they may be the
// target itself.
bool HasNeighbours(const NeighbourTable& table, const Eigen::Vector3f& place_m) {
  Neighbours sum;
  table.VisitNeighbourhood(place_m, [&](const Neighbours& one) { sum += one; });
  // Each neighbour was counted once for every plot of this place near it in time.
  const double times = static_cast<double>(sum.self) / sum.plots;
  const double chance =
      sum.surrounding / times / (kOuterReachFactor * kOuterReachFactor * kOuterReachFactor - 1.0);
  return sum.neighbouring / times > chance + 2.0 * std::sqrt(chance);
}

}  // namespace

void MarkFloating(const Recording& recording, const Support& support, const RobustConfig& config,
                  std::vector<Plot>* plots) {
  if (plots->empty()) return;
  const std::vector<Persistence> persistences = PersistencesOf(recording, *plots, config);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = persistences[i] != Persistence::kIncidental &&
                       support.IsFloating(plot.position_m.cast<float>(),
                                          persistences[i] == Persistence::kTransient);
  }
  const NeighbourTable neighbours = NeighboursOf(*plots, persistences, support);
  const std::vector<char> are_replayed = AreReplayed(recording, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = plot.is_floating && !are_replayed[i] &&
                       !HasNeighbours(neighbours, plot.position_m.cast<float>());
  }
}

bool StaticPlaces::IsStatic(const Eigen::Vector3f& place_m) const {
  constexpr std::uint32_t kMinPlots = 3;
  const std::uint32_t here = places_.Count(place_m);
  const double chance =
      regions_.Count(place_m) * places_.VolumeM3(place_m) / regions_.VolumeM3(place_m);
  return here >= kMinPlots && here > chance + 3.0 * std::sqrt(chance);
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
