#include "scene/up_direction.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace unlidar {
namespace {

constexpr TimeNs kCollectNs = 5'000'000'000;
constexpr std::size_t kMaxPointsOfFrame = 1024;
constexpr std::size_t kMaxPoints = 40'000;
constexpr std::size_t kMinPoints = 500;
// Steeper than any ground, so that directions 45 degrees apart cover every orientation.
constexpr double kMaxGroundSlope = 0.5;
constexpr float kRoughM = 1.0F;  // exceeds the roughness of ground
// Objects stand on ground; a plane without any may be a wall.
constexpr double kMinShareAbove = 0.1;
// Cells, and ratio of ground to that of z, required of another direction. With z up, other
// directions have at most 0.53 of the ground of z.
constexpr double kMinGroundCells = 20.0;
constexpr double kMinGroundRatio = 2.0;
// A floor is flat and at most the height of a hall below. In a hall or under a roof, a visible
// floor has at least 4 cells; outdoor scenes turned upside down have at most 0.2. A LiDAR on its
// side may mistake a facade for a floor.
constexpr double kMaxFloorSlope = 0.2;
constexpr double kFloorBandM = 0.1;
constexpr double kMinFloorCells = 4.0;
constexpr double kMaxFloorDepthM = 15.0;

}  // namespace

UpDirection::UpDirection() : ground_(kMaxGroundSlope) {
  directions_.emplace_back(Eigen::Vector3f::UnitZ());
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const bool is_z = x == 0 && y == 0 && z >= 0;
        if (is_z) continue;
        directions_.push_back(Eigen::Vector3i(x, y, z).cast<float>().normalized());
      }
    }
  }
}

void UpDirection::AddFrame(TimeNs time_ns, PointsView points_m, const Eigen::Vector3f& origin_m) {
  if (IsDone()) return;
  if (points_m.size() > 0 && !begin_ns_) begin_ns_ = time_ns;
  const bool is_over =
      begin_ns_ && time_ns - *begin_ns_ >= kCollectNs && points_m_.size() >= kMinPoints;
  if (is_over || points_m_.size() >= kMaxPoints) return TestNext();
  const std::size_t step = std::max<std::size_t>(1, points_m.size() / kMaxPointsOfFrame);
  for (std::size_t i = 0; i < points_m.size(); i += step) {
    points_m_.push_back(points_m[i] - origin_m);
  }
}

void UpDirection::Finish() {
  while (!IsDone()) TestNext();
}

UpDirection::Evidence UpDirection::EvidenceOf(const Eigen::Vector3f& up, double min_cells) {
  const Eigen::Matrix3f rotation =
      Eigen::Quaternionf::FromTwoVectors(up, Eigen::Vector3f::UnitZ()).toRotationMatrix();
  rotated_m_.clear();
  for (const Eigen::Vector3f& point_m : points_m_) rotated_m_.push_back(rotation * point_m);
  ground_.Fit(rotated_m_);
  Evidence evidence;
  if (ground_.support() < min_cells) return evidence;
  double above = 0.0;
  double below = 0.0;
  for (const Eigen::Vector3f& point_m : rotated_m_) {
    const double height_m = ground_.HeightAbove(point_m);
    above += height_m > kRoughM ? 1.0 : 0.0;
    below += height_m < -kRoughM ? 1.0 : 0.0;
  }
  const auto all = static_cast<double>(points_m_.size());
  evidence.ground = ground_.support() * (all - above - below) / all * (all - below) / all;
  if (below > above) evidence.ground *= above / below;  // objects hang from it: a ceiling
  evidence.has_objects_above = above >= kMinShareAbove * all;
  return evidence;
}

bool UpDirection::HasFloor() {
  rotated_m_.clear();
  for (const Eigen::Vector3f& point_m : points_m_) {
    if (point_m.z() < -static_cast<float>(kGroundThicknessM)) rotated_m_.push_back(point_m);
  }
  Ground floor(kMaxFloorSlope);
  floor.Fit(rotated_m_);
  return floor.FlatSupport(kFloorBandM) >= kMinFloorCells && floor.height_m() > -kMaxFloorDepthM;
}

void UpDirection::TestNext() {
  const auto finish = [&] {
    step_ = std::numeric_limits<std::size_t>::max();
    points_m_ = {};
    rotated_m_ = {};
  };
  if (points_m_.size() < kMinPoints || (step_ == 0 && HasFloor())) return finish();
  if (step_ == 1) {
    best_ground_ = kMinGroundRatio * EvidenceOf(directions_.front(), 0.0).ground;
  } else if (step_ > 1) {
    const Eigen::Vector3f& up = directions_[step_ - 1];
    const Evidence evidence = EvidenceOf(up, std::max(kMinGroundCells, best_ground_));
    if (evidence.has_objects_above && evidence.ground > best_ground_) {
      best_ground_ = evidence.ground;
      best_up_ = up;
    }
  }
  if (++step_ > directions_.size()) finish();
}

}  // namespace unlidar
