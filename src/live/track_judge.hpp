// What is followed, and is no drone: clouds, and what may hang.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "collection/cloud.hpp"
#include "live/seen_plot.hpp"
#include "live/track_follower.hpp"

namespace unlidar {

// Judges tracks of a stream as ShapeRejections and MayHang judge the targets of a recording:
// a track that was given is never taken back, so it waits until it is known to be a drone.
class TrackJudge {
 public:
  // `window_s`: how long a cloud tells of others.
  explicit TrackJudge(double window_s) : window_s_(window_s) {}

  // What is known of a track.
  struct Verdict {
    bool is_drone = false;  // or it waits
    bool is_other = false;  // a cloud or an insect
    double until_s = 0.0;   // when it is judged again
    double first_s = 0.0;   // for how long it was seen when it was judged first
  };

  // Judges what a track was fitted to, its number being its own. `seen`: what the frames of the
  // last while show, in their order; `before`: its last verdict, if it has any; `is_told`: it has
  // rows.
  Verdict Judge(int number, const TrackFollower& follower, bool is_told,
                const std::vector<SeenPlot>& seen, double time_s,
                const std::optional<Verdict>& before);

 private:
  struct Cloud {
    int number;
    double time_s;
    Shape shape;
  };

  void Forget(int number);
  bool IsCloud(int number, const TrackFollower& follower, const std::vector<SeenPlot>& seen,
               double time_s);

  double window_s_;
  std::deque<Cloud> clouds_;  // in order of time
  // What a track is worked on with, kept for the next.
  Shape shape_;
  std::vector<Lump> lumps_;
  std::vector<const Shape*> others_;
};

}  // namespace unlidar
