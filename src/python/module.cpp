// The module unlidar._engine: engines for tools/unlidar/engine.py, which checks names and types,
// serialises calls and makes the objects that users see.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "api/recording_events.hpp"
#include "python/arrays.hpp"
#include "python/named_sensors.hpp"
#include "python/stream_events.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

using Assignments = std::vector<std::string>;

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
