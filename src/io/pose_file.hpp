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

// Returns the problem of a pose that follows `before` (null: the first); empty if it has none: its
// stamp is later, its coordinates are within kMaxPoseCoordinateM, its quaternion has norm 1 within
// 1 %.
std::string PoseProblem(const Pose* before, const Pose& pose);

// Reads poses in TUM format: lines `stamp x y z qx qy qz qw`, the stamp in seconds as ParseStamp()
// reads it, metres, a quaternion of norm 1 within 1 %, separated by blanks; skips blank lines and
// those that begin with '#'. Returns at least two, in order of time.
//
// Throws InputError naming file, line and value, for a line of another form, a pose with a problem
// and fewer than two poses.
std::vector<Pose> ReadPoses(const std::string& path);

using PoseFiles = std::map<std::string, std::string>;  // by the name of the sensor, see PosesByName

// Reads each file.
PosesByName ReadPoseFiles(const PoseFiles& files);

}  // namespace unlidar
