#include "python/arrays.hpp"

#include <cstring>
#include <utility>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace py = pybind11;

struct RowColumns {
  std::int64_t timestamp_ns;
  double track_id, x, y, z, vx, vy, vz, sigma_x, sigma_y, sigma_z, support;
};

// "an array of shape (7, 2) and dtype float32", or the type of what is no array.
std::string Described(const py::object& value) {
  if (!py::isinstance<py::array>(value)) {
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

template <typename Value>
void CopyPoints(const char* data, std::ptrdiff_t row_bytes, std::ptrdiff_t column_bytes,
                std::vector<Eigen::Vector3f>& points_m) {
  for (Eigen::Vector3f& point_m : points_m) {
    for (int axis = 0; axis < 3; ++axis) {
      point_m[axis] = static_cast<float>(ValueAt<Value>(data + axis * column_bytes));
    }
    data += row_bytes;
  }
}

}  // namespace

PointArray::PointArray(const py::object& xyz, const std::string& frame) {
  is_double_ = py::isinstance<py::array_t<double>>(xyz);
  const bool is_point_type = is_double_ || py::isinstance<py::array_t<float>>(xyz);
  if (is_point_type) array_ = py::reinterpret_borrow<py::array>(xyz);
  if (!is_point_type || array_.ndim() != 2 || array_.shape(1) != 3) {
    throw InputError(frame + ": xyz is " + Described(xyz) +
                     ", expected an array of shape (n, 3) and dtype float32 or float64");
  }
  data_ = static_cast<const char*>(array_.data());
  row_bytes_ = array_.strides(0);
  column_bytes_ = array_.strides(1);
  num_points_ = static_cast<std::size_t>(array_.shape(0));
}

std::vector<Eigen::Vector3f> PointArray::Copy() const {
  std::vector<Eigen::Vector3f> points_m(num_points_);
  if (is_double_) {
    CopyPoints<double>(data_, row_bytes_, column_bytes_, points_m);
  } else {
    CopyPoints<float>(data_, row_bytes_, column_bytes_, points_m);
  }
  return points_m;
}

OffsetArray::OffsetArray(const py::object& offsets_ns, std::size_t num_points,
                         const std::string& frame) {
  if (offsets_ns.is_none()) return;
  const bool is_integer = py::isinstance<py::array_t<std::int64_t>>(offsets_ns);
  if (is_integer) array_ = py::reinterpret_borrow<py::array>(offsets_ns);
  if (!is_integer || array_.ndim() != 1 || array_.size() != static_cast<py::ssize_t>(num_points)) {
    throw InputError(frame + ": offsets_ns is " + Described(offsets_ns) +
                     ", expected None or an array of shape (" + std::to_string(num_points) +
                     ",) and dtype int64");
  }
  data_ = static_cast<const char*>(array_.data());
  row_bytes_ = array_.strides(0);
  size_ = num_points;
}

std::vector<std::int64_t> OffsetArray::Copy() const {
  std::vector<std::int64_t> offsets_ns(size_);
  const char* from = data_;
  for (std::int64_t& offset_ns : offsets_ns) {
    offset_ns = ValueAt<std::int64_t>(from);
    from += row_bytes_;
  }
  return offsets_ns;
}

void RegisterRowColumns() {
  PYBIND11_NUMPY_DTYPE(RowColumns, timestamp_ns, track_id, x, y, z, vx, vy, vz, sigma_x, sigma_y,
                       sigma_z, support);
}

py::array RowArray(const std::vector<TrajectoryRow>& rows) {
  py::array_t<RowColumns> array(static_cast<py::ssize_t>(rows.size()));
  RowColumns* to = array.mutable_data();
  for (const TrajectoryRow& row : rows) {
    const Eigen::Vector3d& p = row.position_m;
    const Eigen::Vector3d& v = row.velocity_mps;
    const Eigen::Vector3d& s = row.sigma_m;
    *to++ = {row.time_ns, static_cast<double>(row.track_id),
             p.x(),       p.y(),
             p.z(),       v.x(),
             v.y(),       v.z(),
             s.x(),       s.y(),
             s.z(),       static_cast<double>(row.support)};
  }
  return std::move(array);
}

}  // namespace unlidar
