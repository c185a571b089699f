// The confirmed tracks of a stream: which plots each of them takes, and what is told of them.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "live/live_instants.hpp"
#include "live/live_plot.hpp"
#include "live/track_follower.hpp"
#include "live/track_validator.hpp"
#include "tracking/track_model.hpp"
#include "trajectory/kind.hpp"
#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// Events of a track: that it is confirmed, before its first row; its rows; its end.
class ConfirmedTracks {
 public:
  // `config` and `models`, as of TrackFollower, outlive it.
  ConfirmedTracks(const Config& config, const std::vector<TrackModel>& models,
                  OutputTimes output_times, EngineCallback on_event);

  // The shortest of the sensors' frame periods.
  void SetPeriod(TimeNs period_ns) { period_ns_ = period_ns; }

  // Takes in the output times of a frame, of no earlier stamp than all before.
  void AddInstants(const FrameInfo& frame) { instants_.Add(frame); }

  // Goes on with plots of a frame at `at`. Each is that of one track at most, of the one that it
  // suits best. Returns (plots) which are free, until the next call: no track explains them better
  // than clutter, so they may be another target's.
  const std::vector<char>& Extend(const std::vector<LivePlot>& plots, const FrameTime& at);

  // Whether one of them was at a place at `dwell_begin_s`, and is likely to be there still at
  // `time_s`.
  bool HasTrackAt(const Eigen::Vector3d& place_m, double dwell_begin_s, double time_s) const;

  // Begins a track with a flight, unless one has it already. False if the flight is worth less than
  // `score_threshold` as a track. `with_history`: gives the flight with what it was before.
  bool Initiate(const Flight& flight, double score_threshold,
                const std::function<Flight(const Flight&)>& with_history);

  // Judges the tracks by what the frames of the last while show, `seen` in their order. One that
  // may be no drone is followed without a row; one that has rows and proves to be a cloud ends.
  void Judge(const std::vector<LivePlot>& seen, double time_s);

  // Gives the rows that are due when `newest_ns` is the newest stamp and frames were searched until
  // `searched_ns`. Returns the plots that are the tracks' for good by now, until the next call.
  const std::vector<LivePlot>& EmitRows(TimeNs searched_ns, TimeNs newest_ns);

  // Ends the tracks that were seen last before `lost_ns`, their last rows given. Returns as
  // EmitRows().
  const std::vector<LivePlot>& EndLost(TimeNs lost_ns, TimeNs searched_ns);

  // Ends all of them.
  void Close(TimeNs newest_ns);

  // Tracks of one engine never share a number.
  int next_id() const { return next_id_; }
  void NumberFrom(int id) { next_id_ = id; }

  // Forgets the output times before, if their rows are given.
  void Forget(TimeNs oldest_ns);

 private:
  // Which track a plot suits best, and how well.
  struct Claim {
    double gain = -1e9;
    std::size_t track = 0;
  };

  struct Track {
    int number = 0;  // as it began
    int id = 0;      // as it is told
    std::unique_ptr<TrackFollower> follower;
    std::vector<LivePlot> adapted_plots;  // the plots of a frame, as it sees them
    std::optional<TrackValidator::Verdict> verdict;
    KindFilter kind;
    TimeNs emitted_until_ns = std::numeric_limits<TimeNs>::min();  // up to here
    bool is_reported = false;
  };

  bool HasTrackOf(const Flight& flight) const;
  static void SetAdaptedPlots(const std::vector<LivePlot>& plots, Track* track);
  TimeInterval PresenceOf(const Track& track, TimeNs until_ns) const;
  void ReportEnd(const Track& track);
  void EmitRowsOf(Track* track, TimeNs until_ns, TimeNs newest_ns, double extrapolated_share);

  const Config& config_;
  const std::vector<TrackModel>& models_;
  LiveInstants instants_;
  TrajectoryFitter fitter_;
  TrackValidator validator_;
  // What a frame is worked on with, kept for the next.
  std::vector<Claim> claims_;      // (plots)
  std::vector<double> gains_;      // (plots) of a track
  std::vector<char> are_free_;     // (plots)
  std::vector<char> are_allowed_;  // (plots) a track
  std::vector<LivePlot> settled_;
  std::vector<LivePlot> unreported_;
  OutputInstants due_;
  RowSource source_;
  EngineCallback on_event_;
  TimeNs period_ns_ = std::numeric_limits<TimeNs>::max();
  int next_id_ = 0;
  int next_number_ = 0;
  std::vector<Track> tracks_;
};

}  // namespace unlidar
