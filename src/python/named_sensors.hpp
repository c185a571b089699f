// Frames of sensors that go by their names, as the messages of --stdin do. Their arrays come by the
// buffer protocol, which is that of any numpy; pybind11's own are for the numpy that it was written
// for.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "unlidar/config.hpp"
#include "unlidar/engine.hpp"

namespace unlidar {

// An engine to which a sensor is added with its first frame.
class NamedSensors {
 public:
  // `poses`: of each sensor the path of a file, or a tuple of an array of stamps, (n,) int64, and
  // one of coordinates in metres and quaternions x, y, z, w, (n, 7) float64.
  // `is_recording`: rows come at the end only. Throws what LoadConfig(), ReadPoses() and Engine
  // throw.
  NamedSensors(const std::string& config_path, const std::vector<std::string>& assignments,
               std::int64_t nanohertz, const pybind11::dict& poses, bool is_recording,
               EngineCallback on_event);

  // `xyz`: (n, 3) of float32 or float64, `offsets_ns`: (n,) of int64 or None, of any strides.
  // Throws UsageError for a name that --stdin refuses, InputError for a bad frame unless
  // input.skip_bad_frames is set. The interpreter lock is free while the engine works.
  void Add(const std::string& sensor, TimeNs stamp_ns, const pybind11::object& xyz,
           const pybind11::object& offsets_ns);

  Engine& engine() { return engine_; }
  const std::string& NameOf(std::uint32_t sensor) const { return names_[sensor]; }

  // Frames that came and were not used.
  std::uint64_t num_dropped() const;

  // Those since the last call.
  std::vector<std::string> TakeNotes();

 private:
  // The span of a sensor's first stamps.
  struct Pace {
    TimeNs first_ns = std::numeric_limits<TimeNs>::max();
    TimeNs last_ns = std::numeric_limits<TimeNs>::min();
    int frames = 0;
  };

  std::uint32_t IndexOf(const std::string& sensor);
  // Notes that so many frames were left out, at the first, second, fourth and so on.
  void NoteCount(std::uint64_t count, const std::string& text, std::uint64_t* noted);
  // Notes stamps that can be no nanoseconds.
  void NotePace(std::uint32_t sensor, TimeNs stamp_ns);

  Config config_;
  std::vector<std::string> names_;
  std::vector<Pace> paces_;
  std::vector<std::string> notes_;
  std::size_t num_warnings_ = 0;
  std::string last_frame_;
  std::uint64_t noted_late_ = 0;
  std::uint64_t noted_astray_ = 0;
  std::uint64_t noted_overflow_ = 0;
  std::uint64_t bad_frames_ = 0;
  Engine engine_;
};

}  // namespace unlidar
