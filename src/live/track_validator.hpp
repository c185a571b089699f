// Validation of followed tracks: clouds, insects and suspended objects are not drones.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "collection/cloud.hpp"
#include "live/live_plot.hpp"
#include "live/track_follower.hpp"
#include "tracking/rejection.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Judges tracks of a stream, as ShapeRejections and MayBeSuspended judge targets of a recording.
// Reported rows cannot be retracted, so a track waits until it is accepted as a drone.
class TrackValidator {
 public:
  // `window_s`: how long the shape of a cloud is compared with those of other tracks. `config` must
  // outlive it.
  TrackValidator(const RobustConfig& config, double window_s)
      : config_(config), window_s_(window_s), shape_(config) {}

  struct Verdict {
    Rejection rejection = Rejection::kNone;  // kNone: a drone; otherwise it waits
    bool is_final = false;                   // it is a cloud or an insect, and not only may be one
    double next_judgement_s = 0.0;           // time of the next judgement
    double first_judged_age_s = 0.0;         // observed time at the first judgement
  };

  // Judges a track by its fit. `number`: unique to the track; `is_reported`: it has rows; `seen`:
  // recent plots, in order of frames; `before`: its last verdict, if any.
  Verdict Judge(int number, const TrackFollower& follower, bool is_reported,
                const RecentPlots& seen, double time_s, const std::optional<Verdict>& before);

 private:
  struct Cloud {
    int number;
    double time_s;
    Shape shape;
  };

  void SetShape(const TrackFollower& follower, const RecentPlots& seen);
  bool IsCloud(int number, double time_s);
  Rejection ShapeRejection(int number, double time_s);

  const RobustConfig& config_;
  double window_s_;
  std::deque<Cloud> clouds_;  // in order of time
  // Buffers, reused from track to track.
  Shape shape_;
  std::vector<ReturnCluster> clusters_;
  std::vector<const Shape*> recent_clouds_;
};

}  // namespace unlidar
