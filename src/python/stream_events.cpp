#include "python/stream_events.hpp"

#include <utility>
#include <variant>

#include "app/live_output.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

void SetKind(const Kind& kind, py::dict& fields) {
  fields["drone"] = kind.drone;
  fields["bird_like"] = kind.bird_like;
  fields["unknown"] = kind.unknown;
}

void SetVector(const char* prefix, const Eigen::Vector3d& vector, py::dict& fields) {
  constexpr const char* kAxes[] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    fields[py::str(std::string(prefix) + kAxes[axis])] = vector[axis];
  }
}

void SetState(const TrajectoryRow& row, py::dict& fields) {
  fields["track"] = row.track_id;
  fields["timestamp"] = row.time_ns;
  SetVector("", row.position_m, fields);
  SetVector("v", row.velocity_mps, fields);
  SetVector("sigma_", row.sigma_m, fields);
}

LiveState StateOf(EngineState state) {
  return state == EngineState::kRunning ? LiveState::kRunning : LiveState::kWarmingUp;
}

}  // namespace

Stream::Stream(const std::string& config, const std::vector<std::string>& assignments,
               std::int64_t nanohertz, const py::dict& poses)
    : sensors_(config, assignments, nanohertz, poses, false,
               [this](const EngineEvent& event) { Take(event); }) {}

py::list Stream::Add(const std::string& sensor, TimeNs stamp_ns, const py::object& xyz,
                     const py::object& offsets_ns) {
  sensors_.Add(sensor, stamp_ns, xyz, offsets_ns);
  return TakeAll();
}

py::list Stream::Advance(TimeNs now_ns) {
  {
    const py::gil_scoped_release unlocked;
    sensors_.engine().Advance(now_ns);
  }
  return TakeAll();
}

py::list Stream::Close() {
  {
    const py::gil_scoped_release unlocked;
    sensors_.engine().Close();
    if (state_) Push(*state_);
  }
  return TakeAll();
}

void Stream::Take(const EngineEvent& event) {
  if (const auto* confirmed = std::get_if<TrackConfirmed>(&event)) {
    open_tracks_[confirmed->track_id] = {confirmed->first_evidence_ns, std::nullopt};
  } else if (const auto* given = std::get_if<RowGiven>(&event)) {
    if (!IsWritable(given->row)) return;
    OpenTrack& track = open_tracks_[given->row.track_id];
    if (!track.number) {
      track.number = next_number_++;
      Push(TrackConfirmed{*track.number, track.first_evidence_ns, given->kind});
    }
    RowGiven numbered = *given;
    numbered.row.track_id = *track.number;
    Push(numbered);
  } else if (const auto* predicted = std::get_if<TrackPredicted>(&event)) {
    const auto track = open_tracks_.find(predicted->row.track_id);
    if (track == open_tracks_.end() || !track->second.number || !IsWritable(predicted->row)) return;
    TrackPredicted numbered = *predicted;
    numbered.row.track_id = *track->second.number;
    Push(numbered);
  } else if (const auto* ended = std::get_if<TrackEnded>(&event)) {
    const OpenTrack track = std::exchange(open_tracks_[ended->track_id], {});
    open_tracks_.erase(ended->track_id);
    if (!track.number) return;
    Push(TrackEnded{*track.number, ended->last_evidence_ns, ended->kind});
  } else if (const auto* changed = std::get_if<SensorChanged>(&event)) {
    const auto [known, is_new] = sensor_states_.emplace(changed->sensor, changed->state);
    if (is_new || std::exchange(known->second, changed->state) != changed->state) {
      Push(*changed);
    }
  } else {
    state_ = std::get<EngineState>(event);
    Push(*state_);
  }
}

void Stream::Push(EngineEvent event) {
  const Engine& engine = sensors_.engine();
  events_.push_back(
      {engine.newest_ns(), std::move(event), engine.counts().frames, sensors_.num_dropped()});
}

py::list Stream::TakeAll() {
  py::list all;
  for (const TimedEvent& timed : std::exchange(events_, {})) {
    py::dict fields;
    const auto begin = [&](const char* name) {
      fields["event"] = name;
      fields["at"] = timed.at_ns;
    };
    if (const auto* confirmed = std::get_if<TrackConfirmed>(&timed.event)) {
      begin("track");
      fields["track"] = confirmed->track_id;
      fields["first_evidence"] = confirmed->first_evidence_ns;
      SetKind(confirmed->kind, fields);
    } else if (const auto* given = std::get_if<RowGiven>(&timed.event)) {
      begin("row");
      SetState(given->row, fields);
      fields["support"] = static_cast<double>(given->row.support);
      fields["late"] = given->is_late;
      SetKind(given->kind, fields);
    } else if (const auto* predicted = std::get_if<TrackPredicted>(&timed.event)) {
      begin("now");
      SetState(predicted->row, fields);
      fields["unseen_s"] = predicted->unseen_s;
    } else if (const auto* ended = std::get_if<TrackEnded>(&timed.event)) {
      begin("end");
      fields["track"] = ended->track_id;
      fields["timestamp"] = ended->last_evidence_ns;
      SetKind(ended->kind, fields);
    } else if (const auto* changed = std::get_if<SensorChanged>(&timed.event)) {
      begin("sensor");
      fields["name"] = sensors_.NameOf(changed->sensor);
      fields["state"] = SensorStateName(changed->state);
    } else {
      begin("state");
      fields["state"] = LiveStateName(StateOf(std::get<EngineState>(timed.event)));
      fields["frames"] = timed.frames;
      fields["dropped"] = timed.dropped;
    }
    all.append(fields);
  }
  return all;
}

}  // namespace unlidar
