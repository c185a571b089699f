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
};

// The engine counts tracks from 0 in each run; those of a file go on counting. Of a run that takes
// up frames again, rows from these up to the last one of the file are there already and are left
// out, and so is a track without any other.
class LiveOutput {
 public:
  using NoteCallback = GrowingFile::NoteCallback;

  // `events`: a path, `-` for stdout, or empty for none. Throws OutputError.
  LiveOutput(const std::string& trajectory, const std::string& events, Signals& signals,
             const NoteCallback& note);

  // The time of the last row that an earlier run wrote.
  std::optional<TimeNs> last_row_ns() const { return last_row_ns_; }

  // Rows after a time (none: from the beginning) and up to another are left out from now on.
  void LeaveOut(std::optional<TimeNs> after_ns, TimeNs until_ns) {
    left_out_after_ns_ = after_ns;
    left_out_until_ns_ = until_ns;
  }

  // A track's rows are held back until its probability of being a drone has once been so high; of
  // what is held, rows older than `hold_ns` before the newest are forgotten.
  void KeepOnlyDrones(double least, TimeNs hold_ns) {
    least_drone_ = least;
    hold_ns_ = hold_ns;
  }

  // Each goes to both files with the next Flush(), a track with its first row; `at_ns` is the
  // newest stamp taken in.
  void Confirm(const TrackConfirmed& track);
  void Give(TimeNs at_ns, const RowGiven& given);
  void End(TimeNs at_ns, const TrackEnded& track);
  void TellSensor(TimeNs at_ns, const std::string& name, SensorState state);
  void TellState(TimeNs at_ns, LiveState state, std::uint64_t frames, std::uint64_t dropped);

  // Rows go before the events that tell of them. Throws OutputError.
  void Flush();
  void Reopen();
  void Close();

  // That a reader of one of them has left ends the wait for them.
  std::vector<int> reader_fds() const;

  // Those of this run, in order of their numbers.
  const std::vector<LiveTrack>& tracks() const { return tracks_; }

  // That have ended without having been as likely a drone as asked for.
  std::uint64_t tracks_left_out() const { return tracks_left_out_; }

 private:
  struct Confirmed {
    TimeNs first_evidence_ns = 0;
    std::optional<std::size_t> track;  // index into tracks_, once it is announced
    std::deque<TrajectoryRow> held;    // rows, until it is
  };

  bool IsLeftOut(TimeNs time_ns) const;
  void ReadRow(std::string_view line, std::uint64_t number);
  LiveTrack& Announced(TimeNs at_ns, const Kind& kind, Confirmed& confirmed);
  void Hold(const TrajectoryRow& row, Confirmed& confirmed) const;
  void Write(TimeNs at_ns, const RowGiven& given, LiveTrack& track);
  void AppendEvent(const char* name, TimeNs at_ns, const std::string& fields);

  std::string path_;
  std::int64_t next_id_ = 0;
  std::optional<TimeNs> last_row_ns_;
  std::optional<TimeNs> left_out_after_ns_;
  std::optional<TimeNs> left_out_until_ns_;
  double least_drone_ = 0.0;
  TimeNs hold_ns_ = 0;
  std::uint64_t tracks_left_out_ = 0;
  std::map<int, Confirmed> alive_;  // by the engine's number
  std::vector<LiveTrack> tracks_;
  GrowingFile trajectory_;
  std::optional<GrowingFile> events_;
};

}  // namespace unlidar
