#include "app/live_output.hpp"

#include <array>
#include <utility>

#include "app/output.hpp"
#include "base/format.hpp"
#include "io/frame_directory.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr int kKindDigits = 4;
constexpr std::size_t kRowValues = 12;
constexpr std::int64_t kMaxTrackId = std::int64_t{1} << 53;  // exact as a JSON number

std::string StateFields(std::int64_t track, const TrajectoryRow& row) {
  std::string fields =
      ",\"track\":" + std::to_string(track) + ",\"timestamp\":" + SecondsText(row.time_ns);
  VisitState(row, [&](const std::string& name, double value) {
    fields += ",\"" + name + "\":" + FixedText(value, kMetreDigits);
  });
  return fields;
}

std::string EventLine(const char* name, TimeNs at_ns, const std::string& fields) {
  return std::string("{\"event\":\"") + name + "\",\"at\":" + SecondsText(at_ns) + fields + "}\n";
}

void AppendKind(const Kind& kind, std::string& fields) {
  fields += ",\"drone\":" + FixedText(kind.drone, kKindDigits) +
            ",\"bird_like\":" + FixedText(kind.bird_like, kKindDigits) +
            ",\"unknown\":" + FixedText(kind.unknown, kKindDigits);
}

}  // namespace

bool IsWritable(const TrajectoryRow& row) {
  constexpr double kMaxMagnitude = 1e9;
  const auto is_bounded = [](const Eigen::Vector3d& vector) {
    return vector.allFinite() && vector.cwiseAbs().maxCoeff() <= kMaxMagnitude;
  };
  return is_bounded(row.position_m) && is_bounded(row.velocity_mps) && is_bounded(row.sigma_m);
}

const char* LiveStateName(LiveState state) {
  constexpr std::array<const char*, 3> kNames = {"warming_up", "running", "overloaded"};
  return kNames[static_cast<std::size_t>(state)];
}

const char* SensorStateName(SensorState state) {
  constexpr std::array<const char*, 3> kNames = {"ok", "silent", "blinded"};
  return kNames[static_cast<std::size_t>(state)];
}

LiveOutput::LiveOutput(const std::string& trajectory, const std::string& events,
                       const RowTimes& rows, Signals& signals, const NoteCallback& note)
    : path_(trajectory),
      row_times_(rows),
      trajectory_(trajectory, {kTrajectoryHeader, kTrajectoryHeader}, signals, note,
                  [this](std::string_view line, std::uint64_t number) { ReadRow(line, number); }) {
  if (events.empty()) return;
  events_.emplace(events, GrowingFile::Format{"", "{\"event\":"}, signals, note);
}

// A track is reported with its first row: after a kill, readers of the rows must know all numbers.
void LiveOutput::Confirm(const TrackConfirmed& track) {
  open_tracks_[track.track_id].first_evidence_ns = track.first_evidence_ns;
}

void LiveOutput::AddRow(TimeNs at_ns, const RowGiven& given) {
  const TrajectoryRow& row = given.row;
  if (!IsWritable(row)) {
    ++counts_.unwritable_rows;
    return;
  }
  if (left_out_until_ns_ && row.time_ns <= *left_out_until_ns_ &&
      (!left_out_after_ns_ || row.time_ns > *left_out_after_ns_)) {
    ++counts_.left_out_rows;
    return;
  }
  Confirmed& confirmed = open_tracks_[row.track_id];
  std::deque<TrajectoryRow>& held = confirmed.held;
  if (given.kind.bird_like > max_bird_probability_) {
    held.push_back(row);
    while (row.time_ns - held.front().time_ns > hold_ns_) held.pop_front();
    return;
  }
  const TimeNs first_ns = held.empty() ? row.time_ns : held.front().time_ns;
  if (first_after_ns_ && first_ns <= *first_after_ns_) {
    throw OutputError(path_ + ": holds rows until " + SecondsText(*first_after_ns_) +
                      ", and those of stdin begin before, at " + SecondsText(first_ns) +
                      ": expected later ones, or another file");
  }
  first_after_ns_.reset();
  LiveTrack& track = AnnouncedTrack(at_ns, given.kind, confirmed);
  // Held rows count as late.
  for (const TrajectoryRow& late : std::exchange(held, {})) {
    Write(at_ns, {late, true, given.kind}, track);
  }
  Write(at_ns, given, track);
}

void LiveOutput::AddPrediction(TimeNs at_ns, const TrackPredicted& predicted) {
  const TrajectoryRow& row = predicted.row;
  const auto confirmed = open_tracks_.find(row.track_id);
  if (confirmed == open_tracks_.end() || !confirmed->second.track) return;
  if (predicted.kind.bird_like > max_bird_probability_ || !IsWritable(row)) return;
  confirmed->second.now = predicted;
  if (!events_) return;
  std::string fields = StateFields(tracks_[*confirmed->second.track].id, row);
  fields += ",\"unseen_s\":" + FixedText(predicted.unseen_s, kMetreDigits);
  AppendEvent("now", at_ns, fields);
}

void LiveOutput::Write(TimeNs at_ns, const RowGiven& given, LiveTrack& track) {
  const TrajectoryRow& row = given.row;
  ++track.rows;
  ++counts_.rows;
  track.kind = given.kind;
  std::string text;
  AppendTrajectoryRow(row, track.id, text);
  trajectory_.Append(text);

  std::string fields = StateFields(track.id, row);
  fields += ",\"support\":" + std::to_string(row.support);
  fields += given.is_late ? ",\"late\":true" : ",\"late\":false";
  AppendKind(given.kind, fields);
  AppendEvent("row", at_ns, fields);
}

void LiveOutput::End(TimeNs at_ns, const TrackEnded& track) {
  const Confirmed confirmed = std::exchange(open_tracks_[track.track_id], {});
  open_tracks_.erase(track.track_id);
  if (!confirmed.track) {
    if (!confirmed.held.empty()) ++counts_.tracks_left_out;
    return;
  }
  LiveTrack& ended = tracks_[*confirmed.track];
  ended.end_ns = track.last_evidence_ns;
  ended.kind = track.kind;
  ended.minimum = track.minimum;
  std::string fields = ",\"track\":" + std::to_string(ended.id) +
                       ",\"timestamp\":" + SecondsText(track.last_evidence_ns);
  AppendKind(track.kind, fields);
  AppendEvent("end", at_ns, fields);
}

std::vector<CurrentTrack> LiveOutput::CurrentTracks() const {
  std::vector<CurrentTrack> current;
  for (const auto& [number, open] : open_tracks_) {
    if (open.track && open.now) current.push_back({tracks_[*open.track].id, *open.now});
  }
  return current;
}

void LiveOutput::ReportSensor(TimeNs at_ns, const std::string& name, SensorState state,
                              std::optional<SyncState> clock) {
  std::string fields =
      ",\"name\":" + JsonString(name) + ",\"state\":\"" + SensorStateName(state) + "\"";
  if (clock) fields += std::string(",\"clock\":\"") + SyncStateName(*clock) + "\"";
  AppendEvent("sensor", at_ns, fields);
}

void LiveOutput::ReportReturns(TimeNs at_ns, const std::string& name, TimeNs stamp_ns,
                               const ReturnsText& returns) {
  constexpr const char* kName = "returns";
  const std::string fields =
      ",\"name\":" + JsonString(name) + ",\"timestamp\":" + SecondsText(stamp_ns) +
      ",\"step_m\":" + ShortestText(returns.step_m) + ",\"xyz\":\"" + returns.xyz + "\"";
  if (returns_) return returns_->Append(EventLine(kName, at_ns, fields));
  AppendEvent(kName, at_ns, fields);
}

void LiveOutput::ReportState(TimeNs at_ns, LiveState state, std::uint64_t frames,
                             std::uint64_t dropped) {
  AppendEvent("state", at_ns,
              std::string(",\"state\":\"") + LiveStateName(state) + "\",\"frames\":" +
                  std::to_string(frames) + ",\"dropped\":" + std::to_string(dropped));
}

void LiveOutput::Flush() {
  trajectory_.Flush();
  if (events_) events_->Flush();
}

void LiveOutput::Reopen() {
  if (trajectory_.Reopen()) first_after_ns_.reset();
  if (events_) events_->Reopen();
}

void LiveOutput::Close() {
  Flush();
  trajectory_.Close();
  if (events_) events_->Close();
}

void LiveOutput::ReadRow(std::string_view line, std::uint64_t number) {
  std::vector<std::string_view> values = Split(line, ',');
  const bool is_whole = values.size() == kRowValues;
  values.resize(kRowValues);
  const std::optional<TimeNs> time_ns = StampInRange(values[0]);
  const auto id = ParseNumber<std::int64_t>(values[1]);
  if (!is_whole || !time_ns || !id || *id < 0 || *id > kMaxTrackId) {
    constexpr std::size_t kMaxShown = 60;
    throw OutputError(path_ + ":" + std::to_string(number) + ": '" +
                      std::string(line.substr(0, kMaxShown)) +
                      "' is no row of a trajectory, expected one to append to");
  }
  next_id_ = std::max(next_id_, *id + 1);
  row_times_.Add(*time_ns);
}

// Returns the written track; the first call reports its confirmation.
LiveTrack& LiveOutput::AnnouncedTrack(TimeNs at_ns, const Kind& kind, Confirmed& confirmed) {
  if (!confirmed.track) {
    confirmed.track = tracks_.size();
    ++counts_.tracks;
    tracks_.push_back(
        {next_id_++, confirmed.first_evidence_ns, confirmed.first_evidence_ns, 0, kind});
    std::string fields = ",\"track\":" + std::to_string(tracks_.back().id) +
                         ",\"first_evidence\":" + SecondsText(confirmed.first_evidence_ns);
    AppendKind(kind, fields);
    AppendEvent("track", at_ns, fields);
  }
  return tracks_[*confirmed.track];
}

void LiveOutput::AppendEvent(const char* name, TimeNs at_ns, const std::string& fields) {
  if (events_) events_->Append(EventLine(name, at_ns, fields));
}

}  // namespace unlidar
