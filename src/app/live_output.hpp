// Output of a live run: rows of the trajectory and events, as the engine emits them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/growing_file.hpp"
#include "app/output_files.hpp"
#include "app/returns_view.hpp"
#include "app/service.hpp"
#include "io/livox_frames.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

enum class LiveState { kWarmingUp, kRunning, kOverloaded };

const char* LiveStateName(LiveState state);

const char* SensorStateName(SensorState state);

// True if all numbers are finite and bounded, as JSON and its readers require.
bool IsWritable(const TrajectoryRow& row);

// A track that was written.
struct LiveTrack {
  std::int64_t id = 0;
  TimeNs begin_ns = 0;  // first and last evidence
  TimeNs end_ns = 0;
  std::uint64_t rows = 0;
  Kind kind;  // as judged so far
  std::optional<MinimumReport> minimum = {};
};

// A track that has begun and not ended, where it was predicted to be at the newest stamp.
struct CurrentTrack {
  std::int64_t id = 0;
  TrackPredicted now;
};

struct OutputCounts {
  std::uint64_t tracks = 0;
  std::uint64_t tracks_left_out = 0;  // surely a bird throughout (--only-drones)
  std::uint64_t rows = 0;             // written, of all tracks
  std::uint64_t left_out_rows = 0;    // held by the file already
  std::uint64_t unwritable_rows = 0;  // with numbers that no output takes
};

// End of the rows that earlier runs left in an output. Rows are in order, except for those of a
// track, which follow at once when it is confirmed. A row earlier than the latest by more than this
// delay shows a clock that was set back: earlier rows were ahead. Rows beyond `max_time_ns` count
// only if there are no others.
class RowTimes {
 public:
  RowTimes(TimeNs max_late_ns, TimeNs max_time_ns)
      : max_late_ns_(max_late_ns), max_time_ns_(max_time_ns) {}

  void Add(TimeNs time_ns) {
    last_ns_ = time_ns;
    Take(time_ns, &latest_ns_);
    if (time_ns <= max_time_ns_) Take(time_ns, &latest_within_ns_);
  }

  // The row at the end.
  std::optional<TimeNs> last_ns() const { return last_ns_; }

  // The latest one by the clock of the end.
  std::optional<TimeNs> latest_ns() const {
    return latest_within_ns_ ? latest_within_ns_ : latest_ns_;
  }

 private:
  void Take(TimeNs time_ns, std::optional<TimeNs>* latest_ns) const {
    const bool has_gone_back = *latest_ns && **latest_ns - time_ns > max_late_ns_;
    *latest_ns = has_gone_back ? time_ns : std::max(latest_ns->value_or(time_ns), time_ns);
  }

  TimeNs max_late_ns_;
  TimeNs max_time_ns_;
  std::optional<TimeNs> last_ns_;
  std::optional<TimeNs> latest_ns_;
  std::optional<TimeNs> latest_within_ns_;
};

// The engine numbers tracks from 0 in each run; numbers in a file continue across runs. After a
// restart that reads frames again, rows up to the last one of the file are already there and are
// skipped, and so is a track without any other rows.
class LiveOutput {
 public:
  // `events`: a path, `-` for stdout, or empty for none. `rows`: to be extended by the rows of
  // earlier runs. Throws OutputError.
  LiveOutput(const std::string& trajectory, const std::string& events, const RowTimes& rows,
             Signals& signals, const NoteCallback& note);

  // Times of the rows of earlier runs and of those in a reopened file.
  const RowTimes& row_times() const { return row_times_; }

  // A recording that is piped into the file of a later one would mix two flights: the first row of
  // this run must be later than the last one of the file.
  void RefuseEarlierRows() { first_after_ns_ = row_times_.last_ns(); }

  // Rows after a time (none: from the beginning) and up to another are left out from now on.
  void SkipRows(std::optional<TimeNs> after_ns, TimeNs until_ns) {
    left_out_after_ns_ = after_ns;
    left_out_until_ns_ = until_ns;
  }

  // Holds the rows of a track back while it is a bird with a higher probability than this; held
  // rows more than `hold_ns` older than the newest are dropped.
  void LeaveOutBirds(double max_bird_probability, TimeNs hold_ns) {
    max_bird_probability_ = max_bird_probability;
    hold_ns_ = hold_ns;
  }

  // Events of returns go to a file of their own. Throws OutputError.
  void WriteReturnsTo(const std::string& path, const NoteCallback& note) {
    returns_.emplace(path, note);
  }

  // Written to both files by the next Flush(), a track with its first row. `at_ns`: newest
  // accepted stamp.
  void Confirm(const TrackConfirmed& track);
  // Throws OutputError for a row that is refused.
  void AddRow(TimeNs at_ns, const RowGiven& given);
  // Written to the events alone; the last one of each track is kept.
  void AddPrediction(TimeNs at_ns, const TrackPredicted& predicted);
  void End(TimeNs at_ns, const TrackEnded& track);
  // `clock`: of a sensor that tells of its synchronisation.
  void ReportSensor(TimeNs at_ns, const std::string& name, SensorState state,
                    std::optional<SyncState> clock);
  void ReportReturns(TimeNs at_ns, const std::string& name, TimeNs stamp_ns,
                     const ReturnsText& returns);
  void ReportState(TimeNs at_ns, LiveState state, std::uint64_t frames, std::uint64_t dropped);

  // Writes rows before the events that refer to them. Throws OutputError.
  void Flush();
  void Reopen();
  void Close();

  // Descriptors to wait on: one is ready when its reader has left. -1: none.
  std::vector<int> reader_fds() const {
    return {trajectory_.reader_fd(), events_ ? events_->reader_fd() : -1};
  }

  // Tracks of this run, in order of their numbers.
  const std::vector<LiveTrack>& tracks() const { return tracks_; }

  std::vector<CurrentTrack> CurrentTracks() const;

  const OutputCounts& counts() const { return counts_; }

 private:
  struct Confirmed {
    TimeNs first_evidence_ns = 0;
    std::optional<std::size_t> track;   // index into tracks_, once it is announced
    std::deque<TrajectoryRow> held;     // rows, while it is surely a bird
    std::optional<TrackPredicted> now;  // last prediction since its first row
  };

  void ReadRow(std::string_view line, std::uint64_t number);
  LiveTrack& AnnouncedTrack(TimeNs at_ns, const Kind& kind, Confirmed& confirmed);
  void Write(TimeNs at_ns, const RowGiven& given, LiveTrack& track);
  void AppendEvent(const char* name, TimeNs at_ns, const std::string& fields);

  std::string path_;
  std::int64_t next_id_ = 0;
  RowTimes row_times_;
  std::optional<TimeNs> left_out_after_ns_;
  std::optional<TimeNs> left_out_until_ns_;
  std::optional<TimeNs> first_after_ns_;  // until the first row, or the file was moved away
  double max_bird_probability_ = 1.0;
  TimeNs hold_ns_ = 0;
  OutputCounts counts_;
  std::map<int, Confirmed> open_tracks_;  // by the engine's number
  std::vector<LiveTrack> tracks_;
  GrowingFile trajectory_;
  std::optional<GrowingFile> events_;
  std::optional<NewestLines> returns_;
};

}  // namespace unlidar
