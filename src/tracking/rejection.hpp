// Why a path of detections is no track: every rule that can refuse one, by name.
#pragma once

namespace unlidar {

// In the order in which they are asked. docs/explain.md has the source of each.
enum class Rejection {
  kNone,
  kBelowThreshold,    // the track score does not outweigh the false alarms allowed
  kTooFewDetections,  // in fewer frames than robust.min_plots: clutter that repeats is no evidence
  kNearGround,  // no higher than people and cars for robust.off_ground_share of its detections
  kWeakReturn,  // its cross-section proxy, returns per second times range^2, is an insect's
  kCrowded,     // the score, less what else is detected about it then, is below the threshold
  kPartOfAnotherTrack,  // most of its returns are a track's that it continues
  kSharesReturns,       // most of its returns are those of several tracks or of bodies
  kSingleMeasurement,   // collection leaves it one measurement at most
  kSuspended,           // far away and at rest to within the noise: a sign, a cable
  kClutterReturns,      // the returns collected are explained better by their places' clutter
  kCloud,  // wider across its motion than any drone, or a piece of what is: steam, dust
  kInsect  // narrower than any drone
};

// "below_threshold" and so on, as --trace writes it; empty for kNone.
const char* NameOf(Rejection rejection);

}  // namespace unlidar
