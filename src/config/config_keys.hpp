// Single table of config keys: name (with its unit), field and constraint. Loading a file, --set
// and listing the effective config all iterate over it, so that they know the same keys.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "unlidar/config.hpp"

namespace unlidar {

// Constraints of a value.
struct Flag {};  // true or false
struct Range {   // finite numbers between low and high,
  double low;
  double high;
  bool low_is_allowed = true;
  bool may_be_endless = false;  // infinity, too (.inf in YAML)
};
struct Elements {  // a list of one or more numbers, each in the range
  Range each;
};
struct Vector3 {  // three finite numbers
  double max_abs;
};
struct UnitQuaternion {};  // x, y, z, w
template <class E>
struct Choices {
  std::vector<std::pair<const char*, E>> names;
};

template <class E>
struct Subset {  // a list of some of these, each at most once; may be empty
  Choices<E> each;
};

// Calls visit(key, field, constraint) for every key of a sensor.
template <class Visitor, class Sensor>
void VisitSensorKeys(Visitor&& visit, const std::string& prefix, Sensor& sensor) {
  visit(prefix + "translation_m", sensor.translation_m, Vector3{1e6});
  visit(prefix + "rotation", sensor.rotation_xyzw, UnitQuaternion{});
  visit(prefix + "time_offset_s", sensor.time_offset_s, Range{-1e9, 1e9});
  visit(prefix + "frame_rate_hz", sensor.frame_rate_hz, Range{0, 1e9});
}

template <class Visitor, class Clustering>
void VisitClusteringKeys(Visitor&& visit, const std::string& prefix, Clustering& clustering) {
  visit(prefix + "method", clustering.method,
        Choices<ClusterMethod>{
            {{"euclidean", ClusterMethod::kEuclidean}, {"dbscan", ClusterMethod::kDbscan}}});
  visit(prefix + "engine", clustering.engine,
        Choices<ClusterEngine>{{{"grid", ClusterEngine::kGrid}, {"pcl", ClusterEngine::kPcl}}});
  visit(prefix + "tolerance_m", clustering.tolerance_m, Range{1e-6, 1e6});
  visit(prefix + "min_neighbours", clustering.min_neighbours, Range{1, 1e6});
  visit(prefix + "min_cluster_size", clustering.min_cluster_size, Range{1, 1e9});
}

template <class Visitor, class Radius>
void VisitRadiusKeys(Visitor&& visit, const std::string& prefix, Radius& radius) {
  visit(prefix + "constant_m", radius.constant_m, Range{1e-3, 1e3});
  visit(prefix + "slope", radius.slope, Range{0, 1});
}

// Calls visit(key, field, constraint) for every key except those of the sensors.
template <class Visitor, class AnyConfig>
void VisitKeys(Visitor&& visit, AnyConfig& config) {
  visit("method", config.method,
        Choices<Method>{{{"robust", Method::kRobust}, {"paper", Method::kPaper}}});

  auto& input = config.input;
  visit("input.skip_bad_frames", input.skip_bad_frames, Flag{});
  visit("input.scale_m", input.scale_m, Range{1e-6, 1e6});
  visit("input.frame_rate_hz", input.frame_rate_hz, Range{0, 1e9});
  visit("input.min_range_m", input.min_range_m, Range{0, 1e4});
  visit("input.max_range_m", input.max_range_m, Range{0, 1e5, false});
  visit("input.stamp", input.stamp,
        Choices<StampMeaning>{{{"begin", StampMeaning::kBegin},
                               {"middle", StampMeaning::kMiddle},
                               {"end", StampMeaning::kEnd}}});

  auto& robust = config.robust;
  visit("robust.false_alarms_per_recording", robust.false_alarms_per_recording, Range{0, 1, false});
  visit("robust.window_s", robust.window_s, Range{5, 90});
  visit("robust.window_margin_s", robust.window_margin_s, Range{0, 15});
  visit("robust.min_plots", robust.min_plots, Range{2, 1000});
  visit("robust.off_ground_m", robust.off_ground_m, Range{0, 1e3});
  visit("robust.min_cross_section_m2", robust.min_cross_section_m2, Range{0, 1e6});
  visit("robust.disabled_rules", robust.disabled_rules,
        Subset<Rule>{{{{"transient", Rule::kTransient},
                       {"dwell", Rule::kDwell},
                       {"spots", Rule::kSpots},
                       {"alternatives", Rule::kAlternatives},
                       {"frame_length", Rule::kFrameLength},
                       {"crowded", Rule::kCrowded},
                       {"bodies", Rule::kBodies},
                       {"on_structure", Rule::kOnStructure},
                       {"strays", Rule::kStrays},
                       {"stray_groups", Rule::kStrayGroups},
                       {"local_clutter", Rule::kLocalClutter},
                       {"second_round", Rule::kSecondRound},
                       {"round_bodies", Rule::kRoundBodies},
                       {"collection", Rule::kCollection},
                       {"agility_change", Rule::kAgilityChange},
                       {"ground_past", Rule::kGroundPast},
                       {"ground_claim", Rule::kGroundClaim},
                       {"likelier_refusal", Rule::kLikelierRefusal},
                       {"clutter_learning", Rule::kClutterLearning},
                       {"pause", Rule::kPause},
                       {"stationary", Rule::kStationary},
                       {"surge", Rule::kSurge},
                       {"sway", Rule::kSway},
                       {"suspended", Rule::kSuspended},
                       {"cloud", Rule::kCloud},
                       {"growth", Rule::kGrowth},
                       {"volume_scattering", Rule::kVolumeScattering},
                       {"cloud_parts", Rule::kCloudParts},
                       {"insect", Rule::kInsect}}}});

  auto& background = robust.background;
  VisitRadiusKeys(visit, "robust.background.place.", background.place);
  visit("robust.background.max_dwell_gap_s", background.max_dwell_gap_s, Range{0, 3600});
  visit("robust.background.min_exposure", background.min_exposure, Range{0, 1});
  visit("robust.background.max_occupancy", background.max_occupancy, Range{0, 1});

  auto& support = robust.support;
  VisitRadiusKeys(visit, "robust.support.reach.", support.reach);
  visit("robust.support.max_range_m", support.max_range_m, Range{0, 1e5});

  auto& plots = robust.plots;
  VisitRadiusKeys(visit, "robust.plots.link.", plots.link);
  visit("robust.plots.body_spread_m", plots.body_spread_m, Range{0, 100});
  visit("robust.plots.noise_m", plots.noise_m, Range{1e-4, 10});
  visit("robust.plots.noise_per_return_m", plots.noise_per_return_m, Range{0, 10});
  visit("robust.plots.noise_per_range", plots.noise_per_range, Range{0, 1});

  auto& tracker = robust.tracker;
  visit("robust.tracker.sigma_a_mps2", tracker.sigma_a_mps2, Elements{{1e-2, 1e3}});
  visit("robust.tracker.manoeuvre_log_probability", tracker.manoeuvre_log_probability,
        Range{-1e3, 0});
  visit("robust.tracker.birth_speeds_mps", tracker.birth_speeds_mps, Elements{{1e-2, 1e3}});
  visit("robust.tracker.uniform_birth_share", tracker.uniform_birth_share, Range{0, 1, false});
  visit("robust.tracker.max_speed_mps", tracker.max_speed_mps, Range{0, 1e4, false});
  visit("robust.tracker.gate_sigmas", tracker.gate_sigmas, Range{1, 1e6});
  visit("robust.tracker.max_gap_s", tracker.max_gap_s, Range{0, 600, false});
  visit("robust.tracker.out_of_view_probability", tracker.out_of_view_probability, Range{0, 1});
  visit("robust.tracker.hypotheses_per_plot", tracker.hypotheses_per_plot, Range{1, 1000});
  visit("robust.tracker.return_rate_m2_per_s", tracker.return_rate_m2_per_s, Range{1e-2, 1e10});
  visit("robust.tracker.max_hypotheses", tracker.max_hypotheses, Range{1, 1e7});

  auto& collect = robust.collect;
  visit("robust.collect.extent_sigma_m", collect.extent_sigma_m, Range{1e-3, 100});
  visit("robust.collect.centroid_offset", collect.centroid_offset, Range{0, 10});
  visit("robust.collect.sensor_bias_m", collect.sensor_bias_m, Range{1e-6, 100});
  visit("robust.collect.sensor_delay_s", collect.sensor_delay_s, Range{1e-6, 100});

  auto& trajectory = config.trajectory;
  visit("trajectory.typical_acceleration_mps2", trajectory.typical_acceleration_mps2,
        Range{1e-3, 1e3});
  visit("trajectory.max_extrapolation_s", trajectory.max_extrapolation_s, Range{0, 60});
  visit("trajectory.min_missed_run_probability", trajectory.min_missed_run_probability,
        Range{0, 1, false});
  visit("trajectory.max_sigma_m", trajectory.max_sigma_m, Range{0, 1e4, false});
  visit("trajectory.disabled_rules", trajectory.disabled_rules,
        Subset<MotionRule>{{{{"agility", MotionRule::kAgility},
                             {"direction", MotionRule::kDirection},
                             {"acceleration_time", MotionRule::kAccelerationTime}}}});

  auto& live = config.live;
  visit("live.delay_s", live.delay_s, Range{0, 600, false, true});
  visit("live.window_s", live.window_s, Range{1, 86400, true, true});
  visit("live.reorder_s", live.reorder_s, Range{0, 60});
  visit("live.false_alarms_per_hour", live.false_alarms_per_hour, Range{0, 3600, false});
  visit("live.silent_s", live.silent_s, Range{0, 3600, false});
  visit("live.overload_s", live.overload_s, Range{0, 600, false});
  visit("live.frame_s", live.frame_s, Range{0.02, 1});

  auto& paper = config.paper;
  VisitClusteringKeys(visit, "paper.global_clusters.", paper.global_clusters);
  VisitClusteringKeys(visit, "paper.local_clusters.", paper.local_clusters);
  visit("paper.local", paper.local,
        Choices<LocalClusters>{{{"share_of_global", LocalClusters::kShareOfGlobal},
                                {"largest_of_window", LocalClusters::kLargestOfWindow}}});
  visit("paper.window_frames", paper.window_frames, Range{1, 1e6});
  visit("paper.voxel_size_m", paper.voxel_size_m, Range{1e-3, 1e3});
  visit("paper.lambda", paper.lambda, Range{0, 1e6});
  visit("paper.density_reading", paper.density_reading,
        Choices<DensityReading>{{{"frame_over_merged", DensityReading::kFrameOverMerged},
                                 {"merged_over_frame", DensityReading::kMergedOverFrame},
                                 {"relative_difference", DensityReading::kRelativeDifference}}});
  visit("paper.density_term", paper.density_term,
        Choices<DensityTerm>{
            {{"exponential", DensityTerm::kExponential}, {"linear", DensityTerm::kLinear}}});
  visit("paper.iou_term", paper.iou_term,
        Choices<IouTerm>{{{"logarithm", IouTerm::kLogarithm},
                          {"inverse", IouTerm::kInverse},
                          {"complement", IouTerm::kComplement}}});
  visit("paper.min_iou", paper.min_iou, Range{1e-6, 1});
  visit(
      "paper.empty_windows", paper.empty_windows,
      Choices<EmptyWindows>{{{"skip", EmptyWindows::kSkip}, {"zero_iou", EmptyWindows::kZeroIou}}});
  visit("paper.accumulation", paper.accumulation,
        Choices<Accumulation>{{{"mean", Accumulation::kMean}, {"sum", Accumulation::kSum}}});
  visit("paper.min_windows", paper.min_windows, Range{1, 1e6});
  visit("paper.return_sigma_m", paper.return_sigma_m, Range{1e-4, 1e2});
}

// A key of earlier versions, so that a file or --set which still has it learns what became of it.
struct FormerKey {
  std::string_view key;  // or a section, with all keys in it
  std::string_view now;  // the key that replaces it; empty: none does
};

inline constexpr std::array<FormerKey, 41> kFormerKeys{{
    {"robust.background.max_break_s", "robust.background.max_dwell_gap_s"},
    {"robust.collect.body_sigma_m", "robust.collect.extent_sigma_m"},
    {"robust.collect.facing_side", "robust.collect.centroid_offset"},
    {"robust.min_echo_m2_per_s", "robust.min_cross_section_m2"},
    {"robust.min_return_rate_m2_per_s", "robust.min_cross_section_m2"},
    {"robust.tracker.echo_m2_per_s", "robust.tracker.return_rate_m2_per_s"},
    {"robust.tracker.even_birth_share", "robust.tracker.uniform_birth_share"},
    {"robust.tracker.manoeuvre_log", "robust.tracker.manoeuvre_log_probability"},
    {"trajectory.silence_probability", "trajectory.min_missed_run_probability"},
    {"robust.background.bin_s", ""},
    {"robust.background.occluder_cell_deg", ""},
    {"robust.background.occluder_margin_m", ""},
    {"robust.collect.rounds", ""},
    {"robust.ground", ""},
    {"robust.off_ground_share", ""},
    {"robust.plots.body_contact_m", ""},
    {"robust.plots.body_contact_returns", ""},
    {"robust.plots.body_spread_returns", ""},
    {"robust.plots.clutter_middle", ""},
    {"robust.plots.clutter_narrow", ""},
    {"robust.plots.spot", ""},
    {"robust.rounds", ""},
    {"robust.support.body_m", ""},
    {"robust.support.far_m", ""},
    {"robust.support.far_reach", ""},
    {"robust.support.max_hidden_share", ""},
    {"robust.support.voxel_m", ""},
    {"robust.tracker.birth_cost", ""},
    {"robust.tracker.echo_shape", ""},
    {"robust.tracker.give_up_log", ""},
    {"robust.tracker.max_hypotheses_per_plot", ""},
    {"robust.tracker.max_paths", ""},
    {"robust.tracker.min_exchange_log", ""},
    {"robust.tracker.min_fragment_log", ""},
    {"robust.tracker.min_fragment_plots", ""},
    {"robust.tracker.rebirth_log", ""},
    {"trajectory.max_knot_spacing_s", ""},
    {"trajectory.max_noise_scale", ""},
    {"trajectory.min_knot_spacing_s", ""},
    {"trajectory.min_noise_scale", ""},
    {"trajectory.outlier_distance", ""},
}};

// Rules that `robust.disabled_rules` could name in earlier versions.
inline constexpr std::array<std::string_view, 2> kFormerRules{"clutter_returns",
                                                              "permutation_null"};

// Returns the entry of a key or of its section; null for a key that never was one.
inline const FormerKey* FindFormerKey(std::string_view key) {
  const auto* const found =
      std::find_if(kFormerKeys.begin(), kFormerKeys.end(), [&](const FormerKey& former) {
        return key.substr(0, former.key.size()) == former.key &&
               (key.size() == former.key.size() || key[former.key.size()] == '.');
      });
  return found == kFormerKeys.end() ? nullptr : found;
}

}  // namespace unlidar
