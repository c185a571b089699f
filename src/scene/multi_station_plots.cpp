#include "scene/multi_station_plots.hpp"

#include <iterator>
#include <utility>

#include "base/algorithms.hpp"
#include "scene/clutter.hpp"
#include "scene/floating.hpp"

namespace unlidar {
namespace {

// Room for plots beyond those expected, as their number varies from frame to frame.
constexpr double kSpareShare = 1.1;

}  // namespace

MultiStationPlots::MultiStationPlots(const Recording& recording, const Stations& stations,
                                     const RobustConfig& config)
    : config_(config),
      stations_(stations),
      num_sensors_(recording.sensors.size()),
      are_bodies_(recording.points_m.size(), 0) {
  std::vector<std::vector<FrameInfo>> frames(stations.size());
  for (const FrameInfo& frame : recording.frames) {
    frames[stations.StationOf(frame.sensor)].push_back(frame);
  }
  for (const std::vector<FrameInfo>& own : frames) {
    scenes_.push_back({TimeBins(own, num_sensors_), StationScene(config), {}, {}, own.size()});
  }
  for (const FrameInfo& frame : recording.frames) {
    LoadFrame(recording, frame);
    Station& station = scenes_[stations.StationOf(frame.sensor)];
    station.scene.Learn(frame_.points_m, station.bins.BinOf(frame.middle_ns()), frame.carrier);
  }
  for (Station& station : scenes_) station.scene.Fit();
  for (std::uint32_t f = 0; f < recording.frames.size(); ++f) FindPlots(recording, f);
  for (std::size_t station = 0; station < scenes_.size(); ++station) TakePlots(recording, station);
  SortByFrameTime(&plots_);
}

// Sets frame_, without times, relative to the viewpoint of its station.
void MultiStationPlots::LoadFrame(const Recording& recording, const FrameInfo& frame) {
  const Eigen::Vector3f& viewpoint_m = stations_.ViewpointM(stations_.StationOf(frame.sensor));
  frame_.points_m.clear();
  for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
    frame_.points_m.push_back(recording.points_m[i] - viewpoint_m);
  }
  frame_.frames.assign(1, frame);
  frame_.frames[0].first_return = 0;
  frame_.frames[0].last_return = frame.last_return - frame.first_return;
}

void MultiStationPlots::FindPlots(const Recording& recording, std::uint32_t frame_index) {
  const FrameInfo& frame = recording.frames[frame_index];
  LoadFrame(recording, frame);
  frame_.times_ns.clear();
  for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
    frame_.times_ns.push_back(recording.times_ns[i]);
  }
  Station& station = scenes_[stations_.StationOf(frame.sensor)];
  FramePlots& found =
      station.scene.FindPlots(station.bins.BinOf(frame.middle_ns()), {}, nullptr, &frame_);
  num_unexplained_ += station.scene.num_unexplained();
  for (const std::uint32_t i : found.body_returns) are_bodies_[frame.first_return + i] = 1;
  const Eigen::Vector3f& viewpoint_m = stations_.ViewpointM(stations_.StationOf(frame.sensor));
  for (const BodyBox& body : found.bodies) {
    InsertInOrder(body, &station.bodies);
    InsertInOrder(body.Moved(viewpoint_m), &bodies_);
  }
  ++station.num_frames_done;
  Reserve(found.plots.size(), &station);
  for (std::size_t p = 0; p < found.plots.size(); ++p) {
    Plot& plot = found.plots[p];
    plot.frame = frame_index;
    for (const std::uint32_t i : station.scene.ReturnsOf(p)) {
      plot.returns.push_back(frame.first_return + i);
    }
    station.plots.push_back(std::move(plot));
  }
}

// Makes room for more plots, and where there is none, for those of all frames to come as well: a
// vector that grows by doubling has most of them in memory twice.
void MultiStationPlots::Reserve(std::size_t num_more, Station* station) {
  const std::size_t num_plots = station->plots.size() + num_more;
  if (num_plots <= station->plots.capacity()) return;
  const double per_frame =
      static_cast<double>(num_plots) / static_cast<double>(station->num_frames_done);
  station->plots.reserve(
      static_cast<std::size_t>(kSpareShare * per_frame * static_cast<double>(station->num_frames)));
}

// Takes the plots of a station but those beside bodies, and marks those that float.
void MultiStationPlots::TakePlots(const Recording& recording, std::size_t station_index) {
  Station& station = scenes_[station_index];
  std::vector<Plot>& plots = station.plots;
  EraseIf(&plots, [&](const Plot& plot) { return IsNearBody(plot, station.bodies); });
  SortByFrameTime(&plots);
  MarkFloating(recording, station.scene.support(), config_, &plots);
  const Eigen::Vector3d viewpoint_m = stations_.ViewpointM(station_index).cast<double>();
  for (Plot& plot : plots) plot.position_m += viewpoint_m;
  if (plots_.empty()) {
    plots_ = std::move(plots);
  } else {
    plots_.insert(plots_.end(), std::make_move_iterator(plots.begin()),
                  std::make_move_iterator(plots.end()));
  }
  plots = std::vector<Plot>();  // without its memory
  station.bodies = Queue<BodyBox>();
}

void MultiStationPlots::EstimateClutter(const std::vector<char>& assigned) {
  unlidar::EstimateClutter(StationModels(), config_, assigned, &plots_);
}

std::vector<StationModel> MultiStationPlots::StationModels() const {
  std::vector<StationModel> station_models;
  for (std::uint32_t sensor = 0; sensor < num_sensors_; ++sensor) {
    const std::size_t station = stations_.StationOf(sensor);
    station_models.push_back({stations_.ViewpointM(station), &scenes_[station].bins,
                              &scenes_[station].scene.occupancy()});
  }
  return station_models;
}

}  // namespace unlidar
