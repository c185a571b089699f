#include "scene/field_of_view.hpp"

#include <utility>

namespace unlidar {
namespace {

constexpr float kNoneSeen = 2.0F;  // initial value, outside the range of a sine
// Beams of one ring or edge agree within some hundredths of a degree. The edge of a flat roof
// leaves this band within a few columns, because its elevation rises where it is nearer.
constexpr double kSharpRad = 0.15 * M_PI / 180.0;
// Of a carrier that moves: it turns within a frame, and its poses have noise.
constexpr double kSharpOfMovingRad = 0.4 * M_PI / 180.0;
constexpr std::ptrdiff_t kMinColumns = 8;
constexpr float kAlikeRad = 0.02F;  // attitudes that tilt less than this apart are one
constexpr std::size_t kMaxAttitudes = 64;
// A carrier that moves less is at rest: the noise of its poses is as large, or it is a mast that
// sways, from which nearly the same is seen and hidden throughout.
constexpr float kMaxRestM = 0.05F;
constexpr float kMaxRestRad = 2.2F * static_cast<float>(M_PI) / 180.0F;

}  // namespace

FieldOfView::FieldOfView() : lowest_(kNoneSeen), highest_(-kNoneSeen), sharp_rad_(kSharpRad) {
  lowest_of_.fill(lowest_);
  highest_of_.fill(highest_);
}

void FieldOfView::AddFrame(PointsView points_m, const CarrierPose& carrier) {
  if (!std::exchange(has_begun_, true)) first_carrier_ = carrier;
  is_carrier_moving_ = is_carrier_moving_ ||
                       (carrier.shift_m - first_carrier_.shift_m).norm() > kMaxRestM ||
                       first_carrier_.rotation.angularDistance(carrier.rotation) > kMaxRestRad;
  if (carrier.rotation.angularDistance(Eigen::Quaternionf::Identity()) > 0.0F) {
    sharp_rad_ = kSharpOfMovingRad;
  }
  const Eigen::Vector3f up = carrier.rotation * Eigen::Vector3f::UnitZ();
  const auto is_alike = [&](const Eigen::Vector3f& other) {
    return (up - other).norm() < kAlikeRad;
  };
  if (ups_.size() < kMaxAttitudes && std::none_of(ups_.begin(), ups_.end(), is_alike)) {
    ups_.push_back(up);
  }
  const Eigen::Matrix3f to_carrier = carrier.rotation.conjugate().toRotationMatrix();
  for (std::size_t i = 0; i < points_m.size(); ++i)
    Add(to_carrier * (points_m[i] - carrier.shift_m));
}

bool FieldOfView::Contains(const Eigen::Vector3f& ray_m) const {
  const float sine = ray_m.z() / ray_m.norm();
  return lowest_ <= sine && sine <= highest_ && columns_[AzimuthColumn(ray_m)];
}

void FieldOfView::Add(const Eigen::Vector3f& ray_m) {
  if (is_carrier_moving_) columns_[AzimuthColumn(ray_m)] = true;
  const float sine = ray_m.z() / ray_m.norm();
  lowest_ = std::min(lowest_, sine);
  highest_ = std::max(highest_, sine);
  // Conservative: angles differ by at least as much as their sines.
  const auto sharp = static_cast<float>(sharp_rad_);
  if (sine > lowest_ + sharp && sine < highest_ - sharp) return;
  const std::size_t column = AzimuthColumn(ray_m);
  lowest_of_[column] = std::min(lowest_of_[column], sine);
  highest_of_[column] = std::max(highest_of_[column], sine);
}

double FieldOfView::LowestRad() const {
  return lowest_ == kNoneSeen ? 0.0 : std::asin(static_cast<double>(lowest_));
}

ElevationRange FieldOfView::Edges() const {
  ElevationRange edges;
  const bool is_level = ups_.size() == 1 && ups_[0] == Eigen::Vector3f::UnitZ();
  if (!is_level) edges.ups = ups_;
  if (highest_ < lowest_) return edges;
  const auto elevation_rad = [](float sine) { return std::asin(static_cast<double>(sine)); };
  const auto is_sharp = [&](const std::array<float, kAzimuthColumns>& sines, float edge) {
    return std::count_if(sines.begin(), sines.end(), [&](float sine) {
             return std::abs(sine) < kNoneSeen &&
                    std::abs(elevation_rad(sine) - elevation_rad(edge)) < sharp_rad_;
           }) >= kMinColumns;
  };
  if (is_sharp(lowest_of_, lowest_)) edges.lowest_rad = elevation_rad(lowest_);
  if (is_sharp(highest_of_, highest_)) edges.highest_rad = elevation_rad(highest_);
  return edges;
}

double LowestElevationRad(const std::vector<Eigen::Vector3f>& points_m) {
  constexpr double kShare = 0.01;
  std::vector<float> sines(points_m.size());
  for (std::size_t i = 0; i < sines.size(); ++i) sines[i] = points_m[i].z() / points_m[i].norm();
  const auto k = static_cast<std::ptrdiff_t>(kShare * static_cast<double>(sines.size()));
  std::nth_element(sines.begin(), sines.begin() + k, sines.end());
  return std::asin(static_cast<double>(sines[static_cast<std::size_t>(k)]));
}

}  // namespace unlidar
