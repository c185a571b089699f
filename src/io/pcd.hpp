// PCD files (Point Cloud Data), read as by PCL, but 4 to 8 times faster and bounded in memory.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace unlidar {

// All rows of the file (width * height), including no-return and NaN rows.
struct PcdCloud {
  std::vector<Eigen::Vector3f> points_m;
  // Raw values of the time field, if there is one: in the vector of its type.
  std::vector<std::int64_t> integer_times;
  std::vector<double> floating_times;
};

// Reads ascii, binary and binary_compressed files of versions .5 to .7, fields in any order.
//   - Coordinates are the fields x y z (or X Y Z) of any type, one value each, converted to float.
//     x and y are required; without z the cloud is planar and z is 0.
//   - The time is the first field of count 1 named t, time, timestamp or offset_time, in any case.
//   - As in PCL: SIZE and TYPE default to float32, COUNT to 1, HEIGHT to 1, WIDTH to POINTS;
//     COLUMNS means FIELDS; `_` is padding; bytes and lines after the last point are ignored.
//   - Unlike PCL: a row with too few or too many values is an error and not a point at (0, 0, 0),
//     and float64 coordinates are converted and not zero.
// Memory use is proportional to the size of the file, whatever the header states: LZF unpacks to at
// most kLzfMaxExpansion times its size, and a row of two bytes or more becomes a point of twelve.
// The file is read only as far as its points extend. Throws InputError naming the file, the value
// and what was expected, also for more than 2^26 points or 1 GiB in the file or unpacked.
PcdCloud ReadPcd(const std::string& path);

// Same as ReadPcd() for bytes in memory; `name` stands for the file in messages.
PcdCloud ParsePcd(std::string_view bytes, const std::string& name);

// Returns a binary PCD v0.7 file with fields x y z (float32), readable by PCL.
std::string BinaryPcd(const std::vector<Eigen::Vector3f>& points_m);

}  // namespace unlidar
