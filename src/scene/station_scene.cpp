#include "scene/station_scene.hpp"

#include <algorithm>
#include <functional>
#include <utility>

namespace unlidar {
namespace {

constexpr std::size_t kElevationReturns = 100'000;

}  // namespace

StationScene::StationScene(const RobustConfig& config)
    : config_(&config), occupancy_(config.background, config.Uses(Rule::kStrays)) {}

void StationScene::Learn(PointsView points_m, std::int64_t bin, const CarrierPose& carrier) {
  occupancy_.AddFrame(points_m, bin, carrier);
  if (is_fitted()) return;
  const std::size_t count = std::min(points_m.size(), kElevationReturns - first_returns_m_.size());
  for (std::size_t i = 0; i < count; ++i) first_returns_m_.push_back(points_m[i] - carrier.shift_m);
}

void StationScene::Fit(FitWorkspace* workspace) {
  if (!is_fitted()) {
    occupancy_.JudgeAll();
    fitted_ = std::make_unique<Fitted>(*config_);
  }
  if (!first_returns_m_.empty()) {
    lowest_elevation_rad_ = LowestElevationRad(std::exchange(first_returns_m_, {}));
  }
  auto& [points_m, ground, support] = *workspace;
  occupancy_.GetStructure(&points_m);
  fitted_->ground.Fit(points_m, &ground);
  occupancy_.GetSupporters(&points_m);
  fitted_->support.Fill(points_m, occupancy_.field_of_view().Edges(), &support);
  ++num_fits_;
}

FramePlots& StationScene::FindPlots(std::int64_t bin, const Occupancy::IsTargetSince& is_target,
                                    FrameWorkspace* workspace) {
  auto& [frame, plotter, verdicts, candidates, num_unexplained] = *workspace;
  const Occupancy::FloatsIn floats = [&](const Eigen::Vector3f& point_m) {
    return fitted_->support.IsFloating(point_m);
  };
  candidates.clear();
  std::vector<Eigen::Vector3f>& points_m = frame.points_m;
  occupancy_.Judge(points_m, bin, num_fits_, floats, is_target, &verdicts);
  for (std::uint32_t i = 0; i < points_m.size(); ++i) {
    // Static objects in the air look like structure if present throughout. Distant ground is hit
    // too seldom to be structure.
    if (verdicts[i].is_structure && !verdicts[i].floats) continue;
    if (!fitted_->ground.IsGround(points_m[i])) candidates.push_back(i);
  }
  num_unexplained = candidates.size();
  const Eigen::Vector3f shift_m = frame.frames[0].carrier.shift_m;
  for (Eigen::Vector3f& point_m : points_m) point_m -= shift_m;
  const auto stray_rate_at = [&](const Eigen::Vector3f& point_m) {
    return occupancy_.StrayRate(point_m + shift_m);
  };
  FramePlots& found = plotter.Find(frame, 0, &candidates, fitted_->ground, lowest_elevation_rad_,
                                   std::cref(stray_rate_at), *config_);
  for (std::size_t p = 0; p < found.plots.size(); ++p) {
    Plot& plot = found.plots[p];
    double rate = 0.0;
    for (const std::uint32_t i : plotter.ReturnsOf(p)) {
      rate += static_cast<double>(verdicts[i].place_rate);
      plot.has_structure = plot.has_structure || verdicts[i].is_structure;
    }
    plot.place_rate = rate / static_cast<double>(plot.num_returns);
    plot.position_m += shift_m.cast<double>();
  }
  for (BodyBox& body : found.bodies) {
    body.low_m += shift_m.array();
    body.high_m += shift_m.array();
  }
  return found;
}

}  // namespace unlidar
