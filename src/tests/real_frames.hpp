// Test-only reader of the real frames in ../shared (NumPy arrays of doubles, one row a return).
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

namespace unlidar::testing {

// The returns of an (N, 3) array of little-endian doubles; rays without a return are left out.
inline std::vector<Eigen::Vector3f> ReadNpyReturns(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), {});
  if (bytes.size() < 10 || bytes.compare(1, 5, "NUMPY") != 0) {
    throw std::runtime_error(path.string() + ": not a NumPy file");
  }
  const auto header_size = static_cast<std::size_t>(static_cast<unsigned char>(bytes[8])) +
                           256U * static_cast<unsigned char>(bytes[9]);
  if (bytes.substr(10, header_size).find("'<f8', 'fortran_order': False") == std::string::npos) {
    throw std::runtime_error(path.string() + ": not an array of doubles");
  }
  const std::size_t first = 10 + header_size;
  std::vector<Eigen::Vector3f> points_m;
  for (std::size_t at = first; at + 24 <= bytes.size(); at += 24) {
    double xyz[3];
    std::memcpy(xyz, bytes.data() + at, sizeof(xyz));
    const Eigen::Vector3f p(static_cast<float>(xyz[0]), static_cast<float>(xyz[1]),
                            static_cast<float>(xyz[2]));
    if (!p.isZero(0.0F)) points_m.push_back(p);
  }
  return points_m;
}

// The frames of a folder in order of time; none where the folder is missing. The stamps in the
// names have one number of digits, so that the alphabetic order is that of time.
inline std::vector<std::filesystem::path> ListFrames(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> paths;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".npy") paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

// Every `step`-th frame of the real Mid-360; none where the recording is missing.
inline std::vector<std::vector<Eigen::Vector3f>> ReadRealFrames(const std::string& project_folder,
                                                                std::size_t step) {
  const auto paths = ListFrames(std::filesystem::path(project_folder) /
                                "../shared/data/mmaud/val/seq0001/lidar_360");
  std::vector<std::vector<Eigen::Vector3f>> frames;
  for (std::size_t i = 0; i < paths.size(); i += step) frames.push_back(ReadNpyReturns(paths[i]));
  return frames;
}

inline std::vector<Eigen::Vector3f> Superimpose(
    const std::vector<std::vector<Eigen::Vector3f>>& frames) {
  std::vector<Eigen::Vector3f> points_m;
  for (const auto& frame : frames) points_m.insert(points_m.end(), frame.begin(), frame.end());
  return points_m;
}

}  // namespace unlidar::testing
