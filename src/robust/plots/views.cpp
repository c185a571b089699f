#include "robust/plots/views.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <type_traits>
#include <utility>

#include "robust/plots/floating.hpp"
#include "robust/scene/field_of_view.hpp"
#include "robust/scene/ground.hpp"
#include "robust/scene/support.hpp"

namespace unlidar {

Views::View::View(const Recording& recording, const RobustConfig& config)
    : background(recording, config.background) {
  if (recording.points_m.empty()) return;
  const PointsView structure_m(recording.points_m, background.structure());
  const Ground ground(structure_m, config.ground);
  FieldOfView view;
  for (const Eigen::Vector3f& point_m : recording.points_m) view.Add(point_m);
  const Support support(structure_m, ground, view.Edges(), config.background.occluder_cell_deg,
                        config.support);
  // What stands still in the air all the time looks like structure, but is none.
  const std::vector<std::uint32_t> floating =
      support.FloatingReturns(recording, background.structure());
  std::vector<std::uint32_t> candidates;
  std::merge(background.unexplained().begin(), background.unexplained().end(), floating.begin(),
             floating.end(), std::back_inserter(candidates));
  // Ground far away is hit too seldom to be known by its occupancy.
  candidates.erase(
      std::remove_if(candidates.begin(), candidates.end(),
                     [&](std::uint32_t i) { return ground.Holds(recording.points_m[i]); }),
      candidates.end());
  num_unexplained = candidates.size();
  plots = MakePlots(recording, candidates, ground, config.plots, &are_bodies);
  MarkFloating(recording, support, config.background.place, &plots);
  std::vector<char> is_standing(recording.points_m.size(), 0);
  for (const std::uint32_t i : floating) is_standing[i] = 1;
  for (const Plot& plot : plots) {
    are_parked.push_back(plot.is_floating && HasAnyOf(plot, is_standing) ? 1 : 0);
  }
}

Views::Views(const Recording& recording, const Stations& stations, const RobustConfig& config)
    : stations_(stations),
      config_(config.plots),
      num_sensors_(recording.sensors.size()),
      are_bodies_(recording.points_m.size(), 0) {
  if (stations.size() == 1 && stations.ViewpointM(0).isZero()) {
    // What a station about the origin sees alone needs no copy.
    StationRecording all;
    all.recording.frames = recording.frames;
    all.frames.resize(recording.frames.size());
    std::iota(all.frames.begin(), all.frames.end(), 0U);
    views_.emplace_back(recording, config);
    AddPlots(recording, all);
  } else {
    for (std::size_t station = 0; station < stations.size(); ++station) {
      const StationRecording part = RecordingOf(recording, stations, station);
      views_.emplace_back(part.recording, config);
      AddPlots(recording, part);
    }
  }
  SortByTime();
}

// Takes in the plots of the newest view, which is of a part of the recording.
void Views::AddPlots(const Recording& recording, const StationRecording& part) {
  const View& view = views_.back();
  const std::size_t index = views_.size() - 1;
  const Eigen::Vector3d viewpoint_m = stations_.ViewpointM(index).cast<double>();
  for (std::size_t k = 0; k < view.plots.size(); ++k) {
    Plot plot = view.plots[k];
    const FrameInfo& own = part.recording.frames[plot.frame];
    plot.frame = part.frames[plot.frame];
    const FrameInfo& frame = recording.frames[plot.frame];
    for (std::uint32_t& i : plot.returns) i = frame.first_return + (i - own.first_return);
    plot.position_m += viewpoint_m;
    plots_.push_back(std::move(plot));
    sources_.push_back({index, k});
  }
  are_parked_.insert(are_parked_.end(), view.are_parked.begin(), view.are_parked.end());
  num_unexplained_ += view.num_unexplained;
  if (view.are_bodies.empty()) return;
  for (std::size_t f = 0; f < part.frames.size(); ++f) {
    const FrameInfo& own = part.recording.frames[f];
    std::copy(view.are_bodies.begin() + own.first_return, view.are_bodies.begin() + own.last_return,
              are_bodies_.begin() + recording.frames[part.frames[f]].first_return);
  }
}

void Views::SortByTime() {
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
  reorder(&sources_);
  reorder(&are_parked_);
}

void Views::EstimateClutter(const std::vector<char>& explained) {
  std::vector<std::vector<char>> own_explained;
  for (const View& view : views_) own_explained.emplace_back(view.plots.size(), 0);
  for (std::size_t i = 0; i < plots_.size(); ++i) {
    own_explained[sources_[i].view][sources_[i].plot] = explained[i];
  }
  for (std::size_t v = 0; v < views_.size(); ++v) {
    unlidar::EstimateClutter(views_[v].background, config_, own_explained[v], &views_[v].plots);
  }
  for (std::size_t i = 0; i < plots_.size(); ++i) {
    plots_[i].log_clutter = views_[sources_[i].view].plots[sources_[i].plot].log_clutter;
  }
}

std::vector<SensorView> Views::SensorViews() const {
  std::vector<SensorView> sensor_views;
  for (std::uint32_t sensor = 0; sensor < num_sensors_; ++sensor) {
    const std::size_t station = stations_.StationOf(sensor);
    sensor_views.push_back({stations_.ViewpointM(station), &views_[station].background});
  }
  return sensor_views;
}

}  // namespace unlidar
