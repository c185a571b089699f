#include "scene/multi_station_plots.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <type_traits>
#include <utility>

#include "scene/field_of_view.hpp"
#include "scene/floating.hpp"
#include "scene/ground.hpp"
#include "scene/scene_frames.hpp"
#include "scene/support.hpp"

namespace unlidar {
namespace {

// Plots of one station, relative to its viewpoint.
struct StationPlots {
  std::vector<Plot> plots;
  std::vector<char> are_static_floating;  // (plots)
  std::vector<char> are_bodies;           // (returns)
  std::size_t num_unexplained = 0;
};

StationPlots PlotsOf(const Recording& recording, const Background& background,
                     const RobustConfig& config) {
  StationPlots found;
  found.are_bodies.assign(recording.points_m.size(), 0);
  if (recording.points_m.empty()) return found;
  const std::vector<FrameInfo> scene = SceneFrames(recording);
  const std::vector<std::uint32_t> structure = ReturnsOf(scene, background.structure());
  const PointsView structure_m(recording.points_m, structure);
  const Ground ground(structure_m);
  FieldOfView view;
  for (const FrameInfo& frame : scene) {
    for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
      view.Add(recording.points_m[i]);
    }
  }
  const Support support(structure_m, ground, view.Edges(), config.background.occluder_cell_deg,
                        config.support);
  // Static objects in the air look like structure if present throughout; they are candidates again.
  const std::vector<std::uint32_t> floating =
      support.FloatingReturns(recording, background.structure());
  std::vector<std::uint32_t> candidates;
  std::merge(background.unexplained().begin(), background.unexplained().end(), floating.begin(),
             floating.end(), std::back_inserter(candidates));
  // Distant ground is hit too seldom to be classified by occupancy.
  candidates.erase(
      std::remove_if(candidates.begin(), candidates.end(),
                     [&](std::uint32_t i) { return ground.IsGround(recording.points_m[i]); }),
      candidates.end());
  found.num_unexplained = candidates.size();
  found.plots = MakePlots(recording, candidates, ground, config, &found.are_bodies);
  MarkFloating(recording, support, config, &found.plots);
  SetPlaceRates(background, &found.plots);
  std::vector<char> is_static_floating(recording.points_m.size(), 0);
  for (const std::uint32_t i : floating) is_static_floating[i] = 1;
  for (const Plot& plot : found.plots) {
    found.are_static_floating.push_back(plot.is_floating && HasAnyOf(plot, is_static_floating) ? 1
                                                                                               : 0);
  }
  return found;
}

}  // namespace

MultiStationPlots::MultiStationPlots(const Recording& recording, const Stations& stations,
                                     const RobustConfig& config)
    : stations_(stations),
      config_(config),
      num_sensors_(recording.sensors.size()),
      are_bodies_(recording.points_m.size(), 0) {
  if (stations.size() == 1 && stations.ViewpointM(0).isZero()) {
    // A single station at the origin needs no copy of the recording.
    std::vector<std::uint32_t> all(recording.frames.size());
    std::iota(all.begin(), all.end(), 0U);
    AddStation(recording, recording, all, config);
  } else {
    for (std::size_t station = 0; station < stations.size(); ++station) {
      const StationRecording own = RecordingOf(recording, stations, station);
      AddStation(recording, own.recording, own.frames, config);
    }
  }
  SortByTime();
}

void MultiStationPlots::AddStation(const Recording& whole, const Recording& own,
                                   const std::vector<std::uint32_t>& frames,
                                   const RobustConfig& config) {
  const Eigen::Vector3d viewpoint_m = stations_.ViewpointM(backgrounds_.size()).cast<double>();
  backgrounds_.emplace_back(own, config.background);
  StationPlots found = PlotsOf(own, backgrounds_.back(), config);
  for (Plot& plot : found.plots) {
    const std::uint32_t own_first = own.frames[plot.frame].first_return;
    plot.frame = frames[plot.frame];
    const std::uint32_t first = whole.frames[plot.frame].first_return;
    for (std::uint32_t& i : plot.returns) i = first + (i - own_first);
    plot.position_m += viewpoint_m;
    plots_.push_back(std::move(plot));
  }
  are_static_floating_.insert(are_static_floating_.end(), found.are_static_floating.begin(),
                              found.are_static_floating.end());
  num_unexplained_ += found.num_unexplained;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    std::copy(found.are_bodies.begin() + own.frames[f].first_return,
              found.are_bodies.begin() + own.frames[f].last_return,
              are_bodies_.begin() + whole.frames[frames[f]].first_return);
  }
}

void MultiStationPlots::SortByTime() {
  std::vector<std::size_t> order(plots_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return plots_[a].frame_time_ns < plots_[b].frame_time_ns;
  });
  const auto reorder = [&](auto* values) {
    std::remove_reference_t<decltype(*values)> sorted;
    sorted.reserve(values->size());
    for (const std::size_t i : order) sorted.push_back(std::move((*values)[i]));
    *values = std::move(sorted);
  };
  reorder(&plots_);
  reorder(&are_static_floating_);
}

void MultiStationPlots::EstimateClutter(const std::vector<char>& assigned) {
  unlidar::EstimateClutter(StationModels(), config_, assigned, &plots_);
}

std::vector<StationModel> MultiStationPlots::StationModels() const {
  std::vector<StationModel> station_models;
  for (std::uint32_t sensor = 0; sensor < num_sensors_; ++sensor) {
    const std::size_t station = stations_.StationOf(sensor);
    station_models.push_back({stations_.ViewpointM(station), &backgrounds_[station]});
  }
  return station_models;
}

}  // namespace unlidar
