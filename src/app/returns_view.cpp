#include "app/returns_view.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace unlidar {
namespace {

constexpr TimeNs kViewIntervalNs = 200'000'000;
constexpr int kBitsPerAxis = 21;  // of kMaxViewM in the finest voxels, on both sides of the origin

struct ViewVoxel {
  std::uint64_t code = 0;          // Morton code: that of the voxel of twice the edge is code >> 3
  std::uint32_t first_return = 0;  // first of the frame in it
};

std::uint64_t MortonCode(const Eigen::Vector3f& point_m) {
  std::uint64_t code = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<std::uint64_t>(
        static_cast<std::int64_t>(std::floor(double{point_m[axis]} / kFinestViewVoxelM)) +
        (std::int64_t{1} << (kBitsPerAxis - 1)));
    for (int bit = 0; bit < kBitsPerAxis; ++bit) {
      code |= ((index >> bit) & 1U) << (3 * bit + axis);
    }
  }
  return code;
}

// One return of each voxel; voxels of one code stand side by side.
std::vector<ViewVoxel> Merged(const std::vector<ViewVoxel>& voxels) {
  std::vector<ViewVoxel> merged;
  for (const ViewVoxel& voxel : voxels) {
    if (!merged.empty() && merged.back().code == voxel.code) {
      merged.back().first_return = std::min(merged.back().first_return, voxel.first_return);
    } else {
      merged.push_back(voxel);
    }
  }
  return merged;
}

void AppendBase64(const std::vector<std::uint8_t>& bytes, std::string& text) {
  constexpr const char* kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i + 2 < bytes.size(); i += 3) {  // 6 bytes a return: no rest
    const std::uint32_t three =
        (std::uint32_t{bytes[i]} << 16U) | (std::uint32_t{bytes[i + 1]} << 8U) | bytes[i + 2];
    for (const unsigned shift : {18U, 12U, 6U, 0U}) text += kDigits[(three >> shift) & 63U];
  }
}

}  // namespace

std::vector<std::uint32_t> ThinnedReturns(const std::vector<Eigen::Vector3f>& points_m,
                                          std::size_t max_returns) {
  std::vector<std::uint32_t> chosen;
  for (std::uint32_t i = 0; i < points_m.size(); ++i) {
    if ((points_m[i].array().abs() <= kMaxViewM).all()) chosen.push_back(i);
  }
  if (chosen.size() <= max_returns) return chosen;

  std::vector<ViewVoxel> voxels;
  voxels.reserve(chosen.size());
  for (const std::uint32_t i : chosen) voxels.push_back({MortonCode(points_m[i]), i});
  std::sort(voxels.begin(), voxels.end(), [](const ViewVoxel& a, const ViewVoxel& b) {
    return a.code < b.code || (a.code == b.code && a.first_return < b.first_return);
  });
  std::vector<ViewVoxel> finer = voxels;
  voxels = Merged(voxels);
  while (voxels.size() > max_returns) {
    finer = voxels;
    for (ViewVoxel& voxel : voxels) voxel.code >>= 3U;
    voxels = Merged(voxels);
  }

  chosen.clear();
  for (const ViewVoxel& voxel : voxels) chosen.push_back(voxel.first_return);
  std::sort(chosen.begin(), chosen.end());
  std::vector<std::uint32_t> rest;
  for (const ViewVoxel& voxel : finer) {
    if (!std::binary_search(chosen.begin(), chosen.end(), voxel.first_return)) {
      rest.push_back(voxel.first_return);
    }
  }
  const std::size_t room = std::min(max_returns - chosen.size(), rest.size());
  for (std::size_t i = 0; i < room; ++i) chosen.push_back(rest[i * rest.size() / room]);
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

ReturnsText TextOfReturns(const std::vector<Eigen::Vector3f>& points_m,
                          const std::vector<std::uint32_t>& indices) {
  float farthest_m = 0.0F;
  for (const std::uint32_t i : indices) {
    farthest_m = std::max(farthest_m, points_m[i].cwiseAbs().maxCoeff());
  }
  ReturnsText text;
  while (std::lround(farthest_m / text.step_m) > std::numeric_limits<std::int16_t>::max()) {
    text.step_m *= 2.0;
  }
  std::vector<std::uint8_t> bytes;
  bytes.reserve(indices.size() * 6);
  for (const std::uint32_t i : indices) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto steps = static_cast<std::uint16_t>(std::lround(points_m[i][axis] / text.step_m));
      bytes.push_back(static_cast<std::uint8_t>(steps & 255U));
      bytes.push_back(static_cast<std::uint8_t>(steps >> 8U));
    }
  }
  AppendBase64(bytes, text.xyz);
  return text;
}

bool ViewPace::IsDue(TimeNs stamp_ns) {
  const TimeNs due_ns = due_ns_.value_or(stamp_ns);
  // A clock that was set back begins anew.
  if (stamp_ns < due_ns && due_ns - stamp_ns <= kViewIntervalNs) return false;
  // The pace is kept where stamps jitter, and never made up for after a pause.
  const bool is_in_pace = stamp_ns >= due_ns && stamp_ns - due_ns < kViewIntervalNs;
  due_ns_ = (is_in_pace ? due_ns : stamp_ns) + kViewIntervalNs;
  return true;
}

}  // namespace unlidar
