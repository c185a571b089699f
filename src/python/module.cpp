// The module unlidar._engine: engines for tools/unlidar/engine.py, which checks names and types,
// serialises calls and makes the objects that users see.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "api/recording_events.hpp"
#include "app/live_output.hpp"
#include "app/output.hpp"
#include "python/named_sensors.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

using Assignments = std::vector<std::string>;

void SetKind(const Kind& kind, py::dict& fields) {
  fields["drone"] = kind.drone;
  fields["bird_like"] = kind.bird_like;
  fields["unknown"] = kind.unknown;
}

void SetState(int track, const TrajectoryRow& row, py::dict& fields) {
  fields["track"] = track;
  fields["timestamp"] = row.time_ns;
  VisitState(row, [&](const std::string& name, double value) { fields[py::str(name)] = value; });
}

// Events frame by frame, a dictionary each with the keys of --events. Numbers and delays them like
// the output of --stdin: a track is reported with its first row and numbered then, a sensor only
// when its state has changed.
class Stream {
 public:
  Stream(const std::string& config, const Assignments& assignments, std::int64_t nanohertz,
         const py::dict& poses)
      : sensors_(config, assignments, nanohertz, poses, false,
                 [this](const EngineEvent& event) { Keep(event); }) {}

  // Each returns the events since the last call.
  py::list Add(const std::string& sensor, TimeNs stamp_ns, const py::object& xyz,
               const py::object& offsets_ns) {
    sensors_.Add(sensor, stamp_ns, xyz, offsets_ns);
    return TakeAll();
  }

  py::list Advance(TimeNs now_ns) {
    {
      const py::gil_scoped_release unlocked;
      sensors_.engine().Advance(now_ns);
    }
    return TakeAll();
  }

  // Reports the state once more.
  py::list Close() {
    {
      const py::gil_scoped_release unlocked;
      sensors_.engine().Close();
      if (state_) Keep(*state_);
    }
    return TakeAll();
  }

  std::vector<std::string> TakeNotes() { return sensors_.TakeNotes(); }

 private:
  struct TimedEvent {
    TimeNs at_ns;
    EngineEvent event;
    std::uint64_t frames;
    std::uint64_t dropped;
  };
  struct OpenTrack {
    TimeNs first_evidence_ns = 0;
    std::optional<int> number;
  };

  // The interpreter lock is free.
  void Keep(const EngineEvent& event) {
    if (const auto* state = std::get_if<EngineState>(&event)) state_ = *state;
    const Engine& engine = sensors_.engine();
    events_.push_back({engine.newest_ns(), event, engine.counts().frames, sensors_.num_dropped()});
  }

  py::list TakeAll() {
    py::list all;
    for (const TimedEvent& timed : std::exchange(events_, {})) Append(timed, all);
    return all;
  }

  void Append(const TimedEvent& timed, py::list& all) {
    const auto append = [&](const char* name) {
      py::dict fields;
      fields["event"] = name;
      fields["at"] = timed.at_ns;
      all.append(fields);
      return fields;
    };
    if (const auto* confirmed = std::get_if<TrackConfirmed>(&timed.event)) {
      open_tracks_[confirmed->track_id] = {confirmed->first_evidence_ns, std::nullopt};
    } else if (const auto* given = std::get_if<RowGiven>(&timed.event)) {
      if (!IsWritable(given->row)) return;
      OpenTrack& track = open_tracks_[given->row.track_id];
      if (!track.number) {
        track.number = next_number_++;
        py::dict fields = append("track");
        fields["track"] = *track.number;
        fields["first_evidence"] = track.first_evidence_ns;
        SetKind(given->kind, fields);
      }
      py::dict fields = append("row");
      SetState(*track.number, given->row, fields);
      fields["support"] = static_cast<double>(given->row.support);
      fields["late"] = given->is_late;
      SetKind(given->kind, fields);
    } else if (const auto* predicted = std::get_if<TrackPredicted>(&timed.event)) {
      const auto track = open_tracks_.find(predicted->row.track_id);
      if (track == open_tracks_.end() || !track->second.number) return;
      if (!IsWritable(predicted->row)) return;
      py::dict fields = append("now");
      SetState(*track->second.number, predicted->row, fields);
      fields["unseen_s"] = predicted->unseen_s;
    } else if (const auto* ended = std::get_if<TrackEnded>(&timed.event)) {
      const OpenTrack track = std::exchange(open_tracks_[ended->track_id], {});
      open_tracks_.erase(ended->track_id);
      if (!track.number) return;
      py::dict fields = append("end");
      fields["track"] = *track.number;
      fields["timestamp"] = ended->last_evidence_ns;
      SetKind(ended->kind, fields);
    } else if (const auto* changed = std::get_if<SensorChanged>(&timed.event)) {
      const auto [known, is_new] = sensor_states_.emplace(changed->sensor, changed->state);
      if (!is_new && std::exchange(known->second, changed->state) == changed->state) return;
      py::dict fields = append("sensor");
      fields["name"] = sensors_.NameOf(changed->sensor);
      fields["state"] = SensorStateName(changed->state);
    } else {
      const bool is_running = std::get<EngineState>(timed.event) == EngineState::kRunning;
      py::dict fields = append("state");
      fields["state"] = LiveStateName(is_running ? LiveState::kRunning : LiveState::kWarmingUp);
      fields["frames"] = timed.frames;
      fields["dropped"] = timed.dropped;
    }
  }

  std::vector<TimedEvent> events_;        // not yet taken
  std::map<int, OpenTrack> open_tracks_;  // by the engine's number
  int next_number_ = 0;
  std::map<std::uint32_t, SensorState> sensor_states_;
  std::optional<EngineState> state_;
  NamedSensors sensors_;
};

// Rows of 96 bytes: the columns of a trajectory file, with `timestamp_ns` (int64) for `timestamp`,
// the others as float64.
py::bytearray PackedRows(const std::vector<TrajectoryRow>& rows) {
  std::string bytes;
  constexpr std::size_t kRowColumns = 12;
  bytes.reserve(rows.size() * kRowColumns * sizeof(double));
  const auto append = [&](const auto& value) {
    static_assert(sizeof(value) == 8);
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  for (const TrajectoryRow& row : rows) {
    append(row.time_ns);
    append(static_cast<double>(row.track_id));
    for (const Eigen::Vector3d* vector : {&row.position_m, &row.velocity_mps, &row.sigma_m}) {
      for (const double value : *vector) append(value);
    }
    append(static_cast<double>(row.support));
  }
  return py::bytearray(bytes);
}

// Tracks when all frames are there.
class WholeRecording {
 public:
  WholeRecording(const std::string& config, const Assignments& assignments, std::int64_t nanohertz,
                 const py::dict& poses)
      : sensors_(config, assignments, nanohertz, poses, true,
                 [this](const EngineEvent& event) { std::visit(TrackCollector{tracks_}, event); }) {
  }

  void Add(const std::string& sensor, TimeNs stamp_ns, const py::object& xyz,
           const py::object& offsets_ns) {
    sensors_.Add(sensor, stamp_ns, xyz, offsets_ns);
  }

  // (id, packed rows, (drone, bird_like, unknown)) of each.
  py::list Tracks() {
    {
      const py::gil_scoped_release unlocked;
      sensors_.engine().Close();
    }
    py::list tracks;
    for (const Track& track : std::exchange(tracks_, {})) {
      const Kind& kind = track.kind;
      tracks.append(py::make_tuple(track.id, PackedRows(track.rows),
                                   py::make_tuple(kind.drone, kind.bird_like, kind.unknown)));
    }
    return tracks;
  }

  std::vector<std::string> TakeNotes() { return sensors_.TakeNotes(); }

 private:
  std::vector<Track> tracks_;
  NamedSensors sensors_;
};

const char* PythonClassOf(const Error& error) {
  constexpr std::array kNames = {"UnlidarError", "UnlidarError", "UsageError",  // by exit code
                                 "ConfigError",  "InputError",   "OutputError"};
  return kNames[static_cast<std::size_t>(error.code())];
}

// NOLINTNEXTLINE(performance-unnecessary-value-param): of the type that pybind11 takes
void Translate(std::exception_ptr thrown) {
  try {
    if (thrown) std::rethrow_exception(thrown);
  } catch (const Error& error) {
    const py::object kind = py::module_::import("unlidar.errors").attr(PythonClassOf(error));
    PyErr_SetString(kind.ptr(), error.what());
  }
}

template <typename Front>
py::class_<Front> Frontend(const py::module_& module, const char* name, const char* doc) {
  return py::class_<Front>(module, name, doc)
      .def(
          py::init<const std::string&, const Assignments&, std::int64_t, const py::dict&>(),
          py::arg("config"), py::arg("assignments"), py::arg("nanohertz"), py::arg("poses"),
          "Takes the path of a YAML file or '', assignments `section.key=value`, the rate of the "
          "rows or 0 for the stamps of the first sensor, and poses by sensor, '': all: the path of "
          "a file, or stamps with an array of numbers.")
      .def("add", &Front::Add, py::arg("sensor"), py::arg("stamp_ns"), py::arg("xyz"),
           py::arg("offsets_ns").none(true),
           "Adds a frame; the interpreter lock is free meanwhile.")
      .def("take_notes", &Front::TakeNotes, "What a user should know, since the last call.");
}

}  // namespace
}  // namespace unlidar

PYBIND11_MODULE(_engine, module) {
  using namespace unlidar;
  module.doc() = "The C++ engine. Use unlidar.Engine and unlidar.track.";
  py::register_exception_translator(&Translate);
  Frontend<Stream>(module, "Stream", "Events frame by frame, as dictionaries. Not thread-safe.")
      .def("advance", &Stream::Advance, py::arg("now_ns"), "Advances time without a frame.")
      .def("close", &Stream::Close, "Emits all that is pending; no frame may follow.");
  Frontend<WholeRecording>(module, "Recording", "Tracks of a whole recording. Not thread-safe.")
      .def("tracks", &WholeRecording::Tracks,
           "(id, packed rows, (drone, bird_like, unknown)) of each track; no frame may follow.");
}
