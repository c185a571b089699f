// The module unlidar._engine: engines for tools/unlidar/engine.py, which checks names and types,
// serialises calls and makes the objects that users see.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "api/track_collector.hpp"
#include "base/format.hpp"
#include "io/pose_file.hpp"
#include "python/arrays.hpp"
#include "python/named_sensors.hpp"
#include "python/stream_events.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

using Assignments = std::vector<std::string>;

// Takes of each sensor the path of a file, or a tuple of the arrays of CopiedPoses().
PosesByName PosesOf(const py::dict& poses) {
  PosesByName of_name;
  for (const auto& [key, value] : poses) {
    const auto name = py::cast<std::string>(key);
    std::vector<Pose> of_carrier;
    if (py::isinstance<py::str>(value)) {
      of_carrier = ReadPoses(py::cast<std::string>(value));
    } else {
      const auto [stamps_ns, values] = py::cast<std::pair<py::object, py::object>>(value);
      of_carrier =
          CopiedPoses(stamps_ns, values, name.empty() ? "poses" : "poses of " + Quoted(name));
    }
    of_name[name] = std::make_shared<const std::vector<Pose>>(std::move(of_carrier));
  }
  return of_name;
}

// Events frame by frame.
class Stream {
 public:
  Stream(const std::string& config, const Assignments& assignments, std::int64_t nanohertz,
         const py::dict& poses)
      : sensors_(config, assignments, nanohertz, PosesOf(poses), false,
                 [this](const EngineEvent& event) { events_.Take(event, sensors_); }) {}

  py::list Add(const std::string& sensor, TimeNs stamp_ns, const py::object& xyz,
               const py::object& offsets_ns) {
    sensors_.Add(sensor, stamp_ns, xyz, offsets_ns);
    return events_.TakeAll(sensors_);
  }

  py::list Advance(TimeNs now_ns) {
    {
      const py::gil_scoped_release unlocked;
      sensors_.engine().Advance(now_ns);
    }
    return events_.TakeAll(sensors_);
  }

  py::list Close() {
    {
      const py::gil_scoped_release unlocked;
      sensors_.engine().Close();
      events_.Close(sensors_);
    }
    return events_.TakeAll(sensors_);
  }

  std::vector<std::string> TakeNotes() { return sensors_.TakeNotes(); }

 private:
  StreamEvents events_;
  NamedSensors sensors_;
};

// Tracks when all frames are there.
class WholeRecording {
 public:
  WholeRecording(const std::string& config, const Assignments& assignments, std::int64_t nanohertz,
                 const py::dict& poses)
      : sensors_(config, assignments, nanohertz, PosesOf(poses), true,
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
