// numpy arrays: those of a frame checked and copied, rows of tracks made.
#pragma once

#include <pybind11/numpy.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// The returns of a frame, (n, 3) of float32 or float64, any strides.
class PointArray {
 public:
  // Throws InputError, which begins with `frame`, for anything else.
  PointArray(const pybind11::object& xyz, const std::string& frame);

  // Needs no interpreter lock.
  std::vector<Eigen::Vector3f> Copy() const;

  std::size_t size() const { return num_points_; }

 private:
  pybind11::array array_;
  const char* data_;
  std::ptrdiff_t row_bytes_;
  std::ptrdiff_t column_bytes_;
  std::size_t num_points_;
  bool is_double_;
};

// The times of `num_points` returns, an array of int64 of any stride; empty for None.
class OffsetArray {
 public:
  // Throws InputError, which begins with `frame`, for anything else.
  OffsetArray(const pybind11::object& offsets_ns, std::size_t num_points, const std::string& frame);

  // Needs no interpreter lock.
  std::vector<std::int64_t> Copy() const;

 private:
  pybind11::array array_;
  const char* data_ = nullptr;
  std::ptrdiff_t row_bytes_ = 0;
  std::size_t size_ = 0;
};

// Tells numpy of the columns below, once.
void RegisterRowColumns();

// The columns of a trajectory file, with `timestamp_ns` for `timestamp`.
pybind11::array RowArray(const std::vector<TrajectoryRow>& rows);

}  // namespace unlidar
