#include "python/named_sensors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <utility>

#include "app/output.hpp"
#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "io/frames.hpp"
#include "io/input_limits.hpp"
#include "io/pose_file.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

constexpr py::ssize_t kPoseColumns = 7;
constexpr int kPaceFrames = 10;
constexpr TimeNs kShortestPeriodNs = 1'000'000;  // faster than any LiDAR's frames, by far

// "an array of shape (7, 2) and dtype float32", or the type of what is no array.
std::string Described(const py::object& value) {
  if (!py::hasattr(value, "shape") || !py::hasattr(value, "dtype")) {
    return "a " + py::cast<std::string>(py::type::of(value).attr("__name__"));
  }
  return "an array of shape " + py::cast<std::string>(py::str(value.attr("shape"))) +
         " and dtype " + py::cast<std::string>(py::str(value.attr("dtype")));
}

// Empty for what shows no memory.
py::buffer_info ViewOf(const py::object& value) {
  if (!py::isinstance<py::buffer>(value)) return {};
  try {
    return py::reinterpret_borrow<py::buffer>(value).request();
  } catch (const py::error_already_set&) {
    return {};  // numpy has types that the protocol has not
  }
}

// numpy marks what is not aligned by '='.
bool IsOf(const py::buffer_info& view, const char* native_formats, py::ssize_t bytes) {
  const std::string& format = view.format;
  const std::size_t prefix = !format.empty() && format.front() == '=' ? 1 : 0;
  return format.size() == prefix + 1 && view.itemsize == bytes &&
         std::strchr(native_formats, format.back()) != nullptr;
}

bool IsDouble(const py::buffer_info& view) { return IsOf(view, "d", sizeof(double)); }

bool IsInt64(const py::buffer_info& view) { return IsOf(view, "lq", sizeof(std::int64_t)); }

// Inf is no return, and what becomes Inf only here is none by mistake.
template <typename Value>
std::vector<Eigen::Vector3f> PointsFrom(const py::buffer_info& view, const std::string& frame) {
  std::vector<Eigen::Vector3f> points_m(static_cast<std::size_t>(view.shape[0]));
  const char* from = static_cast<const char*>(view.ptr);
  for (Eigen::Vector3f& point_m : points_m) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto value = LoadAs<Value>(from + axis * view.strides[1]);
      if (std::isfinite(value) && std::abs(value) > std::numeric_limits<float>::max()) {
        throw InputError(frame + ": xyz has " + ShortestText(value) +
                         ", expected metres, which float32 can hold");
      }
      point_m[axis] = static_cast<float>(value);
    }
    from += view.strides[0];
  }
  return points_m;
}

// Returns a view of the returns of a frame, (n, 3) of float32 or float64 of any strides.
py::buffer_info PointsOf(const py::object& xyz, const std::string& frame) {
  py::buffer_info view = ViewOf(xyz);
  const bool is_point_type = IsDouble(view) || IsOf(view, "f", sizeof(float));
  if (is_point_type && view.ndim == 2 && view.shape[1] == 3) return view;
  throw InputError(frame + ": xyz is " + Described(xyz) +
                   ", expected an array of shape (n, 3) and dtype float32 or float64");
}

// The same of the times of `num_points` returns, int64 of any stride; empty for None.
py::buffer_info OffsetsOf(const py::object& offsets_ns, py::ssize_t num_points,
                          const std::string& frame) {
  if (offsets_ns.is_none()) return {};
  py::buffer_info view = ViewOf(offsets_ns);
  if (IsInt64(view) && view.ndim == 1 && view.shape[0] == num_points) return view;
  throw InputError(frame + ": offsets_ns is " + Described(offsets_ns) +
                   ", expected None or an array of shape (" + std::to_string(num_points) +
                   ",) and dtype int64");
}

// Like CopiedOffsets(), needs no interpreter lock. Throws InputError for a finite coordinate that
// no float holds.
std::vector<Eigen::Vector3f> CopiedPoints(const py::buffer_info& points, const std::string& frame) {
  return IsDouble(points) ? PointsFrom<double>(points, frame) : PointsFrom<float>(points, frame);
}

std::vector<std::int64_t> CopiedOffsets(const py::buffer_info& offsets) {
  std::vector<std::int64_t> offsets_ns(static_cast<std::size_t>(offsets.size));
  const char* from = static_cast<const char*>(offsets.ptr);
  for (std::int64_t& offset_ns : offsets_ns) {
    offset_ns = LoadAs<std::int64_t>(from);
    from += offsets.strides[0];
  }
  return offsets_ns;
}

// Returns the poses of an array of stamps, (n,) int64, and one of coordinates in metres and
// quaternions x, y, z, w, (n, 7) float64. Throws InputError, which begins with `where`.
std::vector<Pose> CopiedPoses(const py::object& stamps_ns, const py::object& values,
                              const std::string& where) {
  const py::buffer_info stamps = ViewOf(stamps_ns);
  const py::buffer_info numbers = ViewOf(values);
  const bool are_stamps = IsInt64(stamps) && stamps.ndim == 1;
  if (!are_stamps || !IsDouble(numbers) || numbers.ndim != 2 ||
      numbers.shape[0] != stamps.shape[0] || numbers.shape[1] != kPoseColumns) {
    throw InputError(where + ": " + Described(stamps_ns) + " and " + Described(values) +
                     ", expected one of shape (n,) and dtype int64 and one of shape (n, 7) and "
                     "dtype float64");
  }
  std::vector<Pose> poses;
  for (py::ssize_t i = 0; i < stamps.shape[0]; ++i) {
    std::array<double, kPoseColumns> row{};
    const char* const from = static_cast<const char*>(numbers.ptr) + i * numbers.strides[0];
    for (std::size_t column = 0; column < row.size(); ++column) {
      row[column] = LoadAs<double>(from + static_cast<py::ssize_t>(column) * numbers.strides[1]);
    }
    const Pose pose = {LoadAs<TimeNs>(static_cast<const char*>(stamps.ptr) + i * stamps.strides[0]),
                       {row[0], row[1], row[2]},
                       {row[3], row[4], row[5], row[6]}};
    const std::string problem = PoseProblem(poses.empty() ? nullptr : &poses.back(), pose);
    if (!problem.empty()) throw InputError(where + ", pose " + std::to_string(i) + ": " + problem);
    poses.push_back(pose);
  }
  if (poses.size() < 2) {
    throw InputError(where + ": " + Count(poses.size(), "pose") + ", expected at least two");
  }
  return poses;
}

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

Config ConfigOf(const std::string& path, const std::vector<std::string>& assignments,
                const py::dict& poses, bool is_recording) {
  PosesByName of_name = PosesOf(poses);
  Config config = LoadConfig(path, assignments);
  config.poses = std::move(of_name);
  if (is_recording) config.live.delay_s = std::numeric_limits<double>::infinity();
  return config;
}

}  // namespace

NamedSensors::NamedSensors(const std::string& config_path,
                           const std::vector<std::string>& assignments, std::int64_t nanohertz,
                           const py::dict& poses, bool is_recording, EngineCallback on_event)
    : config_(ConfigOf(config_path, assignments, poses, is_recording)),
      engine_(config_, {}, std::move(on_event),
              nanohertz == 0 ? OutputTimes() : OutputTimes(Rate{nanohertz})) {}

std::uint32_t NamedSensors::IndexOf(const std::string& sensor) {
  const auto known = std::find(names_.begin(), names_.end(), sensor);
  if (known != names_.end()) return static_cast<std::uint32_t>(known - names_.begin());
  if (!IsSensorName(sensor)) {
    throw UsageError("sensor: " + Quoted(sensor) + ", " + kExpectedSensorName);
  }
  if (names_.size() >= kMaxSensors) {
    throw UsageError("sensor: '" + sensor + "' is one more, expected at most " +
                     std::to_string(kMaxSensors));
  }
  if (!config_.sensors.empty() && config_.sensors.count(sensor) == 0) {
    notes_.push_back("the config has no sensors." + sensor + ", it stands at the origin");
  }
  const std::uint32_t index = engine_.AddSensor(sensor);
  names_.push_back(sensor);
  paces_.emplace_back();
  return index;
}

void NamedSensors::NoteCount(std::uint64_t count, const std::string& text, std::uint64_t* noted) {
  if (IsWorthANote(std::exchange(*noted, count), count)) {
    notes_.push_back(Count(count, "frame") + text);
  }
}

void NamedSensors::NotePace(std::uint32_t sensor, TimeNs stamp_ns) {
  Pace& pace = paces_[sensor];
  if (pace.frames == kPaceFrames) return;
  pace.first_ns = std::min(pace.first_ns, stamp_ns);
  pace.last_ns = std::max(pace.last_ns, stamp_ns);
  if (++pace.frames < kPaceFrames) return;
  const TimeNs span_ns = pace.last_ns - pace.first_ns;
  if (span_ns >= kPaceFrames * kShortestPeriodNs) return;
  notes_.push_back(
      names_[sensor] + ": " + std::to_string(kPaceFrames) + " frames within " +
      std::to_string(span_ns) +
      " ns: their stamps are likely microseconds or milliseconds, expected nanoseconds");
}

void NamedSensors::Add(const std::string& sensor, TimeNs stamp_ns, const py::object& xyz,
                       const py::object& offsets_ns) {
  const std::string name =
      "frame of " + Shortened(sensor) + ", stamp " + std::to_string(stamp_ns) + " ns";
  const py::buffer_info points = PointsOf(xyz, name);
  const py::buffer_info offsets = OffsetsOf(offsets_ns, points.shape[0], name);
  const std::uint32_t index = IndexOf(sensor);
  Frame frame;
  frame.sensor = index;
  frame.stamp_ns = stamp_ns;
  last_frame_ = name;
  try {
    const py::gil_scoped_release unlocked;
    frame.points_m = CopiedPoints(points, name);
    frame.offsets_ns = CopiedOffsets(offsets);
    engine_.Add(std::move(frame));
    NotePace(index, stamp_ns);
  } catch (const UnitError&) {
    throw;  // the next would be no better
  } catch (const InputError& error) {
    if (!config_.input.skip_bad_frames) throw;
    NoteCount(bad_frames_ + 1,
              std::string(" bad and skipped (input.skip_bad_frames), the last: ") + error.what(),
              &bad_frames_);
  }
}

std::uint64_t NamedSensors::num_dropped() const {
  return bad_frames_ + engine_.counts().bad_frames + engine_.late_frames() +
         engine_.astray_frames() + engine_.overflow_frames();
}

std::vector<std::string> NamedSensors::TakeNotes() {
  NoteCount(engine_.late_frames(),
            " later than live.reorder_s and dropped, the last: " + last_frame_, &noted_late_);
  NoteCount(engine_.astray_frames(), " astray and left out: no other stamps bear theirs out",
            &noted_astray_);
  NoteCount(engine_.overflow_frames(), kOverflowText, &noted_overflow_);
  const std::vector<Warning>& warnings = engine_.warnings();
  for (; num_warnings_ < warnings.size(); ++num_warnings_) {
    notes_.push_back(warnings[num_warnings_].text);
  }
  return std::exchange(notes_, {});
}

}  // namespace unlidar
