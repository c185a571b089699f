#include "scene/support.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/algorithms.hpp"
#include "base/voxel_grid.hpp"

namespace unlidar {
namespace {

constexpr double kCellM = 2.0;
// Upper limit of the height of ground vehicles: lorries and buses reach 4.5 m.
constexpr double kMaxGroundVehicleHeightM = 5.0;

// Orders points, so that the choice of one per voxel does not depend on their sequence.
bool IsBefore(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

}  // namespace

DepthMap::DepthMap() : medians_m_(DirectionCells::kCount, std::numeric_limits<float>::infinity()) {
  const auto angle_of = [](double rad) { return Angle{rad, std::cos(rad), std::sin(rad)}; };
  for (std::size_t row = 0; row < DirectionCells::kRows; ++row) {
    elevations_.push_back(angle_of(DirectionCells::RowRad(row)));
  }
  for (std::size_t column = 0; column < DirectionCells::kColumns; ++column) {
    azimuths_.push_back(angle_of(DirectionCells::ColumnRad(column)));
  }
}

void DepthMap::Fill(const PointsView& points_m) {
  cell_of_.resize(points_m.size());
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    cell_of_[i] = static_cast<std::uint32_t>(DirectionCells::CellOf(points_m[i]));
  }
  ranges_m_.resize(points_m.size());
  SortByGroup(cell_of_, medians_m_.size(), &begins_,
              [&](std::size_t i, std::uint32_t at) { ranges_m_[at] = points_m[i].norm(); });
  for (std::size_t cell = 0; cell < medians_m_.size(); ++cell) {
    float* const begin = ranges_m_.data() + begins_[cell];
    float* const end = ranges_m_.data() + begins_[cell + 1];
    medians_m_[cell] = begin == end ? std::numeric_limits<float>::infinity()
                                    : NthSmallest(begin, end, (end - begin) / 2);
  }
}

double DepthMap::HiddenShare(const Eigen::Vector3f& place_m, double radius_m, double margin_m,
                             const ElevationRange& view) const {
  const auto range_m = static_cast<double>(place_m.norm());
  const Eigen::Vector3d towards = place_m.cast<double>() / range_m;
  const double radius_rad = std::atan2(radius_m, range_m);
  const double min_cosine = std::cos(radius_rad);
  const double elevation_rad = std::asin(towards.z());
  double all = 0.0;
  double hidden = 0.0;
  const auto is_hidden = [&](std::size_t cell) {
    return static_cast<double>(medians_m_[cell]) < range_m - margin_m;
  };
  for (std::size_t row = 0; row < elevations_.size(); ++row) {
    const Angle& elevation = elevations_[row];
    if (std::abs(elevation.rad - elevation_rad) > radius_rad) continue;
    const double weight = elevation.cosine;  // cells are narrower towards the zenith
    for (std::size_t column = 0; column < azimuths_.size(); ++column) {
      const Angle& azimuth = azimuths_[column];
      const Eigen::Vector3d cell(weight * azimuth.cosine, weight * azimuth.sine, elevation.sine);
      if (cell.dot(towards) < min_cosine) continue;
      all += weight;
      if (!view.Contains(cell, elevation.rad) || is_hidden(row * azimuths_.size() + column)) {
        hidden += weight;
      }
    }
  }
  // A neighbourhood narrower than a cell: use the cell of the place.
  if (all == 0.0) return is_hidden(DirectionCells::CellOf(place_m)) ? 1.0 : 0.0;
  return hidden / all;
}

Support::Support(Ground ground, const SupportConfig& config)
    : ground_(std::move(ground)), config_(config) {}

void Support::Fill(const PointsView& supports_m, const std::vector<char>& are_lasting,
                   const ElevationRange& view) {
  view_ = view;
  depth_.Fill(supports_m);
  seen_.Clear();
  thinned_m_.clear();
  cell_of_.clear();
  lasts_.clear();
  cells_.Clear();
  for (std::size_t i = 0; i < supports_m.size(); ++i) {
    const Eigen::Vector3f& point_m = supports_m[i];
    const std::uint32_t number = seen_.FindOrAdd(0, VoxelOf(point_m, kSupportVoxelM));
    if (number < thinned_m_.size()) {
      if (IsBefore(point_m, thinned_m_[number])) thinned_m_[number] = point_m;  // in the same cell
      if (are_lasting[i] != 0) lasts_[number] = 1;
      continue;
    }
    thinned_m_.push_back(point_m);
    lasts_.push_back(are_lasting[i]);
    cell_of_.push_back(cells_.FindOrAdd(0, VoxelOf(point_m, kCellM)));
  }
  points_m_.resize(thinned_m_.size());
  are_lasting_.resize(thinned_m_.size());
  SortByGroup(cell_of_, cells_.size(), &first_, [&](std::size_t i, std::uint32_t at) {
    points_m_[at] = thinned_m_[i];
    are_lasting_[at] = lasts_[i];
  });
  lasting_m_.clear();
  for (std::size_t i = 0; i < points_m_.size(); ++i) {
    if (are_lasting_[i] != 0) lasting_m_.push_back(points_m_[i]);
  }
  lasting_depth_.Fill(lasting_m_);
}

// A transient object high above a known ground did not arrive on the ground, so that no hidden or
// poorly observed distant support can hold it.
bool Support::ArrivedByAir(const Eigen::Vector3f& place_m, bool is_transient) const {
  if (!is_transient) return false;
  const double height_m = ground_.HeightAbove(place_m);
  return std::isfinite(height_m) && height_m > kMaxGroundVehicleHeightM;
}

double Support::ReachM(const Eigen::Vector3f& place_m, bool is_transient) const {
  const auto range_m = static_cast<double>(place_m.norm());
  return ArrivedByAir(place_m, is_transient) ? config_.reach.At(range_m)
                                             : SupportReachM(range_m, config_);
}

double Support::HeightAboveStructureM(const Eigen::Vector3f& place_m, double radius_m,
                                      double least_m, double most_m) const {
  const auto radius = static_cast<float>(radius_m);
  const auto least = static_cast<float>(least_m);
  const auto most = static_cast<float>(most_m);
  float height = std::numeric_limits<float>::infinity();
  const Voxel low = VoxelAt(place_m - Eigen::Vector3f(radius, radius, most), kCellM);
  const Voxel high = VoxelAt(place_m + Eigen::Vector3f(radius, radius, -least), kCellM);
  for (std::int64_t x = low.x; x <= high.x; ++x) {
    for (std::int64_t y = low.y; y <= high.y; ++y) {
      for (std::int64_t z = low.z; z <= high.z; ++z) {
        const std::uint32_t cell = cells_.Find(0, KeyOf({x, y, z}));
        if (cell == VoxelNumbers::kNone) continue;
        for (std::uint32_t i = first_[cell]; i < first_[cell + 1]; ++i) {
          if (are_lasting_[i] == 0) continue;
          const Eigen::Vector3f down_m = place_m - points_m_[i];
          if (down_m.z() < least || down_m.z() > most) continue;
          if (down_m.head<2>().norm() <= radius) height = std::min(height, down_m.z());
        }
      }
    }
  }
  return static_cast<double>(height);
}

double Support::HeightAboveEdgeM(const Eigen::Vector3f& place_m, double least_m,
                                 double most_m) const {
  constexpr double kStepM = 0.2;
  for (double height_m = least_m; height_m <= most_m; height_m += kStepM) {
    const Eigen::Vector3f low_m = place_m - static_cast<float>(height_m) * Eigen::Vector3f::UnitZ();
    const float edge_range_m = lasting_depth_.MedianM(low_m);
    const float low_range_m = low_m.norm();
    const auto nearer_m = static_cast<double>(low_range_m - edge_range_m);
    if (nearer_m < kObjectRadiusM || nearer_m > kEdgeReachM) continue;
    const float edge_z_m = low_m.z() * edge_range_m / low_range_m;
    if (static_cast<double>(place_m.z() - edge_z_m) <= most_m) return height_m;
  }
  return std::numeric_limits<double>::infinity();
}

bool Support::IsFloating(const Eigen::Vector3f& place_m, bool is_transient) const {
  const auto range_m = static_cast<double>(place_m.norm());
  if (range_m > config_.max_range_m) return false;
  // Both the station itself and the ground may be the support.
  const double nearest_m = std::min(range_m, ground_.HeightAbove(place_m));
  const auto reach_m = static_cast<float>(ReachM(place_m, is_transient));
  if (nearest_m < static_cast<double>(reach_m)) return false;
  const auto body_m = static_cast<float>(kObjectRadiusM);
  const auto supports = [&](const Eigen::Vector3f& structure_m) {
    const float distance_m = (structure_m - place_m).norm();
    return distance_m > body_m && distance_m < reach_m;
  };
  const Voxel home = VoxelAt(place_m, kCellM);
  // Rings are searched from near to far: most places are next to structure and return early.
  const auto last_ring =
      static_cast<std::int64_t>(std::ceil(static_cast<double>(reach_m) / kCellM));
  for (std::int64_t ring = 0; ring <= last_ring; ++ring) {
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        const bool is_edge = std::abs(dx) == ring || std::abs(dy) == ring;
        const std::int64_t step = is_edge || ring == 0 ? 1 : 2 * ring;
        for (std::int64_t dz = -ring; dz <= ring; dz += step) {
          const std::uint32_t cell = cells_.Find(0, KeyOf({home.x + dx, home.y + dy, home.z + dz}));
          if (cell == VoxelNumbers::kNone) continue;
          const Eigen::Vector3f* const points_m = points_m_.data();
          if (std::any_of(points_m + first_[cell], points_m + first_[cell + 1], supports)) {
            return false;
          }
        }
      }
    }
  }
  // A support may be hidden or outside the field of view.
  return ArrivedByAir(place_m, is_transient) ||
         depth_.HiddenShare(place_m, SupportReachM(range_m, config_), kObjectRadiusM, view_) <=
             kMaxHiddenShare;
}

}  // namespace unlidar
