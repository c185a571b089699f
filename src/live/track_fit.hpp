// The last fit of a track of a stream: its trajectory, and what it goes by.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "trajectory/trajectory.hpp"
#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {

class TrackFit {
 public:
  // Of which a measurement was made.
  struct PlotRef {
    TimeNs stamp_ns;
    std::uint32_t frame;
    Eigen::Vector3d position_m;
    int num_returns;
  };

  // Takes what there is to fit, once it is cleared, back from the newest.
  void Clear();
  void AddEarlier(const Measurement& measurement, const PlotRef& plot_ref);

  // Fits the trajectory to it, with the scales of a fit shortly before where they still suit.
  void Fit(TrajectoryFitter& fitter);

  const Trajectory& trajectory() const { return trajectory_; }
  const std::vector<Measurement>& measurements() const { return measurements_; }  // by time

  // Whether that leads by a plot, and the measurements by which it does: all but outliers.
  bool IsInlier(const Plot& plot) const;
  std::vector<Measurement> InlierMeasurements() const;

  // Returns of the target in frames whose stamps lie in [from_ns, to_ns).
  int ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const;

 private:
  void SortByTime();
  bool IsOutlier(std::size_t i) const { return trajectory_.weights[i] < 0.5; }
  bool IsNewestOutlier() const;

  Trajectory trajectory_;
  std::vector<Measurement> measurements_;
  std::vector<PlotRef> plot_refs_;   // of these
  std::optional<TimeNs> scales_ns_;  // when the scales were found
};

}  // namespace unlidar
