// Occupancy learned from a whole recording.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "base/recording.hpp"
#include "scene/occupancy.hpp"
#include "scene/stations.hpp"
#include "scene/time_bins.hpp"

namespace unlidar::testing {

inline bool NeverFloats(const Eigen::Vector3f&) { return false; }

// Judges one return.
inline Occupancy::Verdict JudgeOne(Occupancy* occupancy, const Eigen::Vector3f& point_m,
                                   std::int64_t bin,
                                   const Occupancy::IsTargetSince& is_target = nullptr) {
  std::vector<Occupancy::Verdict> verdicts;
  occupancy->Judge(std::vector<Eigen::Vector3f>{point_m}, bin, {}, 0, NeverFloats, is_target,
                   &verdicts);
  return verdicts.front();
}

// As a station learns it; the places are relative to the origin.
class LearnedOccupancy {
 public:
  explicit LearnedOccupancy(const Recording& recording,
                            const BackgroundConfig& config = BackgroundConfig())
      : bins_(recording.frames, recording.sensors.size()), occupancy_(config) {
    for (const FrameInfo& frame : recording.frames) {
      const std::uint32_t bin = bins_.BinOf(frame.middle_ns());
      const auto begin = recording.points_m.begin();
      const std::vector<Eigen::Vector3f> points_m(begin + frame.first_return,
                                                  begin + frame.last_return);
      bin_of_.insert(bin_of_.end(), points_m.size(), bin);
      occupancy_.AddFrame(points_m, bin);
    }
    occupancy_.JudgeAll();
  }

  // Judges one return of the recording.
  Occupancy::Verdict Judge(const Recording& recording, std::size_t i) {
    return JudgeOne(&occupancy_, recording.points_m[i], bin_of_[i]);
  }

  // Judges all returns in order.
  std::vector<Occupancy::Verdict> Verdicts(const Recording& recording) {
    std::vector<Occupancy::Verdict> verdicts;
    for (std::size_t i = 0; i < bin_of_.size(); ++i) verdicts.push_back(Judge(recording, i));
    return verdicts;
  }

  const TimeBins& bins() const { return bins_; }
  const Occupancy& occupancy() const { return occupancy_; }

  // Points into this object.
  StationModel ModelAt(const Eigen::Vector3f& viewpoint_m = Eigen::Vector3f::Zero()) const {
    return {viewpoint_m, &bins_, &occupancy_};
  }

 private:
  TimeBins bins_;
  std::vector<std::uint32_t> bin_of_;  // (returns)
  Occupancy occupancy_;
};

}  // namespace unlidar::testing
