// Plots: what one frame shows at one place, with the clutter to be expected there.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/background.hpp"
#include "scene/ground.hpp"
#include "scene/linkage.hpp"
#include "scene/station_model.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Neighbourhoods whose plots tell of the clutter of a place: the middle and the narrow one are
// keys, the wide one reaches across a scene. Each is the prior of the next, with the weight of half
// a plot (Jeffreys' prior of a Poisson rate). Bins of the background as near to a plot's own say
// nothing of its clutter: a target takes about as long to leave its place.
constexpr RangeRadius kClutterWide{4.0, 0.35};
constexpr double kClutterPriorPlots = 0.5;
constexpr int kClutterExclusionBins = 2;

// The rate of clutter (plots or returns per m^3 and frame) where so many were seen in so many m^3
// and frames, given the rate about it.
inline double ClutterRate(double count, double exposure, double prior_rate) {
  return (count + kClutterPriorPlots) / (exposure + kClutterPriorPlots / prior_rate);
}

// What was a body is near so long before and after.
constexpr double kBodyMarginS = 0.35;

struct Plot {
  TimeNs time_ns = 0;        // mean of its returns
  TimeNs frame_time_ns = 0;  // middle of its frame
  double streak_s = 0.0;     // how long its returns may lie apart: a frame without times of points
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d ray_m = Eigen::Vector3d::Zero();  // to it from the viewpoint of its station
  double variance_m2 = 0.0;  // of the position, per axis, for a target at rest
  double lowest_m = 0.0;     // height of its lowest return above the ground
  double place_rate = 0.0;   // of all returns at its place: see Background::PlaceRate
  double log_clutter = 0.0;  // log of the clutter plots per m^3 and frame of its sensor
  bool is_floating = false;  // stands still where nothing holds it up: MarkFloating tells
  double column_m = 0.0;     // how far below it what may be a body's counts: nearly to the ground
  std::uint32_t num_below = 0;  // returns of its frame in that column: of a body
  std::uint32_t frame = 0;
  std::uint32_t sensor = 0;
  std::uint32_t num_returns = 0;
  std::vector<std::uint32_t> returns;  // indices into the recording; none in a stream
};

// The volume in which the plots of one point-like thing lie: that of a Gaussian of their noise.
double PlotVolumeM3(const Plot& plot);

// The mean of some returns, at least one.
Eigen::Vector3d MeanOf(const Recording& recording, const IndexView& returns);

// The order in which all stages expect plots; plots of one frame keep theirs.
void SortByFrameTime(std::vector<Plot>* plots);

// Finds the plots that a return is below, as legs are below a head: within a column, beyond half
// the height of a drone and the noise, and above the roughness of the ground.
class Columns {
 public:
  // Numbers the plots that are added, which must outlive this, in this order. Sort() when all are.
  void Clear() {
    columns_.clear();
    box_.setEmpty();
  }
  void Add(const Plot& plot);
  void Sort();

  // Calls `visit(number)` for each plot that the return is below.
  template <class Visit>
  void VisitAbove(const Eigen::Vector3f& return_m, const Visit& visit) const {
    if (!box_.contains(return_m)) return;
    const Eigen::Vector3d point_m = return_m.cast<double>();
    auto at = std::lower_bound(columns_.begin(), columns_.end(), point_m.x() - widest_m_,
                               [](const Column& column, double x) { return column.x_m < x; });
    for (; at != columns_.end() && at->x_m < point_m.x() + widest_m_; ++at) {
      if (IsIn(point_m, *at)) visit(at->number);
    }
  }

 private:
  struct Column {
    double x_m;
    double radius_m;
    const Plot* plot;
    std::size_t number;
  };

  static bool IsIn(const Eigen::Vector3d& point_m, const Column& column);

  std::vector<Column> columns_;
  double widest_m_ = 0.0;
  Eigen::AlignedBox3f box_;  // about all of them: most returns are beyond it
};

// Whether a plot has any of some returns (N, not 0 for each of them).
bool HasAnyOf(const Plot& plot, const std::vector<char>& returns);

// Where a body lies, and when the first of its returns was measured.
struct BodyBox {
  TimeNs time_ns = 0;
  Eigen::Array3f low_m = Eigen::Array3f::Zero();
  Eigen::Array3f high_m = Eigen::Array3f::Zero();
};

// What one frame shows.
struct FramePlots {
  std::vector<Plot> plots;                  // without the lists of their returns
  std::vector<BodyBox> bodies;              // people, cars
  std::vector<std::uint32_t> body_returns;  // indices into the recording
};

// Finds the plots of frames, one after the other in the same memory.
class FramePlotter {
 public:
  // Of `candidates`, returns of one frame in ascending order; those of bodies are left out of them.
  // All of the recording is relative to the viewpoint of its station; `lowest_elevation_rad`:
  // LowestElevationRad of the station. What is returned is the caller's until the next frame.
  FramePlots& Find(const Recording& recording, std::uint32_t frame,
                   std::vector<std::uint32_t>* candidates, const Ground& ground,
                   double lowest_elevation_rad, const PlotConfig& config);

  // Of a plot that was found last: indices into the recording.
  IndexView ReturnsOf(std::size_t plot) const { return linker_[plot]; }

 private:
  void CountBelow(const Recording& recording, const FrameInfo& frame);

  Linker linker_;
  std::vector<char> is_body_;  // (returns of the frame)
  Columns columns_;            // of the plots found
  FramePlots found_;
};

// Whether a plot is next to a body: what of it was too sparse, or too far from the rest, to be
// known. `bodies` in order of time.
bool IsNearBody(const Plot& plot, const Queue<BodyBox>& bodies);

// Plots of `candidates`, returns in ascending order, frame by frame in order of time; bodies
// (people, cars) left out, with all that is next to one shortly before or after. `is_body` (N)
// tells the returns of bodies themselves.
std::vector<Plot> MakePlots(const Recording& recording,
                            const std::vector<std::uint32_t>& candidates, const Ground& ground,
                            const PlotConfig& config, std::vector<char>* is_body);

// Sets place_rate of every plot, whose returns are those of the background: the mean over them.
void SetPlaceRates(const Background& background, std::vector<Plot>* plots);

// Sets log_clutter of every plot, MarkFloating and SetPlaceRates done, from the plots of its sensor
// that are not `assigned` (size of plots): from those at other times in three narrowing
// neighbourhoods, and, unless it floats, from the rate of a static thing at its place (which plots
// of one visit tell only as far as each follows others, where few things are static) and from that
// of all returns there. `station_models`: (sensors).
void EstimateClutter(const std::vector<StationModel>& station_models, const PlotConfig& config,
                     const std::vector<char>& assigned, std::vector<Plot>* plots);

}  // namespace unlidar
