#include "scene/ground.hpp"

#include <Eigen/Jacobi>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

// Edge of a cell: holds returns of ground among those of bushes, and follows gentle terrain.
constexpr double kGroundCellM = 4.0;
// The height of a cell is a low quantile of its returns, so that strays below the ground do not
// count. Minimum returns of a cell with a height, and minimum cells of a plane.
constexpr double kQuantile = 0.05;
constexpr std::ptrdiff_t kMinReturns = 10;
constexpr std::size_t kMinCells = 6;
// Targets are seen near the station: within kNearM all cells weigh alike, farther ones by the
// inverse square of their distance. A plane fitted to near cells replaces the one fitted to all
// cells if its support is higher by this ratio.
constexpr double kNearM = 20.0;
constexpr double kMinSupportRatio = 1.1;
// Half-width of the inlier band: the roughness of ground. Ground rises above the plane by at most
// kMaxRiseM (higher is a bush, a car or the station itself). Heights off the plane by more than
// kMaxReliefM are ignored: deeper hollows are reflections.
constexpr double kPlaneBandM = 0.6;
constexpr int kIterations = 6;
constexpr double kMaxRiseM = 0.5;
constexpr double kMaxReliefM = 1.5;
// Minimum share of low returns in a floor cell; walls and trunks have a few percent.
constexpr double kFlatShare = 0.25;

template <class Number>
double Quantile(Number* begin, Number* end, double share) {
  const auto n = static_cast<std::ptrdiff_t>(share * static_cast<double>(end - begin - 1));
  return static_cast<double>(NthSmallest(begin, end, n));
}

// Returns the place of a cell, which holds all heights.
Voxel CellAt(const Eigen::Vector3f& point_m) {
  const auto number = [](float coordinate_m) {
    return FloorOf(static_cast<double>(coordinate_m) / kGroundCellM);
  };
  return {number(point_m.x()), number(point_m.y()), 0};
}

// Homogeneous: the 1 multiplies the height c0 at the origin.
Eigen::Vector3d MiddleOf(const Voxel& cell) {
  return {1.0, (static_cast<double>(cell.x) + 0.5) * kGroundCellM,
          (static_cast<double>(cell.y) + 0.5) * kGroundCellM};
}

// True if enough of the heights of a cell are no higher than the limit.
bool IsFlat(const float* begin, const float* end, double limit_m) {
  const auto low = std::count_if(begin, end, [&](float height_m) { return height_m < limit_m; });
  return static_cast<double>(low) >= kFlatShare * static_cast<double>(end - begin);
}

// Sorts the heights of a cell. Returns the lowest one from which on a flat share of them lies
// within the thickness of ground; NaN if there is none.
double LowestLayerM(float* begin, float* end) {
  std::sort(begin, end);
  const auto least = static_cast<std::ptrdiff_t>(kFlatShare * static_cast<double>(end - begin));
  for (const float* low = begin; low + least < end; ++low) {
    if (low[least] - *low < kGroundThicknessM) return static_cast<double>(*low);
  }
  return std::numeric_limits<double>::quiet_NaN();
}

// From the station.
double DistanceM(const Voxel& cell) { return MiddleOf(cell).tail<2>().norm(); }

}  // namespace

void Ground::Fit(const PointsView& points_m) {
  SetHeights(points_m);
  // From a bank or a hill most of the view lies lower, on another plane, so a plane of the near
  // cells is tried as well.
  plane_ = PlaneOf(std::numeric_limits<double>::infinity());
  const Plane near = PlaneOf(kNearM);
  if (near.support > kMinSupportRatio * plane_.support) plane_ = near;
  // Ground is seen from above. A plane higher than the station, by more than its roughness, is one
  // of crowns of trees or of lower edges of walls.
  const Eigen::Vector3d& plane = plane_.coefficients;
  const bool is_ground = plane.x() < kPlaneBandM && plane.tail<2>().norm() < max_slope_;
  if (!is_ground) plane_.support = 0.0;
}

void Ground::SetHeights(const PointsView& points_m) {
  numbers_.Clear();
  cells_.clear();
  cell_of_.clear();
  std::uint32_t last = 0;
  for (const Eigen::Vector3f& point_m : points_m) {
    const Voxel at = CellAt(point_m);
    // Most returns lie in the cell of the one before.
    if (cells_.empty() || at.x != cells_[last].at.x || at.y != cells_[last].at.y) {
      last = numbers_.FindOrAdd(0, KeyOf(at));
      if (last == cells_.size()) cells_.push_back({at});
    }
    cell_of_.push_back(last);
  }
  heights_m_.resize(points_m.size());
  SortByGroup(cell_of_, cells_.size(), &begins_,
              [&](std::size_t i, std::uint32_t at) { heights_m_[at] = points_m[i].z(); });
  SetHeightsOutwards();
  known_.clear();
  for (std::uint32_t number = 0; number < cells_.size(); ++number) {
    if (!std::isnan(cells_[number].height_m)) known_.push_back(number);
  }
  // Independent of the order of the points.
  std::sort(known_.begin(), known_.end(), [&](std::uint32_t a, std::uint32_t b) {
    return KeyOf(cells_[a].at) < KeyOf(cells_[b].at);
  });
}

// The nearest cells first, so that flat ground below the station hides what lies behind it: points
// below its horizon are images that a wet ground mirrors. Crowns and walls, which are not flat,
// hide nothing, as sensors see through gaps in them and past them.
void Ground::SetHeightsOutwards() {
  outwards_.resize(cells_.size());
  std::iota(outwards_.begin(), outwards_.end(), 0U);
  std::sort(outwards_.begin(), outwards_.end(), [&](std::uint32_t a, std::uint32_t b) {
    const double a_m = DistanceM(cells_[a].at);
    const double b_m = DistanceM(cells_[b].at);
    return a_m != b_m ? a_m < b_m : KeyOf(cells_[a].at) < KeyOf(cells_[b].at);
  });
  for (const std::uint32_t number : outwards_) {
    Cell& cell = cells_[number];
    const double distance_m = DistanceM(cell.at);
    cell.horizon = HorizonBefore(cell.at);
    const auto lowest_m = static_cast<float>(cell.horizon * distance_m);
    float* const end = heights_m_.data() + begins_[number + 1];
    float* const first = heights_m_.data() + begins_[number];
    float* const begin =
        std::partition(first, end, [&](float height_m) { return height_m < lowest_m; });
    if (end - begin < kMinReturns) continue;
    // Shallow images are above the horizon, which the distance of a cell blurs.
    const bool has_images = begin != first;
    cell.height_m = has_images ? LowestLayerM(begin, end) : Quantile(begin, end, kQuantile);
    if (cell.height_m < 0.0 && IsFlat(begin, end, cell.height_m + kPlaneBandM)) {
      cell.horizon = std::max(cell.horizon, (cell.height_m - kPlaneBandM) / distance_m);
    }
  }
}

// Returns the horizon of the next cell on the way to the station that holds points.
double Ground::HorizonBefore(const Voxel& at) const {
  const Eigen::Vector2d middle_m = MiddleOf(at).tail<2>();
  const double distance_m = middle_m.norm();
  for (double before_m = distance_m - kGroundCellM; before_m > 0.0; before_m -= kGroundCellM) {
    const Eigen::Vector2f before = (before_m / distance_m * middle_m).cast<float>();
    const std::uint32_t number = numbers_.Find(0, KeyOf(CellAt({before.x(), before.y(), 0.0F})));
    if (number != VoxelNumbers::kNone) return cells_[number].horizon;
  }
  return -std::numeric_limits<double>::infinity();
}

// Iterated least squares: first on the lower half of the cells within `reach_m`, then on all cells
// within the band of the plane.
Ground::Plane Ground::PlaneOf(double reach_m) {
  inliers_.clear();
  lowest_m_.clear();
  for (const std::uint32_t number : known_) {
    if (DistanceM(cells_[number].at) > reach_m) continue;
    inliers_.push_back(number);
    lowest_m_.push_back(cells_[number].height_m);
  }
  Plane plane;
  if (lowest_m_.size() < kMinCells) return plane;
  const double median_m = Quantile(lowest_m_.data(), lowest_m_.data() + lowest_m_.size(), 0.5);
  EraseIf(&inliers_, [&](std::uint32_t number) { return cells_[number].height_m > median_m; });
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    if (!Refit(kPlaneBandM, &plane)) return plane;
  }
  plane.support = SupportOf();
  return plane;
}

bool Ground::Refit(double band_m, Plane* plane) {
  if (inliers_.size() < kMinCells) return false;
  // Triangular factor of the QR decomposition, augmented by the right-hand side, cell by cell.
  Eigen::Matrix4d triangle = Eigen::Matrix4d::Zero();
  for (const std::uint32_t number : inliers_) {
    triangle.row(3) << MiddleOf(cells_[number].at).transpose(), cells_[number].height_m;
    for (Eigen::Index k = 0; k < 3; ++k) {
      Eigen::JacobiRotation<double> givens;
      givens.makeGivens(triangle(k, k), triangle(3, k));
      triangle.applyOnTheLeft(k, 3, givens.adjoint());
    }
  }
  plane->coefficients = triangle.topLeftCorner<3, 3>().colPivHouseholderQr().solve(
      triangle.topRightCorner<4, 1>().head<3>());
  SetInliers(band_m, *plane);
  return true;
}

void Ground::SetInliers(double band_m, const Plane& plane) {
  inliers_.clear();
  for (const std::uint32_t number : known_) {
    const Cell& cell = cells_[number];
    if (std::abs(cell.height_m - plane.coefficients.dot(MiddleOf(cell.at))) < band_m) {
      inliers_.push_back(number);
    }
  }
}

double Ground::SupportOf() const {
  double support = 0.0;
  for (const std::uint32_t number : inliers_) {
    const double share = kNearM / std::max(kNearM, DistanceM(cells_[number].at));
    support += share * share;
  }
  return support;
}

// The band narrows in steps: among walls and objects the first plane is off by more than band_m.
double Ground::FlatSupport(double band_m) {
  if (plane_.support == 0.0) return 0.0;
  Plane plane = plane_;
  double step_m = kPlaneBandM;
  SetInliers(step_m, plane);
  while (step_m > band_m) {
    step_m = std::max(band_m, 0.5 * step_m);
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      if (!Refit(step_m, &plane)) return 0.0;
    }
  }
  const double rise_m = band_m + plane.coefficients.tail<2>().norm() * kGroundCellM;
  EraseIf(&inliers_, [&](std::uint32_t number) {
    return !IsFlat(heights_m_.data() + begins_[number], heights_m_.data() + begins_[number + 1],
                   cells_[number].height_m + rise_m);
  });
  return SupportOf();
}

double Ground::HeightAbove(const Eigen::Vector3f& point_m) const {
  if (plane_.support == 0.0) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d p = point_m.cast<double>();
  double ground_m = plane_.coefficients.dot(Eigen::Vector3d(1.0, p.x(), p.y()));
  const std::uint32_t number = numbers_.Find(0, KeyOf(CellAt(point_m)));
  if (number != VoxelNumbers::kNone) {
    const double height_m = cells_[number].height_m;  // NaN fails the comparison
    if (std::abs(height_m - ground_m) < kMaxReliefM) {
      ground_m = std::min(height_m, ground_m + kMaxRiseM);
    }
  }
  return p.z() - ground_m;
}

}  // namespace unlidar
