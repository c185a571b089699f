// What a live run writes: rows of the trajectory and events, as the engine gives them.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/growing_file.hpp"
#include "app/row_times.hpp"
#include "app/signals.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

enum class LiveState { kWarmingUp, kRunning, kOverloaded };

// As in events.
const char* LiveStateName(LiveState state);

const char* SensorStateName(SensorState state);

// A track that was written.
struct LiveTrack {
  std::int64_t id = 0;
  TimeNs begin_ns = 0;  // first and last evidence
  TimeNs end_ns = 0;
  std::uint64_t rows = 0;
  Kind kind;  // by all that was seen of it
  std::optional<MinimumReport> minimum = {};
};

// Behind the number of rows that are refused.
inline constexpr const char* kUnwritableText =
    " left out: a number in it is none, or beyond 1e9, which no output takes";

// The engine counts tracks from 0 in each run; those of a file go on counting. Of a run that takes
// up frames again, rows from these up to the last one of the file are there already and are left
// out, and so is a track without any other.
class LiveOutput {
 public:
  using NoteCallback = GrowingFile::NoteCallback;

  // `events`: a path, `-` for stdout, or empty for none. `rows`: takes those that earlier runs
  // wrote. Throws OutputError.
  LiveOutput(const std::string& trajectory, const std::string& events, const RowTimes& rows,
             Signals& signals, const NoteCallback& note);

  // Of the rows that earlier runs wrote, and of those that a file held that was opened again.
  const RowTimes& row_times() const { return row_times_; }

  // A recording that is piped into the file of a later one would mix two flights: the first row of
  // this run must be later than the last one of the file.
  void RefuseEarlierRows() { first_after_ns_ = row_times_.last_ns(); }

  // Rows after a time (none: from the beginning) and up to another are left out from now on.
  void SkipRows(std::optional<TimeNs> after_ns, TimeNs until_ns) {
    left_out_after_ns_ = after_ns;
    left_out_until_ns_ = until_ns;
  }

  // A track's rows are held back until its probability of being a drone has once been so high; of
  // what is held, rows older than `hold_ns` before the newest are forgotten.
  void KeepOnlyDrones(double min_probability, TimeNs hold_ns) {
    min_drone_probability_ = min_probability;
    hold_ns_ = hold_ns;
  }

  // Each goes to both files with the next Flush(), a track with its first row; `at_ns` is the
  // newest stamp taken in.
  void Confirm(const TrackConfirmed& track);
  // Throws OutputError for a row that is refused.
  void AddRow(TimeNs at_ns, const RowGiven& given);
  void End(TimeNs at_ns, const TrackEnded& track);
  void ReportSensor(TimeNs at_ns, const std::string& name, SensorState state);
  void ReportState(TimeNs at_ns, LiveState state, std::uint64_t frames, std::uint64_t dropped);

  // Rows go before the events that tell of them. Throws OutputError.
  void Flush();
  void Reopen();
  void Close();

  // That a reader of one of them has left ends the wait for them.
  std::vector<int> reader_fds() const;

  // Those of this run, in order of their numbers.
  const std::vector<LiveTrack>& tracks() const { return tracks_; }

  // Rows that are in the file already, and those whose numbers cannot be written.
  std::uint64_t left_out_rows() const { return left_out_rows_; }
  std::uint64_t unwritable_rows() const { return unwritable_rows_; }

  // That have ended without having been as likely a drone as asked for.
  std::uint64_t tracks_left_out() const { return tracks_left_out_; }

 private:
  struct Confirmed {
    TimeNs first_evidence_ns = 0;
    std::optional<std::size_t> track;  // index into tracks_, once it is announced
    std::deque<TrajectoryRow> held;    // rows, until it is
  };

  bool IsSkipped(TimeNs time_ns) const;
  void CheckIsLater(TimeNs time_ns);
  void ReadRow(std::string_view line, std::uint64_t number);
  LiveTrack& AnnouncedTrack(TimeNs at_ns, const Kind& kind, Confirmed& confirmed);
  void Hold(const TrajectoryRow& row, Confirmed& confirmed) const;
  void Write(TimeNs at_ns, const RowGiven& given, LiveTrack& track);
  void AppendEvent(const char* name, TimeNs at_ns, const std::string& fields);

  std::string path_;
  std::int64_t next_id_ = 0;
  RowTimes row_times_;
  std::optional<TimeNs> left_out_after_ns_;
  std::optional<TimeNs> left_out_until_ns_;
  std::optional<TimeNs> first_after_ns_;  // until the first row, or the file was moved away
  double min_drone_probability_ = 0.0;
  TimeNs hold_ns_ = 0;
  std::uint64_t tracks_left_out_ = 0;
  std::uint64_t left_out_rows_ = 0;
  std::uint64_t unwritable_rows_ = 0;
  std::map<int, Confirmed> open_tracks_;  // by the engine's number
  std::vector<LiveTrack> tracks_;
  GrowingFile trajectory_;
  std::optional<GrowingFile> events_;
};

}  // namespace unlidar
