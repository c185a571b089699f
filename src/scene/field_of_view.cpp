#include "scene/field_of_view.hpp"

#include <algorithm>

#include "base/angles.hpp"

namespace unlidar {
namespace {

constexpr float kNoneSeen = 2.0F;  // initial value, outside the range of a sine
// Beams of one ring or edge agree within some hundredths of a degree. The edge of a flat roof
// leaves this band within a few columns, because its elevation rises where it is nearer.
constexpr double kSharpRad = 0.15 * M_PI / 180.0;
constexpr std::ptrdiff_t kMinColumns = 8;

}  // namespace

FieldOfView::FieldOfView() : lowest_(kNoneSeen), highest_(-kNoneSeen) {
  lowest_of_.fill(lowest_);
  highest_of_.fill(highest_);
}

void FieldOfView::Add(const Eigen::Vector3f& point_m) {
  const float sine = point_m.z() / point_m.norm();
  lowest_ = std::min(lowest_, sine);
  highest_ = std::max(highest_, sine);
  // Conservative: angles differ by at least as much as their sines.
  const auto sharp = static_cast<float>(kSharpRad);
  if (sine > lowest_ + sharp && sine < highest_ - sharp) return;
  const double turns = (AzimuthRad(point_m) + M_PI) / (2.0 * M_PI);
  const std::size_t column =
      std::min(static_cast<std::size_t>(turns * static_cast<double>(kNumColumns)), kNumColumns - 1);
  lowest_of_[column] = std::min(lowest_of_[column], sine);
  highest_of_[column] = std::max(highest_of_[column], sine);
}

ElevationRange FieldOfView::Edges() const {
  ElevationRange edges;
  if (highest_ < lowest_) return edges;
  const auto elevation_rad = [](float sine) { return std::asin(static_cast<double>(sine)); };
  const auto is_sharp = [&](const std::array<float, kNumColumns>& sines, float edge) {
    return std::count_if(sines.begin(), sines.end(), [&](float sine) {
             return std::abs(sine) < kNoneSeen &&
                    std::abs(elevation_rad(sine) - elevation_rad(edge)) < kSharpRad;
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
