// Test-only: what PCL's reader makes of a file.
#pragma once

#include <pcl/PCLPointCloud2.h>
#include <pcl/conversions.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Core>
#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace unlidar::testing {

inline std::optional<pcl::PCLPointCloud2> PclBlob(const std::string& path) {
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  pcl::PCLPointCloud2 blob;
  if (pcl::PCDReader().read(path, blob) != 0) return std::nullopt;
  return blob;
}

// The points as a user of PCL gets them.
inline std::vector<Eigen::Vector3f> PclPoints(const pcl::PCLPointCloud2& blob) {
  if (blob.data.empty()) return {};  // fromPCLPointCloud2 takes the address of the first point
  pcl::PointCloud<pcl::PointXYZ> cloud;
  pcl::fromPCLPointCloud2(blob, cloud);
  std::vector<Eigen::Vector3f> points_m;
  for (const pcl::PointXYZ& p : cloud) points_m.emplace_back(p.x, p.y, p.z);
  return points_m;
}

template <typename T>
double ValueAt(const std::uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(value));
  return static_cast<double>(value);
}

inline double ValueAt(const std::uint8_t* bytes, std::uint8_t datatype) {
  switch (datatype) {
    case pcl::PCLPointField::INT8:
      return ValueAt<std::int8_t>(bytes);
    case pcl::PCLPointField::UINT8:
      return ValueAt<std::uint8_t>(bytes);
    case pcl::PCLPointField::INT16:
      return ValueAt<std::int16_t>(bytes);
    case pcl::PCLPointField::UINT16:
      return ValueAt<std::uint16_t>(bytes);
    case pcl::PCLPointField::INT32:
      return ValueAt<std::int32_t>(bytes);
    case pcl::PCLPointField::UINT32:
      return ValueAt<std::uint32_t>(bytes);
    case pcl::PCLPointField::INT64:
      return ValueAt<std::int64_t>(bytes);
    case pcl::PCLPointField::UINT64:
      return ValueAt<std::uint64_t>(bytes);
    case pcl::PCLPointField::FLOAT32:
      return ValueAt<float>(bytes);
    default:
      return ValueAt<double>(bytes);
  }
}

// The values of a field in what PCL read, the name in any case; empty without such a field.
inline std::vector<double> PclColumn(const pcl::PCLPointCloud2& blob, const std::string& name) {
  for (const pcl::PCLPointField& field : blob.fields) {
    std::string lower = field.name;
    std::transform(lower.begin(), lower.end(), lower.begin(),
                   [](char c) { return static_cast<char>(std::tolower(c)); });
    if (lower != name) continue;
    std::vector<double> values;
    for (std::size_t i = 0; i < std::size_t{blob.width} * blob.height; ++i) {
      values.push_back(
          ValueAt(blob.data.data() + i * blob.point_step + field.offset, field.datatype));
    }
    return values;
  }
  return {};
}

// The points in what PCL read, whatever the type of the coordinates; 0 for those that are missing.
inline std::vector<Eigen::Vector3f> PclPointsOfAnyType(const pcl::PCLPointCloud2& blob) {
  std::vector<Eigen::Vector3f> points_m(std::size_t{blob.width} * blob.height,
                                        Eigen::Vector3f::Zero());
  const std::string names[] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    const std::vector<double> values = PclColumn(blob, names[axis]);
    for (std::size_t i = 0; i < values.size(); ++i) {
      points_m[i][axis] = static_cast<float>(values[i]);
    }
  }
  return points_m;
}

// Equal to the bit, but any NaN equals any other.
inline bool SamePoints(const std::vector<Eigen::Vector3f>& a,
                       const std::vector<Eigen::Vector3f>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const Eigen::Vector3f& p, const Eigen::Vector3f& q) {
                      for (int axis = 0; axis < 3; ++axis) {
                        const bool both_nan = std::isnan(p[axis]) && std::isnan(q[axis]);
                        if (!both_nan && std::memcmp(&p[axis], &q[axis], 4) != 0) return false;
                      }
                      return true;
                    });
}

// The PCD files of a folder in ../shared/data/formats/pcd; none where it is missing.
inline std::vector<std::filesystem::path> SharedPcdFiles(const std::string& folder) {
  std::vector<std::filesystem::path> paths;
  std::error_code error;
  const auto directory =
      std::filesystem::path(UNLIDAR_SOURCE_DIR) / "../shared/data/formats/pcd" / folder;
  for (const auto& entry : std::filesystem::directory_iterator(directory, error)) {
    paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

}  // namespace unlidar::testing
