#include "tracking/flight.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>

#include "base/algorithms.hpp"
#include "tracking/cross_section.hpp"

namespace unlidar {
namespace {

// Height of the lowest plot of a path within a time of one of them: the lower parts of people and
// cars are not hit in every frame.
double LowestM(const std::vector<Plot>& path, const Plot& plot, TimeNs margin_ns) {
  const TimeNs time_ns = plot.frame_time_ns;
  const auto first = FirstFrom(path, &Plot::frame_time_ns, time_ns - margin_ns);
  const auto last = FirstFrom(path, &Plot::frame_time_ns, time_ns + margin_ns + 1);
  return std::min_element(first, last, By(&Plot::lowest_m))->lowest_m;
}

// Numbers of the plots above a height over ground, as are all others close in time.
Members NumbersAbove(const std::vector<Plot>& path, double height_m) {
  constexpr TimeNs kMarginNs = 750'000'000;
  Members numbers;
  for (std::uint32_t i = 0; i < path.size(); ++i) {
    if (LowestM(path, path[i], kMarginNs) > height_m) numbers.push_back(i);
  }
  return numbers;
}

constexpr double kMinOccupancyBelow = 0.05;  // of any place below a drone, at least

// Position on a path: linear between plots, constant beyond the ends.
Eigen::Vector3d PositionM(const std::vector<Plot>& path, TimeNs time_ns) {
  const auto next = FirstFrom(path, &Plot::frame_time_ns, time_ns);
  if (next == path.begin()) return next->position_m;
  const Plot& last = *(next - 1);
  if (next == path.end()) return last.position_m;
  const double share = static_cast<double>(time_ns - last.frame_time_ns) /
                       static_cast<double>(next->frame_time_ns - last.frame_time_ns);
  return last.position_m + share * (next->position_m - last.position_m);
}

// Share of the frames with returns below each of these plots, over the frames in which the path is
// too far away for a body at the plot to reach there.
std::vector<double> OccupancyBelowWhileAway(const Recording& recording,
                                            const std::vector<Plot>& path,
                                            const std::vector<const Plot*>& plots) {
  constexpr double kAwayM = 3.0;
  std::vector<double> shares(plots.size(), kMinOccupancyBelow);
  if (recording.points_m.empty()) return shares;  // a stream keeps no points
  Columns columns;
  for (const Plot* plot : plots) columns.Add(*plot);
  columns.Sort();
  std::vector<double> num_frames(plots.size(), 0.0);
  std::vector<double> num_hit(plots.size(), 0.0);
  std::vector<char> may_be_hit(plots.size());  // in the current frame, which counts once
  for (const FrameInfo& frame : recording.frames) {
    const Eigen::Vector3d path_m = PositionM(path, frame.middle_ns());
    for (std::size_t i = 0; i < plots.size(); ++i) {
      const Plot& plot = *plots[i];
      may_be_hit[i] =
          plot.sensor == frame.sensor && (plot.position_m - path_m).head<2>().norm() > kAwayM;
      if (may_be_hit[i]) num_frames[i] += 1.0;
    }
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      columns.VisitAbove(recording.points_m[i], [&](std::size_t plot) {
        if (std::exchange(may_be_hit[plot], 0)) num_hit[plot] += 1.0;
      });
    }
  }
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const double share = (num_hit[i] + kMinOccupancyBelow) / (num_frames[i] + 1.0);
    shares[i] = std::max(share, kMinOccupancyBelow);
  }
  return shares;
}

// Number of bodies that reach up to a path from below. Where legs are seen as well as a head, they
// are a body and no plot: the plots alone are those of the frames in which nothing is seen below.
std::size_t NumBodiesBelow(const std::vector<Plot>& path, const Queue<BodyBox>& bodies,
                           const RobustConfig& config) {
  // A path is straight for so long, to the radius of a column: it may bend by a few m/s^2.
  constexpr TimeNs kMaxGapNs = 1'000'000'000;
  std::size_t num_below = 0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Plot& last = path[i - 1];
    const Plot& next = path[i];
    if (next.frame_time_ns - last.frame_time_ns > kMaxGapNs) continue;
    if (std::min(last.lowest_m, next.lowest_m) > config.off_ground_m) continue;
    const auto radius_m = static_cast<float>(kColumnRadius.At(last.ray_m.norm()));
    const Eigen::Array3f reach_m(radius_m, radius_m, -static_cast<float>(kBelowPlotM));
    auto body = FirstFrom(bodies, &BodyBox::time_ns, last.frame_time_ns);
    for (; body != bodies.end() && body->time_ns < next.frame_time_ns; ++body) {
      const Eigen::Vector3f at_m = PositionM(path, body->time_ns).cast<float>();
      if ((at_m.array() > body->low_m - reach_m).all() &&
          (at_m.array() < body->high_m + reach_m).head<2>().all()) {
        ++num_below;
      }
    }
  }
  return num_below;
}

// Share of the lines of sight to the room below a plot that end before it, where `expected` is that
// of its path.
double HiddenShare(double num_before, double num_behind, double expected) {
  constexpr double kMinHidden = 0.02;  // by what has no returns, and by the body's own shape
  return std::max((num_before + expected) / (num_before + num_behind + 1.0), kMinHidden);
}

// Share of the lines of sight to the room below a whole path that end before it: many sensors have
// few returns there in a frame, and a wall or a hedge is longer than a car.
double HiddenShareBelow(const std::vector<Plot>& path) {
  double num_before = 0.0;
  double num_behind = 0.0;
  for (const Plot& plot : path) {
    num_before += plot.num_before_below;
    num_behind += plot.num_behind_below;
  }
  return HiddenShare(num_before, num_behind, 0.0);
}

// True if a path stays above where it is while its sensor travels. Heights do not count: a pole,
// an edge or a crown is hit at those that are in view and in reach from where the sensor is.
bool IsPassedAtRest(const std::vector<Plot>& path) {
  return (path.back().shift_m - path.front().shift_m).norm() > kMaxStationRadiusM &&
         DisplacementM(path).head<2>().norm() < kMinDisplacement.At(path.front().ray_m.norm());
}

// Plots near a path that are neither its own nor those of targets, in the order of `plots`.
std::vector<const Plot*> OthersNear(const Members& path, const std::vector<Plot>& plots,
                                    const std::vector<char>& are_free) {
  Eigen::AlignedBox3d box;
  double widest_m = 0.0;
  for (const std::uint32_t i : path) {
    box.extend(plots[i].position_m);
    widest_m = std::max(widest_m, kClutterNarrow.At(plots[i].ray_m.norm()));
  }
  const Eigen::AlignedBox3d near(box.min().array() - widest_m, box.max().array() + widest_m);
  std::vector<const Plot*> others;
  for (std::uint32_t k = 0; k < plots.size(); ++k) {
    if (are_free[k] == 0 || !near.contains(plots[k].position_m)) continue;
    if (!std::binary_search(path.begin(), path.end(), k)) others.push_back(&plots[k]);
  }
  return others;
}

// Returns the number of others within kCrowdingReachS of each of these times, in all. They ascend.
double NumWithinReach(const std::vector<TimeNs>& times_ns) {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  std::size_t count = 0;
  auto first = times_ns.begin();
  auto last = times_ns.begin();
  for (const TimeNs time_ns : times_ns) {
    while (*first < time_ns - reach_ns) ++first;
    while (last != times_ns.end() && *last <= time_ns + reach_ns) ++last;
    count += static_cast<std::size_t>(last - first) - 1;
  }
  return static_cast<double>(count);
}

}  // namespace

Eigen::Vector3d DisplacementM(const std::vector<Plot>& path) {
  const std::size_t third = std::max<std::size_t>(1, path.size() / 3);
  Eigen::Vector3d sum_m = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < third; ++i) {
    sum_m += path[path.size() - third + i].position_m - path[i].position_m;
  }
  return sum_m / static_cast<double>(third);
}

bool HasMinFrames(const std::vector<Plot>& path, int min_frames) {
  std::set<std::uint32_t> frames;
  for (const Plot& plot : path) frames.insert(plot.frame);
  return static_cast<int>(frames.size()) >= min_frames;
}

// A body that stands on the ground and is seen at some height returns proportionally more from the
// room below it (plots count returns beyond half a drone's height and the roughness of the ground).
// So each plot with nothing below makes a body less likely, the more the higher it is and the more
// returns it has, unless the rest is hidden, or lies between the beams of a spinning sensor. A plot
// with returns below makes a body more likely, the more the less often there are returns at other
// times: from a bollard there always are. Room is counted from the lowest plot close in time, as
// the lines of a sensor hit the top of a body in one frame and its foot in the next. What is higher
// than a body is no part of one, but it may be strays that join two cars: it tells nothing about
// what is lower.
bool HasNothingBelow(const Recording& recording, const std::vector<Plot>& path,
                     const Queue<BodyBox>& bodies, const RobustConfig& config) {
  constexpr double kNotCountedM = 0.55;
  const double hidden_below = HiddenShareBelow(path);
  double log_ratio = 0.0;  // body over drone
  std::vector<const Plot*> above_something;
  for (const Plot& plot : path) {
    if (plot.lowest_m > config.off_ground_m) continue;
    if (plot.num_below > 0) {
      above_something.push_back(&plot);
      continue;
    }
    // method.md (10)
    const double room_m =
        plot.watched_below * std::max(LowestM(path, plot, NsOf(kBodyMarginS)) - kNotCountedM, 0.0);
    const double own_share = kBodyPartM / (kBodyPartM + room_m);
    const double hidden = HiddenShare(plot.num_before_below, plot.num_behind_below, hidden_below);
    const double nothing = std::max(std::pow(own_share, plot.num_returns), hidden);
    log_ratio += std::log(nothing) - std::log1p(-kMinOccupancyBelow);
  }
  const double log_chance = std::log(config.false_alarms_per_recording);
  if (log_ratio < log_chance) {
    log_ratio -=
        static_cast<double>(NumBodiesBelow(path, bodies, config)) * std::log(kMinOccupancyBelow);
  }
  // For most paths of bodies the pass over all frames is not needed.
  if (above_something.empty() || log_ratio >= log_chance) return log_ratio < log_chance;
  for (const double share : OccupancyBelowWhileAway(recording, path, above_something)) {
    log_ratio -= std::log(share);
  }
  return log_ratio < log_chance;
}

Rejection FlightRejection(const Recording& recording, const std::vector<Plot>& path,
                          const Queue<BodyBox>& bodies, const ReachesThreshold& reaches_threshold,
                          const RobustConfig& config) {
  if (!HasMinFrames(path, config.min_plots)) return Rejection::kTooFewDetections;
  const auto is_path = [&](const Members& numbers) {
    return numbers.size() == path.size() ||
           (static_cast<int>(numbers.size()) >= config.min_plots && reaches_threshold(numbers));
  };
  // Above vegetation and objects on the ground, and the error of the ground height.
  constexpr double kClearM = 0.75;
  Members high = NumbersAbove(path, config.off_ground_m);
  if (!is_path(high)) {
    if (!HasNothingBelow(recording, path, bodies, config)) return Rejection::kNearGround;
    high = NumbersAbove(path, std::min(kClearM, config.off_ground_m));
    if (!is_path(high)) return Rejection::kNearGround;
  }
  EraseIf(&high, [&](std::uint32_t i) { return path[i].is_above_structure; });
  if (!is_path(high)) return Rejection::kOnStructure;
  const std::vector<double> cross_sections_m2 = CrossSectionsM2(recording, path);
  EraseIf(&high,
          [&](std::uint32_t i) { return cross_sections_m2[i] <= config.min_cross_section_m2; });
  if (!is_path(high)) return Rejection::kWeakReturn;
  if (config.Uses(Rule::kStationary) && IsPassedAtRest(path)) return Rejection::kStationary;
  return Rejection::kNone;
}

Rejection PathGates::RejectionOf(const Members& members) const {
  const auto reaches_threshold = [&](const Members& numbers) {
    return ReachesThreshold(ValuesAt(numbers, members));
  };
  return FlightRejection(recording_, ValuesAt(members, scorer_.plots()), bodies_, reaches_threshold,
                         config_);
}

double CrowdingPenalty(const Members& path, const std::vector<Plot>& plots,
                       const std::vector<char>& are_free,
                       const std::function<std::uint32_t(const Plot&)>& num_frames_about) {
  const TimeNs reach_ns = NsOf(kCrowdingReachS);
  const std::vector<const Plot*> others = OthersNear(path, plots, are_free);
  std::vector<TimeNs> spot_times_ns;
  double penalty = 0.0;
  for (const std::uint32_t i : path) {
    const Plot& plot = plots[i];
    const double radius_m = kClutterNarrow.At(plot.ray_m.norm());
    const double spot_m = kSpotRadius.At(plot.ray_m.norm());
    double num_about = 0.0;
    spot_times_ns.clear();
    for (const Plot* const other : others) {
      if (other->sensor != plot.sensor) continue;
      const double distance_m = (other->position_m - plot.position_m).norm();
      if (std::abs(other->frame_time_ns - plot.frame_time_ns) <= reach_ns) {
        num_about += distance_m <= radius_m ? 1.0 : 0.0;
      } else if (distance_m <= spot_m && !plot.is_floating) {
        spot_times_ns.push_back(other->frame_time_ns);
      }
    }
    const double rate = std::exp(plot.log_clutter);
    const double num_frames = num_frames_about(plot);
    const double exposure = num_frames * 4.0 / 3.0 * M_PI * radius_m * radius_m * radius_m;
    const double spot_exposure =
        static_cast<double>(spot_times_ns.size()) * num_frames * PlotVolumeM3(plot);
    const double crowded_rate =
        std::max(ClutterRate(num_about, exposure, rate),
                 ClutterRate(NumWithinReach(spot_times_ns), spot_exposure, rate));
    penalty += std::max(0.0, std::log(crowded_rate) - plot.log_clutter);
  }
  return penalty;
}

}  // namespace unlidar
