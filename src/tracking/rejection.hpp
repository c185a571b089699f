// The rules that refuse a plot, a path or a track, of recordings and of streams: one list.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

namespace unlidar {

// Each with its reason or source, and its switch: a key, or the name of a Rule in
// robust.disabled_rules. docs/explain.md has the same list for users. Only in recordings [R], only
// in streams [S], otherwise in both.
enum class Rejection {
  kNone,

  // Returns that yield no plot, and plots that are not searched.
  kStructure,  // the place returns at other times: clutter map; background.max_occupancy
  kBody,       // extended target that reaches the ground or exceeds any drone; rule bodies
  kWarmUp,     // [S] the station is still learning its clutter map; none, all would be new
  kSurge,      // [S] change point of the plot rate: the clutter map no longer holds; rule surge

  // Paths, in the order in which the gates apply.
  kBelowThreshold,    // track score test at the allowed false alarms (Ville); false_alarms_per_*
  kPause,             // plots beside a gap are another target's; named in streams; rule pause
  kTooFewDetections,  // M of N: repeated clutter is not independent evidence; robust.min_plots
  kNearGround,        // people and vehicles move as targets do; robust.off_ground_m, _share
  kOnStructure,       // the same on bridges and roofs; rule on_structure
  kStationary,        // at rest: [S] supported, or passed by the sensor; rule stationary
  kWeakReturn,        // cross-section of an insect; robust.min_cross_section_m2
  kCrowded,           // below the threshold given the neighbouring plots of the time; rule crowded
  kPartOfAnotherTrack,  // duplicate: most plots belong to one track; none, its track has them
  kSharesReturns,       // a return belongs to at most one target; none
  kSingleMeasurement,   // [R] no velocity follows from one measurement; none

  // Tracks, or the targets collected along a path.
  kSuspended,  // at rest to within the noise, far away: an unseen cable; rule suspended
  kCloud,      // extent across the motion beyond any drone: steam, dust; rule cloud
  kInsect,     // extent below that of any drone; rule insect
  kLost        // [S] deletion: no detection for too long; robust.tracker.max_gap_s
};

// Returns the name that --trace writes, such as "below_threshold"; empty for kNone.
inline const char* NameOf(Rejection rejection) {
  constexpr std::array kNames = {"",
                                 "structure",
                                 "body",
                                 "warm_up",
                                 "surge",
                                 "below_threshold",
                                 "pause",
                                 "too_few_detections",
                                 "near_ground",
                                 "on_structure",
                                 "stationary",
                                 "weak_return",
                                 "crowded",
                                 "part_of_another_track",
                                 "shares_returns",
                                 "single_measurement",
                                 "suspended",
                                 "cloud",
                                 "insect",
                                 "lost"};
  static_assert(kNames.size() == static_cast<std::size_t>(Rejection::kLost) + 1);
  return kNames[static_cast<std::size_t>(rejection)];
}

// Decision on a path, and in streams on a plot: that on the path to it that came farthest.
struct PathVerdict {
  double log_likelihood_ratio = 0.0;  // of its flying part, if that was scored; 0 without a path
  double crowding_penalty = 0.0;      // subtracted from its score
  Rejection rejection = Rejection::kNone;
  std::optional<int> track = {};  // that it became, without a rejection, or that has the plot
};

}  // namespace unlidar
