// Rows of a fitted trajectory at the output times.
#pragma once

#include <vector>

#include "unlidar/trajectory.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct TimeInterval {
  TimeNs begin_ns = 0;
  TimeNs end_ns = 0;
};

// How long a target may have gone unseen before its first and after its last measurement: as long
// as a silence is likelier than `probability`.
TimeNs SilenceBeforeNs(const std::vector<Measurement>& measurements, TimeNs period_ns,
                       double probability);
TimeNs SilenceAfterNs(const std::vector<Measurement>& measurements, TimeNs period_ns,
                      double probability);

// When a target was there: from first to last measurement, widened to the whole frames, of any
// sensor, in which they lie (a stamp names all of its frame, whose returns were measured a little
// before or after it), and further by a silence that is likelier than `silence_probability`: a
// drone that is hit in one frame of five was there for some frames before the first hit. One that
// is hit in every frame was not, nor is any with a silence_probability of 1. Ends with the
// recording.
TimeInterval PresenceInterval(const Recording& recording,
                              const std::vector<Measurement>& measurements,
                              double silence_probability);

// One row per output time inside the interval, except where the largest sigma exceeds max_sigma_m
// or a number is not finite. `times_ns` ascends. All rows share an error of depth_sigma_m along the
// ray from the origin.
std::vector<TrajectoryRow> SampleTrajectory(const Trajectory& trajectory,
                                            const TimeInterval& interval,
                                            const std::vector<TimeNs>& times_ns,
                                            double depth_sigma_m, double max_sigma_m);

// Sets the support of each row: the returns of the target whose frames' stamps are nearer to it
// than to any other row, the earlier one of two equally near. (The middle of a frame lies halfway
// between two stamps: by it, jitter would decide.) The sum over the rows is the number of returns.
void CountSupport(const Recording& recording, const std::vector<std::uint32_t>& returns,
                  std::vector<TrajectoryRow>& rows);

// Length of the path between first and last measurement.
double PathLength(const Trajectory& trajectory);

}  // namespace unlidar
