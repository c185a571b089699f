// Arrays of a frame and of poses checked and copied, rows of tracks packed. By the buffer protocol,
// which is that of any numpy; pybind11's own arrays are for the numpy that it was written for.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <string>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Returns a view of the returns of a frame, (n, 3) of float32 or float64 of any strides. Throws
// InputError, which begins with `frame`, for anything else.
pybind11::buffer_info PointsOf(const pybind11::object& xyz, const std::string& frame);

// The same of the times of `num_points` returns, int64 of any stride; empty for None.
pybind11::buffer_info OffsetsOf(const pybind11::object& offsets_ns, pybind11::ssize_t num_points,
                                const std::string& frame);

// Both need no interpreter lock. Throws InputError, which begins with `frame`, for a finite value
// that float32 cannot hold.
std::vector<Eigen::Vector3f> CopiedPoints(const pybind11::buffer_info& points,
                                          const std::string& frame);
std::vector<std::int64_t> CopiedOffsets(const pybind11::buffer_info& offsets);

// Returns the poses of an array of stamps, (n,) int64, and one of coordinates in metres and
// quaternions x, y, z, w, (n, 7) float64.
//
// Throws InputError, which begins with `where`, for anything else, for a pose with a problem (see
// PoseProblem()), and fewer than two.
std::vector<Pose> CopiedPoses(const pybind11::object& stamps_ns, const pybind11::object& values,
                              const std::string& where);

// Rows of 96 bytes: the columns of a trajectory file, with `timestamp_ns` (int64) for `timestamp`,
// the others as float64.
pybind11::bytearray PackedRows(const std::vector<TrajectoryRow>& rows);

}  // namespace unlidar
