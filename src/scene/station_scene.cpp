#include "scene/station_scene.hpp"

#include <algorithm>
#include <functional>
#include <utility>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

constexpr std::size_t kElevationReturns = 100'000;
// Rays so far above the bottom of a column may still pass below a car, or end at its wheels as if
// at the ground, whose height is known no better.
constexpr double kFootM = 0.1;

// True if only strays make the place of a return look like structure.
bool IsAmongDenseStrays(const Occupancy::Verdict& verdict) {
  return verdict.stray_rate > 0.0F && !verdict.floats;
}

}  // namespace

StationScene::StationScene(const RobustConfig& config)
    : config_(&config),
      occupancy_(config.background, config.Uses(Rule::kStrays)),
      support_(Ground(), config.support) {}

void StationScene::Learn(PointsView points_m, std::int64_t bin, const CarrierPose& carrier,
                         OwnVoxels* voxels) {
  occupancy_.AddFrame(points_m, bin, carrier, voxels);
  watched_.AddFrame(points_m, carrier);
  sight_density_.AddFrame(points_m, carrier);
  if (is_fitted()) return;
  const std::size_t count = std::min(points_m.size(), kElevationReturns - first_returns_m_.size());
  for (std::size_t i = 0; i < count; ++i) first_returns_m_.push_back(points_m[i] - carrier.shift_m);
}

void StationScene::Fit() {
  if (!is_fitted()) occupancy_.JudgeAll();
  if (!first_returns_m_.empty()) {
    lowest_elevation_rad_ = LowestElevationRad(std::exchange(first_returns_m_, {}));
  }
  FitGround();
  FillSupport();
}

void StationScene::FitGround() {
  occupancy_.GetStructure(&structure_m_);
  support_.FitGround(structure_m_);
}

void StationScene::FillSupport() {
  occupancy_.GetSupporters(&structure_m_, &are_lasting_);
  support_.Fill(structure_m_, are_lasting_, occupancy_.field_of_view().Edges());
  watched_.Update();
  sight_density_.Update();
  ++num_fits_;
}

FramePlots& StationScene::FindPlots(std::int64_t bin, const OwnVoxels& voxels,
                                    const Occupancy::IsTargetSince& is_target, Recording* frame) {
  const Occupancy::FloatsIn floats = [&](const Eigen::Vector3f& point_m) {
    return support_.IsFloating(point_m);
  };
  const bool keeps_stray_groups = config_->Uses(Rule::kStrayGroups);
  candidates_.clear();
  std::vector<Eigen::Vector3f>& points_m = frame->points_m;
  occupancy_.Judge(points_m, bin, voxels, num_fits_, floats, is_target, &verdicts_);
  for (std::uint32_t i = 0; i < points_m.size(); ++i) {
    // Static objects in the air look like structure if present throughout. Distant ground is hit
    // too seldom to be structure.
    if (verdicts_[i].is_structure && !verdicts_[i].floats &&
        !(keeps_stray_groups && IsAmongDenseStrays(verdicts_[i]))) {
      continue;
    }
    if (!support_.ground().IsGround(points_m[i])) candidates_.push_back(i);
  }
  // Ranges, with which radii grow, are those from the present place of the LiDAR from here on.
  const CarrierPose& carrier = frame->frames[0].carrier;
  const Eigen::Vector3f shift_m = carrier.shift_m;
  if (shift_m != Eigen::Vector3f::Zero()) {
    for (Eigen::Vector3f& point_m : points_m) point_m -= shift_m;
  }
  DropStrays(points_m);
  num_unexplained_ = candidates_.size();
  const auto stray_rate_at = [&](const Eigen::Vector3f& point_m) {
    return occupancy_.StrayRateIn(point_m + shift_m, bin);
  };
  FramePlots& found = plotter_.Find(*frame, 0, &candidates_, support_.ground(),
                                    {lowest_elevation_rad_, occupancy_.field_of_view().LowestRad()},
                                    std::cref(stray_rate_at), *config_);
  for (std::size_t p = 0; p < found.plots.size(); ++p) {
    Plot& plot = found.plots[p];
    SetPlaceRate(ReturnsOf(p), &plot);
    SetWatched(carrier, &plot);
    SetAboveStructure(shift_m, &plot);
    plot.position_m += shift_m.cast<double>();
  }
  for (BodyBox& body : found.bodies) body = body.Moved(shift_m);
  return found;
}

// Where strays are dense, a lone return is one of them. A group larger than strays form by chance
// is something else: such groups are as rare as lone strays in thin air.
void StationScene::DropStrays(const std::vector<Eigen::Vector3f>& points_m) {
  const auto is_dense = [&](std::uint32_t i) { return IsAmongDenseStrays(verdicts_[i]); };
  if (std::none_of(candidates_.begin(), candidates_.end(), is_dense)) return;
  const RangeRadius& link = config_->plots.link;
  are_strays_.assign(points_m.size(), 0);
  linker_.Link(points_m, candidates_, link);
  for (std::size_t g = 0; g < linker_.size(); ++g) {
    const IndexView group = linker_[g];
    const double radius_m = link.At(static_cast<double>(points_m[group.front()].norm()));
    const auto count = static_cast<double>(group.size());
    if (StrayGroupRate(MeanStrayRate(group), radius_m, count) < kMaxStrayRate) continue;
    for (const std::uint32_t i : group) are_strays_[i] = is_dense(i) ? 1 : 0;
  }
  EraseIf(&candidates_, [&](std::uint32_t i) { return are_strays_[i] != 0; });
}

double StationScene::MeanStrayRate(const IndexView& returns) const {
  const auto count = static_cast<double>(returns.size());
  double rate = 0.0;
  for (const std::uint32_t i : returns) {
    const Occupancy::Verdict& verdict = verdicts_[i];
    rate += static_cast<double>(std::max(verdict.stray_rate, verdict.place_rate)) / count;
  }
  return rate;
}

void StationScene::SetWatched(const CarrierPose& carrier, Plot* plot) const {
  const Eigen::Matrix3d to_carrier = carrier.rotation.conjugate().toRotationMatrix().cast<double>();
  plot->beam_step_m = static_cast<float>(watched_.BeamStepM(to_carrier * plot->ray_m));
  plot->sights_per_sr = static_cast<float>(sight_density_.PerSr());
  if (plot->column_m <= kBelowPlotM) return;
  const auto share_between = [&](double low_m, double high_m) {
    return watched_.Share(to_carrier * (plot->ray_m + low_m * Eigen::Vector3d::UnitZ()),
                          to_carrier * (plot->ray_m + high_m * Eigen::Vector3d::UnitZ()));
  };
  const double own = share_between(-kBodyPartM / 2, kBodyPartM / 2);
  const double low_m = kFootM - plot->column_m;
  const double below = low_m < -kBelowPlotM ? share_between(low_m, -kBelowPlotM) : 0.0;
  plot->watched_below = static_cast<float>(below < own ? below / own : (below > 0.0 ? 1.0 : 0.0));
}

// Structure may carry what is no higher above it than people and vehicles are above the ground.
// Nobody walks on what is lower than people are: hedges, fences and cars.
void StationScene::SetAboveStructure(const Eigen::Vector3f& shift_m, Plot* plot) const {
  const double most_m = config_->off_ground_m;
  if (!config_->Uses(Rule::kOnStructure) || plot->lowest_m <= most_m) return;
  const Eigen::Vector3f place_m = plot->position_m.cast<float>() + shift_m;
  const double radius_m = kColumnRadius.At(plot->ray_m.norm());
  const double height_m =
      std::min(support_.HeightAboveStructureM(place_m, radius_m, kBelowPlotM, most_m),
               support_.HeightAboveEdgeM(place_m, kBelowPlotM, kEdgeClearM));
  plot->is_above_structure = plot->lowest_m - height_m > most_m;
}

void StationScene::SetPlaceRate(const IndexView& returns, Plot* plot) const {
  double rate = 0.0;
  bool is_among_dense_strays = false;
  for (const std::uint32_t i : returns) {
    const Occupancy::Verdict& verdict = verdicts_[i];
    rate += static_cast<double>(verdict.place_rate);
    is_among_dense_strays = is_among_dense_strays || IsAmongDenseStrays(verdict);
    plot->has_structure =
        plot->has_structure || (verdict.is_structure && !IsAmongDenseStrays(verdict));
  }
  plot->place_rate = rate / static_cast<double>(plot->num_returns);
  if (!is_among_dense_strays) return;
  const double stray_rate = MeanStrayRate(returns);
  const double radius_m = config_->plots.link.At(plot->ray_m.norm());
  const auto count = static_cast<double>(returns.size());
  plot->place_rate = StrayGroupRate(stray_rate, radius_m, count);
  plot->stray_group_rate =
      static_cast<float>(RareStrayGroupRate(stray_rate, radius_m, kMaxStrayRate));
}

}  // namespace unlidar
