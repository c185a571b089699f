#include "io/pose_file.hpp"

#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string_view>

#include "base/format.hpp"
#include "io/frame_directory.hpp"
#include "io/input_file.hpp"
#include "io/stamp.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr double kMaxNormError = 0.01;  // of numbers with three or more digits
constexpr std::size_t kNumFields = 8;
constexpr const char* kExpected = "expected `stamp x y z qx qy qz qw`";

// `line`: without blanks at its ends, not empty.
Pose ParsePose(std::string_view line, const std::string& where) {
  const auto fail = [&](std::string_view what, const char* problem) {
    throw InputError(where + Quoted(what) + problem + ", " + kExpected);
  };
  const std::vector<std::string_view> fields = ValuesOf(line);
  const std::optional<TimeNs> stamp_ns = ParseStamp(fields.front());
  if (!stamp_ns) fail(fields.front(), " is no stamp");
  std::array<double, kNumFields - 1> values{};
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (i + 1 == fields.size()) fail(line, " has fewer values");
    const std::optional<double> number = ParseNumber<double>(fields[i + 1]);
    if (!number || !std::isfinite(*number)) fail(fields[i + 1], " is no number");
    values[i] = *number;
  }
  if (fields.size() > kNumFields) {
    fail(line.substr(static_cast<std::size_t>(fields[kNumFields].data() - line.data())),
         " is too much");
  }
  return {
      *stamp_ns, {values[0], values[1], values[2]}, {values[3], values[4], values[5], values[6]}};
}

}  // namespace

std::string PoseProblem(const Pose* before, const Pose& pose) {
  if (!(std::abs(pose.time_ns) <= kMaxStampNs)) {
    return "the stamp " + std::to_string(pose.time_ns) + " ns, expected a year from 1844 to 2096";
  }
  if (before != nullptr && pose.time_ns <= before->time_ns) {
    return "the stamp " + std::to_string(pose.time_ns) + " ns is not later than the one before, " +
           std::to_string(before->time_ns) + " ns, expected rising stamps";
  }
  for (const double coordinate_m : pose.position_m) {
    if (std::abs(coordinate_m) <= kMaxPoseCoordinateM) continue;  // not NaN
    return "the coordinate " + ShortestText(coordinate_m) +
           " m, expected less than 100 km from the origin of a local frame";
  }
  const double norm = pose.rotation_xyzw.norm();
  if (std::abs(norm - 1.0) <= kMaxNormError) return "";
  return "the quaternion has the norm " + ShortestText(norm) + ", expected 1";
}

std::vector<Pose> ReadPoses(const std::string& path) {
  LineReader lines(path, {"poses, one a line"});
  std::vector<Pose> poses;
  while (lines.Next()) {
    const std::string_view line = Trimmed(lines.line());
    if (line.empty() || line.front() == '#') continue;
    const std::string where = path + ":" + std::to_string(lines.number()) + ": ";
    const Pose pose = ParsePose(line, where);
    const std::string problem = PoseProblem(poses.empty() ? nullptr : &poses.back(), pose);
    if (!problem.empty()) throw InputError(where + problem);
    poses.push_back(pose);
  }
  if (poses.size() < 2) {
    throw InputError(path + ": " + Count(poses.size(), "pose") + ", expected at least two");
  }
  return poses;
}

PosesByName ReadPoseFiles(const PoseFiles& files) {
  PosesByName poses;
  for (const auto& [name, path] : files) {
    poses[name] = std::make_shared<const std::vector<Pose>>(ReadPoses(path));
  }
  return poses;
}

}  // namespace unlidar
