#include "python/arrays.hpp"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/format.hpp"
#include "io/pose_file.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

constexpr std::size_t kRowColumns = 12;
constexpr py::ssize_t kPoseColumns = 7;

// "an array of shape (7, 2) and dtype float32", or the type of what is no array.
std::string Described(const py::object& value) {
  if (!py::hasattr(value, "shape") || !py::hasattr(value, "dtype")) {
    return "a " + py::cast<std::string>(py::type::of(value).attr("__name__"));
  }
  return "an array of shape " + py::cast<std::string>(py::str(value.attr("shape"))) +
         " and dtype " + py::cast<std::string>(py::str(value.attr("dtype")));
}

template <typename Value>
Value ValueAt(const char* at) {
  Value value;
  std::memcpy(&value, at, sizeof(value));  // a field of packed records is not aligned
  return value;
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
      const auto value = ValueAt<Value>(from + axis * view.strides[1]);
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

}  // namespace

py::buffer_info PointsOf(const py::object& xyz, const std::string& frame) {
  py::buffer_info view = ViewOf(xyz);
  const bool is_point_type = IsDouble(view) || IsOf(view, "f", sizeof(float));
  if (is_point_type && view.ndim == 2 && view.shape[1] == 3) return view;
  throw InputError(frame + ": xyz is " + Described(xyz) +
                   ", expected an array of shape (n, 3) and dtype float32 or float64");
}

py::buffer_info OffsetsOf(const py::object& offsets_ns, py::ssize_t num_points,
                          const std::string& frame) {
  if (offsets_ns.is_none()) return {};
  py::buffer_info view = ViewOf(offsets_ns);
  if (IsInt64(view) && view.ndim == 1 && view.shape[0] == num_points) return view;
  throw InputError(frame + ": offsets_ns is " + Described(offsets_ns) +
                   ", expected None or an array of shape (" + std::to_string(num_points) +
                   ",) and dtype int64");
}

std::vector<Eigen::Vector3f> CopiedPoints(const py::buffer_info& points, const std::string& frame) {
  return IsDouble(points) ? PointsFrom<double>(points, frame) : PointsFrom<float>(points, frame);
}

std::vector<std::int64_t> CopiedOffsets(const py::buffer_info& offsets) {
  std::vector<std::int64_t> offsets_ns(static_cast<std::size_t>(offsets.size));
  const char* from = static_cast<const char*>(offsets.ptr);
  for (std::int64_t& offset_ns : offsets_ns) {
    offset_ns = ValueAt<std::int64_t>(from);
    from += offsets.strides[0];
  }
  return offsets_ns;
}

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
      row[column] = ValueAt<double>(from + static_cast<py::ssize_t>(column) * numbers.strides[1]);
    }
    const Pose pose = {
        ValueAt<TimeNs>(static_cast<const char*>(stamps.ptr) + i * stamps.strides[0]),
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

py::bytearray PackedRows(const std::vector<TrajectoryRow>& rows) {
  std::string bytes;
  bytes.reserve(rows.size() * kRowColumns * sizeof(double));
  const auto append = [&](const auto& value) {
    static_assert(sizeof(value) == 8);
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  for (const TrajectoryRow& row : rows) {
    append(row.time_ns);
    append(static_cast<double>(row.track_id));
    for (const Eigen::Vector3d* vector : {&row.position_m, &row.velocity_mps, &row.sigma_m}) {
      for (const double value : *vector) append(value);
    }
    append(static_cast<double>(row.support));
  }
  return py::bytearray(bytes);
}

}  // namespace unlidar
