#include "python/named_sensors.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "app/live_event_reporter.hpp"
#include "app/output.hpp"
#include "base/format.hpp"
#include "io/frames.hpp"
#include "io/input_limits.hpp"
#include "io/pose_file.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

constexpr int kPaceFrames = 10;
constexpr TimeNs kShortestPeriodNs = 1'000'000;  // faster than any LiDAR's frames, by far

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

OutputTimes OutputTimesOf(std::int64_t nanohertz) {
  if (nanohertz == 0) return FirstSensorStamps{};
  return Rate{nanohertz};
}

}  // namespace

NamedSensors::NamedSensors(const std::string& config_path,
                           const std::vector<std::string>& assignments, std::int64_t nanohertz,
                           const py::dict& poses, bool is_recording, EngineCallback on_event)
    : config_(ConfigOf(config_path, assignments, poses, is_recording)),
      engine_(std::make_unique<Engine>(config_, std::vector<std::string>(), std::move(on_event),
                                       OutputTimesOf(nanohertz))) {}

std::uint32_t NamedSensors::IndexOf(const std::string& sensor) {
  const auto known = index_of_.find(sensor);
  if (known != index_of_.end()) return known->second;
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
  names_.push_back(sensor);
  paces_.emplace_back();
  return index_of_[sensor] = engine_->AddSensor(sensor);
}

void NamedSensors::NoteCount(std::uint64_t count, const std::string& text, std::uint64_t* noted) {
  if (IsWorthANote(std::exchange(*noted, count), count)) {
    notes_.push_back(Count(count, "frame") + text);
  }
}

void NamedSensors::NotePace(std::uint32_t sensor, TimeNs stamp_ns) {
  Pace& pace = paces_[sensor];
  if (pace.frames == kPaceFrames) return;
  const bool is_first = pace.frames == 0;
  pace.first_ns = is_first ? stamp_ns : std::min(pace.first_ns, stamp_ns);
  pace.last_ns = is_first ? stamp_ns : std::max(pace.last_ns, stamp_ns);
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
    engine_->Add(std::move(frame));
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
  return bad_frames_ + engine_->counts().bad_frames + engine_->late_frames() +
         engine_->astray_frames() + engine_->overflow_frames();
}

std::vector<std::string> NamedSensors::TakeNotes() {
  NoteCount(engine_->late_frames(),
            " later than live.reorder_s and dropped, the last: " + last_frame_, &noted_late_);
  NoteCount(engine_->astray_frames(), " astray and left out: no other stamps bear theirs out",
            &noted_astray_);
  NoteCount(engine_->overflow_frames(), kOverflowText, &noted_overflow_);
  const std::vector<Warning>& warnings = engine_->warnings();
  for (; num_warnings_ < warnings.size(); ++num_warnings_) {
    notes_.push_back(warnings[num_warnings_].text);
  }
  return std::exchange(notes_, {});
}

}  // namespace unlidar
