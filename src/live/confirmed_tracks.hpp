// The confirmed tracks of a stream: assignment of plots, events and rows.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "live/live_instants.hpp"
#include "live/live_plot.hpp"
#include "live/live_trace.hpp"
#include "live/track_follower.hpp"
#include "live/track_validator.hpp"
#include "tracking/rejection.hpp"
#include "tracking/track_model.hpp"
#include "trajectory/kind.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Events of a track: confirmation, before its first row; its rows; its end.
class ConfirmedTracks {
 public:
  // `config`, `models` (one per agility, see TrackFollower) and `trace` must outlive it.
  ConfirmedTracks(const Config& config, const std::vector<TrackModel>& models,
                  OutputTimes output_times, EngineCallback on_event, LiveTrace& trace);

  // The shortest of the sensors' frame periods.
  void SetPeriod(TimeNs period_ns) { period_ns_ = period_ns; }

  // Frames come in order of stamps.
  void AddInstants(const FrameInfo& frame) { instants_.Add(frame); }

  // Extends the tracks by the plots of a frame at `at`. A plot goes to at most one track, the one
  // with the highest gain. Returns (plots) true for free ones, valid until the next call: no track
  // explains them better than clutter, so they may belong to another target. `ground_gains` (plots;
  // empty: all 0): of the plots as those of ground targets. A lost track leaves such to these.
  const std::vector<char>& Extend(const std::vector<LivePlot>& plots, const FrameTime& at,
                                  const std::vector<double>& ground_gains = {});

  // True if a track must be reacquired, so that Extend() needs `ground_gains`.
  bool HasLost(double time_s) const;

  // Returns the number of the track to which Extend() assigned a plot, if any. To be called before
  // tracks begin or end.
  std::optional<int> TrackOf(std::size_t plot) const;

  // Returns the tracks, as predicted at a time. Valid until the next call or until tracks change.
  KnownTargets TargetsAt(double time_s);

  double ScoreOf(const Flight& flight) const {
    return TrackFollower(flight, models_, config_.robust).score();
  }

  // True if a track is near at least half of the plots: a drone may yield two plots in a frame.
  bool HasTrackOf(const Flight& flight) const;

  // Starts a track from a flight and returns its number.
  int Initiate(const Flight& flight);

  // Validates the tracks against recent plots, `seen` in order of frames. A track that may not be a
  // drone is followed without rows; a reported one that proves to be a cloud or an insect ends.
  // `may_wait`: the first verdict on a track that begins with this frame is left to the next.
  void Judge(const RecentPlots& seen, double time_s, bool may_wait = false);

  // Emits the rows that are due when `newest_ns` is the newest stamp and frames were searched until
  // `searched_ns`. Returns the plots that are now settled in a track, valid until the next call.
  const std::vector<LivePlot>& EmitRows(TimeNs searched_ns, TimeNs newest_ns);

  // Emits the prediction of each reported track at the newest stamp. Changes no state.
  void Predict(TimeNs newest_ns);

  // Emits the last rows of the tracks last seen before `lost_ns` and ends them. Returns the same
  // as EmitRows().
  const std::vector<LivePlot>& EndLost(TimeNs lost_ns, TimeNs searched_ns);

  // Emits all remaining rows and ends all tracks.
  void Close(TimeNs newest_ns);

  // Tracks of one engine never share a number.
  void ContinueNumbers(const ConfirmedTracks& earlier) {
    next_id_ = earlier.next_id_;
    next_number_ = earlier.next_number_;
  }

  // Forgets the output times before `oldest_ns` whose rows have been emitted.
  void Forget(TimeNs oldest_ns);

 private:
  // The track with the highest gain from a plot.
  struct Claim {
    double gain = -1e9;
    std::size_t track = ~std::size_t{0};  // none
  };

  struct Track {
    int number = 0;  // in order of initiation
    int id = 0;      // as reported
    std::unique_ptr<TrackFollower> follower;
    Eigen::Vector3d place_m = Eigen::Vector3d::Zero();  // as of TargetsAt()
    std::vector<LivePlot> adapted_plots;  // plots of a frame, with clutter as for this track
    std::optional<TrackValidator::Verdict> verdict;
    KindFilter kind;
    TimeNs emitted_until_ns = std::numeric_limits<TimeNs>::min();  // time of the last row
    bool is_reported = false;
    bool is_new = true;  // begins with the frame searched last
  };

  static void SetAdaptedPlots(const std::vector<LivePlot>& plots, Track* track);
  TimeInterval PresenceOf(const Track& track, TimeNs until_ns) const;
  void ReportEnd(const Track& track);
  void Trace(const Track& track, TrackState state, Rejection rejection) {
    trace_.AddTrack({0, track.number, state, rejection, track.follower->first_evidence_ns(),
                     track.follower->last_evidence_ns()});
  }
  void SetSource(const Track& track, const TimeInterval& presence, double max_sigma_m);
  void EmitRowsOf(Track* track, TimeNs until_ns, TimeNs newest_ns, double extrapolated_share);

  const Config& config_;
  const std::vector<TrackModel>& models_;
  LiveInstants instants_;
  TrajectoryFitter fitter_;
  TrackValidator validator_;
  // Buffers, reused from frame to frame.
  std::vector<Claim> claims_;      // (plots)
  std::vector<double> gains_;      // (plots) for one track
  std::vector<char> are_free_;     // (plots)
  std::vector<char> are_allowed_;  // (plots) for one track
  std::vector<LivePlot> settled_;
  std::vector<LivePlot> unreported_;
  OutputInstants due_;
  RowSource source_;
  EngineCallback on_event_;
  LiveTrace& trace_;
  TimeNs period_ns_ = std::numeric_limits<TimeNs>::max();
  int next_id_ = 0;
  int next_number_ = 0;
  std::vector<Track> tracks_;
};

}  // namespace unlidar
