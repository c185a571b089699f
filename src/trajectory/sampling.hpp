// The output times, at which rows are written, and the rows of a fitted trajectory at them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "base/recording.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {

// Instants in ascending order. Those of a rate are computed on demand.
class OutputInstants {
 public:
  OutputInstants() = default;
  explicit OutputInstants(std::vector<TimeNs> list) : list_(std::move(list)), size_(list_.size()) {}

  // begin + floor(k / rate) up to the end, in integers and thus without drift. Throws UsageError
  // for more than 10 million.
  OutputInstants(const Rate& rate, TimeNs begin_ns, TimeNs end_ns);

  // Replaces the instants by the list [first, last), reusing memory.
  template <class Iterator>
  void SetList(Iterator first, Iterator last) {
    list_.assign(first, last);
    nanohertz_ = 0;
    size_ = list_.size();
  }

  std::size_t size() const { return size_; }
  TimeNs operator[](std::size_t k) const;

  // Returns the number of instants before the time, the index of the first one not before it; of a
  // rate as if it had no end.
  std::size_t CountBefore(TimeNs time_ns) const;

 private:
  std::vector<TimeNs> list_;     // empty for a rate
  std::uint64_t nanohertz_ = 0;  // 0 for a list
  TimeNs begin_ns_ = 0;
  std::size_t size_ = 0;
};

// A rate runs from the start of the first frame to the end of the last one.
OutputInstants ResolveOutputTimes(const OutputTimes& times, const Recording& recording);

struct TimeInterval {
  TimeNs begin_ns = 0;
  TimeNs end_ns = 0;
};

// Extends the time in which a target was seen by that for which it may have been present but
// undetected at both ends: as long as a run of missed detections is likelier than `probability`.
TimeInterval WithUndetected(const TimeInterval& seen, const std::vector<Measurement>& measurements,
                            TimeNs period_ns, double probability);

// Returns the time in which a target existed: from first to last measurement, extended to the whole
// frames of any sensor that contain them (returns are measured a little before or after the stamp
// of their frame), and further while missed detections are likelier than
// `min_missed_run_probability`: a drone that is hit in one frame of five was there for some frames
// before the first hit, one that is hit in every frame was not. No such extension if
// min_missed_run_probability is 1. Clipped to the recording.
TimeInterval ExistenceInterval(const Recording& recording,
                               const std::vector<Measurement>& measurements,
                               double min_missed_run_probability);

// The returns of a target in one frame.
struct FrameSupport {
  TimeNs stamp_ns = 0;
  int returns = 0;
};

// Counts returns, given by ascending index, per frame; in order of stamps.
std::vector<FrameSupport> SupportByFrame(const Recording& recording,
                                         const std::vector<std::uint32_t>& returns);

// Viewpoint from which a target was seen at some time.
struct TimedViewpoint {
  TimeNs time_ns = 0;
  Eigen::Vector3d viewpoint_m = Eigen::Vector3d::Zero();
};

// Variance per axis to be added to that of the fit at some time.
struct CovarianceInflation {
  TimeNs time_ns = 0;
  Eigen::Vector3d variance_m2 = Eigen::Vector3d::Zero();
};

// Returns the inflations by which sigmas include the alternative modes of a fit (method.md (16)).
// Of several modes of one time the one with the largest inflation counts.
std::vector<CovarianceInflation> CovarianceInflationsOf(
    const std::vector<AlternativeMode>& alternative_modes, const Trajectory& trajectory);

// Returns the viewpoint nearest in time, the earlier one of two; the origin if there is none.
// `viewpoints`: in order of time.
Eigen::Vector3d NearestViewpointM(const std::vector<TimedViewpoint>& viewpoints, TimeNs time_ns);

void SetViewpoints(const std::vector<Measurement>& measurements,
                   std::vector<TimedViewpoint>* viewpoints);

// Source of the rows of a track. Rows are not stored: there may be millions of them.
struct RowSource {
  int track_id = 0;
  Trajectory trajectory;
  TimeInterval presence;
  CommonErrors common_errors;
  std::vector<TimedViewpoint> viewpoints;  // ascending; that nearest in time defines the ray
  std::vector<CovarianceInflation> covariance_inflations;  // ascending; interpolated linearly
  double max_sigma_m = 0.0;
  std::vector<FrameSupport> support;
};

// Emits one row per instant within the presence, unless the largest sigma exceeds max_sigma_m or a
// number is not finite. The support of a row is the number of returns of the target in frames whose
// stamps are closest to it; ties go to the earlier row. (Stamps, because the middle of a frame lies
// halfway between two rows, so that jitter would decide.) The sum over the rows is the number of
// returns. Both arguments must outlive it.
class RowSampler {
 public:
  RowSampler(const RowSource& source, const OutputInstants& instants);

  // Returns the next row in time order; none after the last.
  std::optional<TrajectoryRow> Next();

 private:
  std::optional<TrajectoryRow> Sample();
  Eigen::Vector3d VarianceInflationAt(TimeNs time_ns) const;

  const RowSource& source_;
  const OutputInstants& instants_;
  std::size_t instant_;
  std::vector<FrameSupport>::const_iterator support_;
  std::optional<TrajectoryRow> ahead_;  // support depends on the next row
};

// Returns the next row, none after the last one, as RowSampler::Next() does.
using RowStream = std::function<std::optional<TrajectoryRow>()>;

// Length of the path between first and last measurement.
double PathLength(const Trajectory& trajectory);

}  // namespace unlidar
