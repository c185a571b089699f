// Reasons for which a path is rejected: one per gate.
#pragma once

namespace unlidar {

// In the order in which the gates apply. docs/explain.md has the source of each.
enum class Rejection {
  kNone,
  kBelowThreshold,      // track score below the threshold of the allowed false alarms
  kTooFewDetections,    // fewer frames than robust.min_plots: repeated clutter is no evidence
  kNearGround,          // at most robust.off_ground_share of plots above people and cars
  kWeakReturn,          // return rate, returns per second times range^2, of an insect
  kCrowded,             // below the threshold after the crowding penalty
  kPartOfAnotherTrack,  // most returns belong to a track that it continues
  kSharesReturns,       // most returns belong to several tracks or to bodies
  kSingleMeasurement,   // at most one measurement after collection
  kSuspended,           // far away and static to within the noise: a sign, a cable
  kClutterReturns,      // collected returns are explained better by the clutter of their places
  kCloud,               // wider across its motion than any drone, or part of a cloud: steam, dust
  kInsect               // narrower than any drone
};

// Returns the name that --trace writes, such as "below_threshold"; empty for kNone.
const char* NameOf(Rejection rejection);

}  // namespace unlidar
