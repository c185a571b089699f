// Files of poses.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Coordinates are floats: at this distance from the origin they are 8 mm apart.
inline constexpr double kMaxPoseCoordinateM = 100'000.0;

// Returns the problem of a pose that follows `before` (null: the first); empty if its stamp is
// later, its coordinates within kMaxPoseCoordinateM, the norm of its quaternion 1 within 1 %.
std::string PoseProblem(const Pose* before, const Pose& pose);

// Reads poses in TUM format: lines `stamp x y z qx qy qz qw`, the stamp as ParseStamp() reads it,
// the place in metres, separated by blanks; skips blank lines and those that begin with '#'.
// Returns at least two, in order of time. Throws InputError naming file, line and value, also for a
// PoseProblem() and fewer than two poses.
std::vector<Pose> ReadPoses(const std::string& path);

using PoseFiles = std::map<std::string, std::string>;  // by the name of the sensor, see PosesByName

PosesByName ReadPoseFiles(const PoseFiles& files);

}  // namespace unlidar
