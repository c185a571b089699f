// What is followed, and is no drone: clouds, and what may hang.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "collection/cloud.hpp"
#include "live/live_plot.hpp"
#include "live/track_follower.hpp"

namespace unlidar {

// Judges tracks of a stream as ShapeRejections and MayBeSuspended judge the targets of a recording:
// a track that was given is never taken back, so it waits until it is known to be a drone.
class TrackValidator {
 public:
  // `window_s`: how long a cloud tells of others.
  explicit TrackValidator(double window_s) : window_s_(window_s) {}

  // What is known of a track.
  struct Verdict {
    bool is_drone = false;            // or it waits
    bool is_rejected = false;         // a cloud or an insect
    double next_judgement_s = 0.0;    // when it is judged again
    double first_judged_age_s = 0.0;  // for how long it was seen when it was judged first
  };

  // Judges what a track was fitted to, its number being its own. `seen`: what the frames of the
  // last while show, in their order; `before`: its last verdict, if it has any; `is_reported`: it
  // has rows.
  Verdict Judge(int number, const TrackFollower& follower, bool is_reported,
                const std::vector<LivePlot>& seen, double time_s,
                const std::optional<Verdict>& before);

 private:
  struct Cloud {
    int number;
    double time_s;
    Shape shape;
  };

  void Forget(int number);
  bool IsCloud(int number, const TrackFollower& follower, const std::vector<LivePlot>& seen,
               double time_s);

  double window_s_;
  std::deque<Cloud> clouds_;  // in order of time
  // What a track is worked on with, kept for the next.
  Shape shape_;
  std::vector<ReturnCluster> clusters_;
  std::vector<const Shape*> recent_clouds_;
};

}  // namespace unlidar
