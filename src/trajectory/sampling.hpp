// Rows of a fitted trajectory at the output times.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "trajectory/output_times.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

struct TimeInterval {
  TimeNs begin_ns = 0;
  TimeNs end_ns = 0;
};

// How long a target may have gone unseen before its first and after its last measurement: as long
// as a silence is likelier than `probability`.
TimeNs UndetectedBeforeNs(const std::vector<Measurement>& measurements, TimeNs period_ns,
                          double probability);
TimeNs UndetectedAfterNs(const std::vector<Measurement>& measurements, TimeNs period_ns,
                         double probability);

// When a target was there: from first to last measurement, widened to the whole frames, of any
// sensor, in which they lie (a stamp names all of its frame, whose returns were measured a little
// before or after it), and further by a silence that is likelier than `silence_probability`: a
// drone that is hit in one frame of five was there for some frames before the first hit. One that
// is hit in every frame was not, nor is any with a silence_probability of 1. Ends with the
// recording.
TimeInterval ExistenceInterval(const Recording& recording,
                               const std::vector<Measurement>& measurements,
                               double silence_probability);

// The returns of a target in one frame.
struct FrameSupport {
  TimeNs stamp_ns = 0;
  int returns = 0;
};

// Of some of the returns, by their indices in ascending order; in the order of the stamps.
std::vector<FrameSupport> SupportByFrame(const Recording& recording,
                                         const std::vector<std::uint32_t>& returns);

// From where a target was seen at some time.
struct TimedViewpoint {
  TimeNs time_ns = 0;
  Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();
};

// How much wider than its fit says the position of a target is spread at some time, per axis.
struct CovarianceInflation {
  TimeNs time_ns = 0;
  Eigen::Vector3d variance_m2 = Eigen::Vector3d::Zero();
};

// So that they hold what is doubted of a fit as well. Of several alternative_modes of one time the
// gravest counts.
std::vector<CovarianceInflation> CovarianceInflationsOf(
    const std::vector<AlternativeMode>& alternative_modes, const Trajectory& trajectory);

void SetViewpoints(const std::vector<Measurement>& measurements,
                   std::vector<TimedViewpoint>* viewpoints);

// What the rows of a track are computed from. They are not kept: there may be millions of them.
struct RowSource {
  int track_id = 0;
  Trajectory trajectory;
  TimeInterval presence;
  double depth_sigma_m = 0.0;  // an error that all rows share, along their rays:
  std::vector<TimedViewpoint>
      viewpoints;  // from the viewpoint of the nearest of these, in order of time
  std::vector<CovarianceInflation>
      covariance_inflations;  // in order of time: between two of them as on a straight line
  double max_sigma_m = 0.0;
  std::vector<FrameSupport> support;
};

// One row per instant within the presence, except where the largest sigma exceeds max_sigma_m or a
// number is not finite. The support of a row: the returns of the target whose frames' stamps are
// nearer to it than to any other row, the earlier one of two equally near. (The middle of a frame
// lies halfway between two stamps: by it, jitter would decide.) The sum over the rows is the number
// of returns. Both arguments must outlive it.
class RowSampler {
 public:
  RowSampler(const RowSource& source, const OutputInstants& instants);

  // The rows in time order, one at each call, and then none.
  std::optional<TrajectoryRow> Next();

 private:
  std::optional<TrajectoryRow> Sample();
  Eigen::Vector3d ViewpointAt(TimeNs time_ns) const;
  Eigen::Vector3d VarianceInflationAt(TimeNs time_ns) const;

  const RowSource& source_;
  const OutputInstants& instants_;
  std::size_t instant_;
  std::vector<FrameSupport>::const_iterator support_;
  std::optional<TrajectoryRow> ahead_;  // returns belong to the nearer of two rows
};

// The same as a function.
using RowStream = std::function<std::optional<TrajectoryRow>()>;
RowStream SampleRows(const RowSource& source, const OutputInstants& instants);

// Length of the path between first and last measurement.
double PathLength(const Trajectory& trajectory);

}  // namespace unlidar
