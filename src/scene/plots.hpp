// Plots: the detections of one frame, with their clutter intensity.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "base/index_list.hpp"
#include "base/maths.hpp"
#include "base/queue.hpp"
#include "base/recording.hpp"
#include "scene/ground.hpp"
#include "scene/linkage.hpp"
#include "scene/stations.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Returns the clutter intensity (plots or returns per m^3 and frame) given their `count`, the
// `exposure` in m^3 x frames and the intensity of the surroundings, the prior: method.md (2).
inline double ClutterRate(double count, double exposure, double prior_rate) {
  return (count + kJeffreysCount) / (exposure + kJeffreysCount / prior_rate);
}

// Returns the rays per m^2 across a target, up to a factor: they thin out with the square of range.
inline double PerM2(const Eigen::Vector3d& ray_m) {
  return 1.0 / std::max(ray_m.squaredNorm(), 1.0);
}

// A plot with a lower lowest return may be a person or stand on the ground.
constexpr double kPersonHeightM = 2.0;

// Height of the visible part of a body of which a part is seen.
constexpr double kBodyPartM = 0.6;

// Returns farther below a plot are not its own: half the height of a drone plus noise.
constexpr double kBelowPlotM = 0.4;

// Returns so far from a plot, horizontally, are above or below it.
constexpr RangeRadius kColumnRadius{0.6, 0.005};

// A body hides what is beside it, and excludes the plots there, for this long before and after.
constexpr double kBodyMarginS = 0.35;

struct Plot {
  TimeNs time_ns = 0;         // mean of its returns
  TimeNs frame_time_ns = 0;   // middle of its frame
  double streak_s = 0.0;      // duration of its frame if returns have no times, otherwise 0
  float time_sigma_s = 0.0F;  // see FrameInfo
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d ray_m = Eigen::Vector3d::Zero();          // from the viewpoint of its frame
  Eigen::Vector3f shift_m = Eigen::Vector3f::Zero();        // of its sensor, see CarrierPose
  Eigen::Vector3f carrier_ray_m = Eigen::Vector3f::Zero();  // the ray in the axes of the carrier
  double variance_m2 = 0.0;         // of the position, per axis, for a target at rest
  double lowest_m = 0.0;            // height of its lowest return above the ground
  double place_rate = 0.0;          // of its returns, see StationScene::FindPlots
  double log_clutter = 0.0;         // log clutter intensity, per m^3 and frame of its sensor
  float stray_group_rate = 0.0F;    // of plots where dense strays are, if it is there; otherwise 0
  bool is_floating = false;         // static and unsupported: MarkFloating
  bool is_above_structure = false;  // that may carry people and vehicles: a bridge or a roof
  bool has_structure = false;       // returns at places that look like structure, unsupported
  float column_m = 0.0F;        // length of the column below it in which returns may be a body's
  float watched_below = 1.0F;   // share of that column that has rays, over its own; at most 1
  float beam_step_m = 0.0F;     // from beam to beam across the ray; 0: no gaps between them
  float sights_per_sr = 0.0F;   // lines of sight of a frame, see SightDensity; 0: unknown
  std::uint32_t num_below = 0;  // returns of its frame in that column
  // Returns of its frame in line with that column, nearer and farther, if it is low and has none.
  std::uint32_t num_before_below = 0;
  std::uint32_t num_behind_below = 0;
  std::uint32_t frame = 0;
  std::uint32_t sensor = 0;
  std::uint32_t num_returns = 0;
  IndexList returns;  // into the recording; empty in a stream

  // Returns the place from which it was seen.
  Eigen::Vector3d ViewpointM() const { return position_m - ray_m; }

  // Its place in the scene of its station.
  Eigen::Vector3d PlaceM() const { return ray_m + shift_m.cast<double>(); }

  // True if its sensor is away from where its station was first.
  bool IsFromTravel() const { return shift_m.norm() > kMaxStationRadiusM; }
};

// Sorts the plots as all stages expect them; plots of one frame keep their order.
void SortByFrameTime(std::vector<Plot>* plots);

// Finds the plots above a return, as a head is above legs: the return lies in the column of the
// plot, lower than half the height of a drone plus noise, and above the roughness of the ground.
class Columns {
 public:
  // Plots are numbered in the order of Add() and must outlive this. Call Sort() after the last.
  void Clear() {
    columns_.clear();
    box_.setEmpty();
  }
  void Add(const Plot& plot);
  void Sort();

  // Calls `visit(number)` for each plot above the return.
  template <class Visit>
  void VisitAbove(const Eigen::Vector3f& return_m, const Visit& visit) const {
    if (!box_.contains(return_m)) return;
    const Eigen::Vector3d point_m = return_m.cast<double>();
    auto at = FirstFrom(columns_, &Column::x_m, point_m.x() - widest_m_);
    for (; at != columns_.end() && at->x_m < point_m.x() + widest_m_; ++at) {
      const Eigen::Vector3d below_m = at->plot->position_m - point_m;
      if (below_m.z() > kBelowPlotM && below_m.z() < at->plot->column_m &&
          below_m.head<2>().norm() < at->radius_m) {
        visit(at->number);
      }
    }
  }

 private:
  struct Column {
    double x_m;
    double radius_m;
    const Plot* plot;
    std::size_t number;
  };

  std::vector<Column> columns_;
  double widest_m_ = 0.0;
  Eigen::AlignedBox3f box_;  // around all columns: most returns lie outside
};

// True if the plot contains any of the marked `returns` (N, nonzero if marked).
inline bool HasAnyOf(const Plot& plot, const std::vector<char>& returns) {
  return std::any_of(plot.returns.begin(), plot.returns.end(),
                     [&](std::uint32_t i) { return returns[i] != 0; });
}

// Bounding box of a body, and the time of its first return.
struct BodyBox {
  TimeNs time_ns = 0;
  Eigen::Array3f low_m = Eigen::Array3f::Zero();
  Eigen::Array3f high_m = Eigen::Array3f::Zero();

  BodyBox Moved(const Eigen::Vector3f& by_m) const {
    return {time_ns, low_m + by_m.array(), high_m + by_m.array()};
  }
};

// Inserts a body behind those that are not later.
inline void InsertInOrder(const BodyBox& body, Queue<BodyBox>* bodies) {
  bodies->Insert(FirstFrom(*bodies, &BodyBox::time_ns, body.time_ns + 1), body);
}

struct FramePlots {
  std::vector<Plot> plots;                  // without the lists of their returns
  std::vector<BodyBox> bodies;              // people, cars
  std::vector<std::uint32_t> body_returns;  // indices into the recording
};

// Elevations (rad) of a station below which the legs of people are cut off: LowestElevationRad(),
// and where no ground is in view FieldOfView::LowestRad().
struct LowestElevations {
  double above_ground_rad = 0.0;
  double of_view_rad = 0.0;
};

// Extracts the plots of successive frames, reusing its memory.
class FramePlotter {
 public:
  // Occupancy::StrayRateIn of the frame.
  using StrayRateAt = std::function<StrayRate(const Eigen::Vector3f&)>;

  // Links `candidates`, returns of one frame in ascending order, into plots; returns of bodies are
  // removed from them. The recording, the plots and bodies are relative to the viewpoint of the
  // frame, the ground to that of its station. The result is valid until the next call, and may be
  // changed.
  FramePlots& Find(const Recording& recording, std::uint32_t frame,
                   std::vector<std::uint32_t>* candidates, const Ground& ground,
                   const LowestElevations& lowest, const StrayRateAt& stray_rate_at,
                   const RobustConfig& config);

  // Returns of a plot of the last frame: indices into the recording.
  IndexView ReturnsOf(std::size_t plot) const { return linker_[plot]; }

 private:
  // Direction in which the empty column below a low plot is seen.
  struct Sight {
    Plot* plot;
    Eigen::Vector2f toward;  // horizontal
    float range_m;           // horizontal
    float radius_m;
    float lowest;  // slopes
    float highest;
  };

  void CountBelow(const Recording& recording, const FrameInfo& frame);
  void CountInLineBelow(const Recording& recording, const FrameInfo& frame, double off_ground_m);
  RangeRadius BodyLinkAmongStrays(const Recording& recording, const IndexView& returns,
                                  const StrayRateAt& stray_rate_at) const;
  void AddBody(const Recording& recording, std::uint32_t first_return, const IndexView& returns);

  Linker linker_;
  Linker body_linker_;                // of one group that strays may have joined
  std::vector<std::uint32_t> group_;  // its returns
  std::vector<char> is_body_;         // (returns of the frame)
  Columns columns_;                   // of the plots found
  std::vector<Sight> sights_;
  FramePlots found_;
};

// True if the plot lies beside a body within kBodyMarginS: it may be a part of the body too sparse
// or too far from the rest to be linked to it. `bodies` in order of time.
bool IsNearBody(const Plot& plot, const Queue<BodyBox>& bodies);

}  // namespace unlidar
