#include "recording/robust.hpp"

#include <algorithm>
#include <utility>

#include "base/algorithms.hpp"
#include "collection/cloud.hpp"
#include "collection/collect.hpp"
#include "collection/dwells.hpp"
#include "collection/suspended.hpp"
#include "scene/multi_station_plots.hpp"
#include "tracking/alternative_modes.hpp"
#include "tracking/flight.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/track_model.hpp"

namespace unlidar {
namespace {

// Searches the paths of a recording, judges them, and collects their targets.
class TargetSearch {
 public:
  TargetSearch(const Recording& recording, const RobustConfig& config,
               const TrajectoryConfig& trajectory_config)
      : recording_(recording),
        config_(config),
        trajectory_config_(trajectory_config),
        found_(recording, Stations(recording.sensors), config),
        plots_(found_.plots()),
        scan_schedule_(ScanScheduleOf(recording)),
        station_models_(found_.StationModels()),
        score_threshold_(
            ScoreThreshold(static_cast<double>(std::max<std::size_t>(plots_.size(), 1)),
                           config.false_alarms_per_recording, config.tracker)) {}

  // The plots of targets are no clutter, which makes a second round more sensitive; it suffices to
  // know them roughly. Static unsupported plots are none from the start.
  void Run() {
    assigned_.resize(plots_.size());
    std::transform(plots_.begin(), plots_.end(), assigned_.begin(), [](const Plot& plot) {
      return static_cast<char>(plot.is_floating && plot.has_structure);
    });
    const auto search = [&] {
      return DecideOn(FindPaths(plots_, scan_schedule_, config_.tracker));
    };
    found_.EstimateClutter(assigned_);
    const bool has_second_round = config_.Uses(Rule::kSecondRound);
    const bool is_second_round =
        has_second_round && DecideOn(FindPathsRoughly(plots_, scan_schedule_, config_.tracker));
    if (is_second_round) found_.EstimateClutter(assigned_);
    if (search() && has_second_round && !is_second_round) {
      found_.EstimateClutter(assigned_);
      search();
    }
  }

  // Returns the targets of the paths that no rule has refused; sets the verdicts of the others.
  // They are collected one after the other: a return belongs to at most one target.
  std::vector<Target> Collect() {
    excluded_ = found_.are_bodies();
    assigned_returns_.assign(excluded_.size(), 0);
    for (std::size_t k = 0; k < paths_.size(); ++k) {
      PathVerdict& verdict = verdicts_[k];
      if (verdict.rejection == Rejection::kNone) verdict.rejection = Add(k);
    }
    const std::vector<Rejection> rejections =
        ShapeRejections(recording_, station_models_, plots_, targets_, config_);
    std::vector<Target> kept;
    for (std::size_t t = 0; t < targets_.size(); ++t) {
      verdicts_[path_of_[t]].rejection = rejections[t];
      if (rejections[t] == Rejection::kNone) kept.push_back(std::move(targets_[t]));
    }
    for (std::size_t t = 0; t < targets_.size() && config_.Uses(Rule::kCloudParts); ++t) {
      if (rejections[t] == Rejection::kCloud) AddPartOfCloud(t, &kept);
    }
    return kept;
  }

  RobustCounts Counts() const {
    const std::vector<char>& are_bodies = found_.are_bodies();
    return {found_.num_unexplained(),
            static_cast<std::size_t>(std::count(are_bodies.begin(), are_bodies.end(), 1)),
            plots_.size(),
            paths_.size(),
            score_threshold_,
            config_.false_alarms_per_recording};
  }

  SearchTrace Trace() const {
    return {plots_, found_.are_bodies(), paths_, verdicts_, score_threshold_};
  }

 private:
  // Takes these paths, sets the verdicts on them, and cuts off from them what is no drone. Returns
  // true if any is a target, whose plots are then assigned.
  bool DecideOn(std::vector<Path> paths) {
    paths_ = std::move(paths);
    verdicts_.clear();
    bool has_target = false;
    std::vector<char> are_free(plots_.size(), 1);
    log_births_ = LogBirths(plots_, scan_schedule_, config_.tracker);
    const PathGates gates = Gates();
    const PathScorer joins = JoinScorer();
    const auto other_side_of = [&](const auto& before, const auto& after) {
      const bool begins_without = gates.IsNoDrone(before);
      if (begins_without == gates.IsNoDrone(after)) return OtherSide::kNone;
      return begins_without ? OtherSide::kBefore : OtherSide::kAfter;
    };
    for (Path& path : paths_) {
      PathVerdict& verdict = verdicts_.emplace_back();
      verdict.rejection = RejectionOf(path, gates);
      if (verdict.rejection != Rejection::kNone) continue;
      if (config_.Uses(Rule::kPause) && CutAtPauses(joins, other_side_of, &path)) {
        path = joins.WithScore(path.plots);
        verdict.rejection = RejectionOf(path, gates);
        if (verdict.rejection != Rejection::kNone) continue;
      }
      if (config_.Uses(Rule::kCrowded)) {
        verdict.crowding_penalty =
            CrowdingPenalty(path.plots, plots_, are_free,
                            [this](const Plot& plot) { return NumFramesAbout(plot); });
      }
      if (path.score - verdict.crowding_penalty < score_threshold_) {
        verdict.rejection = Rejection::kCrowded;
        continue;
      }
      for (const std::uint32_t i : path.plots) {
        are_free[i] = 0;
        assigned_[i] = 1;
      }
      has_target = true;
    }
    return has_target;
  }

  PathGates Gates() const {
    return {PathScorer(plots_, log_births_, scan_schedule_, config_.tracker), score_threshold_,
            recording_, found_.bodies(), config_};
  }

  PathScorer JoinScorer() const {
    return {plots_, log_births_, scan_schedule_, config_.tracker, TimeOutOfView::kLogUniform};
  }

  Rejection RejectionOf(const Path& path, const PathGates& gates) const {
    return path.score < score_threshold_ ? Rejection::kBelowThreshold
                                         : gates.RejectionOf(path.plots);
  }

  std::uint32_t NumFramesAbout(const Plot& plot) const {
    const TimeBins& bins = *station_models_[plot.sensor].bins;
    return bins.NumFrames(plot.sensor,
                          bins.BinsAround(bins.BinOf(plot.time_ns), ClutterMap::kExclusionBins));
  }

  // Collects the target of a path, or extends another one by it if both are one.
  Rejection Add(std::size_t k) {
    const Path& path = paths_[k];
    std::vector<Plot> members = FreePlotsOf(path.plots);
    if (2 * members.size() < path.plots.size()) {
      // A drone that yields two plots per frame leaves a second path beside the first, which may
      // continue beyond its end.
      const std::size_t owner = OwnerOf(path);
      if (owner == targets_.size()) return Rejection::kSharesReturns;
      Extend(owner, path);
      return Rejection::kPartOfAnotherTrack;
    }
    if (!HasMinFrames(members, config_.min_plots)) return Rejection::kTooFewDetections;
    Target target;
    const Rejection rejection = Collect(k, std::move(members), &target);
    if (rejection != Rejection::kNone) return rejection;
    Mark(target, 1);
    targets_.push_back(std::move(target));
    path_of_.push_back(k);
    return Rejection::kNone;
  }

  // A drone that appears within reach of a cloud, seconds later or before, is joined to its path.
  // Keeps the side of the longest pause that is a path by itself and certainly no cloud.
  void AddPartOfCloud(std::size_t t, std::vector<Target>* kept) {
    const std::size_t k = path_of_[t];
    Mark(targets_[t], 0);
    const Members path = paths_[k].plots;
    TimeNs longest_ns = 0;
    auto behind = path.begin();
    for (auto next = path.begin() + 1; next != path.end(); ++next) {
      const TimeNs pause_ns = plots_[*next].time_ns - plots_[next[-1]].time_ns;
      if (pause_ns <= longest_ns) continue;
      longest_ns = pause_ns;
      behind = next;
    }
    const PathGates gates = Gates();
    const PathScorer joins = JoinScorer();
    for (const Members& side : {Members(behind, path.end()), Members(path.begin(), behind)}) {
      std::vector<Plot> members = FreePlotsOf(side);
      if (!HasMinFrames(members, config_.min_plots)) continue;
      Path part = joins.WithScore(side);
      if (RejectionOf(part, gates) != Rejection::kNone) continue;
      const Path whole = std::exchange(paths_[k], std::move(part));
      Target target;
      if (Collect(k, std::move(members), &target) == Rejection::kNone &&
          IsCertainlyNoCloud(recording_, station_models_, plots_, target, config_)) {
        Mark(target, 1);
        kept->push_back(std::move(target));
        verdicts_[k].rejection = Rejection::kNone;
        return;
      }
      paths_[k] = whole;
    }
  }

  // Returns the plots of a path without excluded returns.
  std::vector<Plot> FreePlotsOf(const Members& path) const {
    std::vector<Plot> members = ValuesAt(path, plots_);
    EraseIf(&members, [&](const Plot& plot) { return HasAnyOf(plot, excluded_); });
    return members;
  }

  Rejection Collect(std::size_t k, std::vector<Plot> members, Target* target) {
    if (config_.Uses(Rule::kDwell)) AddDwells(recording_, assigned_returns_, &members);
    for (const Plot& plot : members) {
      for (const std::uint32_t i : plot.returns) excluded_[i] = 0;
    }
    *target =
        CollectTarget(recording_, station_models_, members, excluded_, config_, trajectory_config_);
    const std::vector<Measurement>& measurements = target->measurements;
    // Without the returns of other targets a single measurement may be left, which is no track.
    if (measurements.size() < 2) return Rejection::kSingleMeasurement;
    if (config_.Uses(Rule::kSuspended) && MayBeSuspended(measurements)) {
      return Rejection::kSuspended;
    }
    target->score = paths_[k].score;
    if (config_.Uses(Rule::kAlternatives)) {
      target->alternative_modes =
          AlternativeModesOf(k, paths_, plots_, scan_schedule_, config_.tracker, measurements);
    }
    if (!config_.Uses(Rule::kFrameLength)) target->time_bias_ns = 0;
    target->trajectory = FitTrajectoryByCeres(measurements, trajectory_config_);
    return Rejection::kNone;
  }

  void Mark(const Target& target, char is_assigned) {
    for (const std::uint32_t i : target.returns) excluded_[i] = assigned_returns_[i] = is_assigned;
  }

  // Returns the target that has most of the plots of a path; the number of targets if none has.
  std::size_t OwnerOf(const Path& path) const {
    const auto is_owner = [&](const Target& target) {
      const auto has = [&](std::uint32_t plot) {
        const IndexList& returns = plots_[plot].returns;
        return std::any_of(returns.begin(), returns.end(), [&](std::uint32_t i) {
          return std::binary_search(target.returns.begin(), target.returns.end(), i);
        });
      };
      const auto own = std::count_if(path.plots.begin(), path.plots.end(), has);
      return 2 * static_cast<std::size_t>(own) > path.plots.size();
    };
    return static_cast<std::size_t>(std::find_if(targets_.begin(), targets_.end(), is_owner) -
                                    targets_.begin());
  }

  // Extends a target by the plots of another path before and after it, with their share of the
  // score, if they suffice for a target by themselves.
  void Extend(std::size_t owner, const Path& other) {
    Target& target = targets_[owner];
    const TimeNs begin_ns = target.measurements.front().time_ns;
    const TimeNs end_ns = target.measurements.back().time_ns;
    Path beyond;
    for (const std::uint32_t plot : other.plots) {
      const TimeNs time_ns = plots_[plot].time_ns;
      const bool is_within = begin_ns <= time_ns && time_ns <= end_ns;
      if (!is_within && !HasAnyOf(plots_[plot], excluded_)) beyond.plots.push_back(plot);
    }
    if (!HasMinFrames(ValuesAt(beyond.plots, plots_), config_.min_plots)) return;
    Path& path = paths_[path_of_[owner]];
    const Path before = path;
    path.score += other.score * static_cast<double>(beyond.plots.size()) /
                  static_cast<double>(other.plots.size());
    path.plots.insert(path.plots.end(), beyond.plots.begin(), beyond.plots.end());
    std::sort(path.plots.begin(), path.plots.end());
    Mark(target, 0);
    Target whole;
    if (Collect(path_of_[owner], FreePlotsOf(path.plots), &whole) == Rejection::kNone) {
      target = std::move(whole);
    } else {
      path = before;
    }
    Mark(target, 1);
  }

  const Recording& recording_;
  const RobustConfig& config_;
  const TrajectoryConfig& trajectory_config_;
  MultiStationPlots found_;
  const std::vector<Plot>& plots_;
  ScanSchedule scan_schedule_;
  std::vector<StationModel> station_models_;
  double score_threshold_;
  std::vector<double> log_births_;  // (plots)
  std::vector<char> assigned_;      // (plots)
  std::vector<Path> paths_;
  std::vector<PathVerdict> verdicts_;   // (paths)
  std::vector<char> excluded_;          // returns of bodies and of targets
  std::vector<char> assigned_returns_;  // returns of targets
  std::vector<Target> targets_;
  std::vector<std::size_t> path_of_;  // (targets)
};

}  // namespace

RobustResult FindTargetsRobust(const Recording& recording, const RobustConfig& config,
                               const TrajectoryConfig& trajectory_config, const TraceSink& trace) {
  RobustResult result;
  if (recording.points_m.empty()) {
    if (trace) trace(recording, {{}, {}, {}, {}, 0.0});
    return result;
  }
  TargetSearch search(recording, config, trajectory_config);
  search.Run();
  result.counts = search.Counts();
  result.targets = search.Collect();
  if (trace) trace(recording, search.Trace());
  for (Target& target : result.targets) {
    for (Measurement& m : target.measurements) m.time_ns += target.time_bias_ns;
    for (AlternativeMode& mode : target.alternative_modes) mode.time_ns += target.time_bias_ns;
    target.trajectory.origin_ns += target.time_bias_ns;
  }
  return result;
}

}  // namespace unlidar
