// Scene of one station: structure, ground, support, and the plots that they do not explain.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/recording.hpp"
#include "scene/ground.hpp"
#include "scene/occupancy.hpp"
#include "scene/plots.hpp"
#include "scene/support.hpp"
#include "scene/watched_elevations.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Learns the surroundings of a station from its frames, then finds the plots of a frame. Positions
// are relative to the viewpoint of the station, where its sensors were first.
class StationScene {
 public:
  // Buffers of Fit(), reused between stations.
  struct FitWorkspace {
    std::vector<Eigen::Vector3f> points_m;
    Ground::Workspace ground;
    Support::Workspace support;
  };

  // The frame whose plots are to be found, and buffers that are reused from frame to frame.
  struct FrameWorkspace {
    Recording frame;  // of this frame alone
    FramePlotter plotter;
    std::vector<Occupancy::Verdict> verdicts;  // (returns)
    std::vector<std::uint32_t> candidates;     // returns that may belong to plots or bodies
    Linker linker;
    std::vector<char> are_strays;     // (returns)
    std::size_t num_unexplained = 0;  // number of candidates
  };

  // `config` must outlive it.
  explicit StationScene(const RobustConfig& config);

  // Learns from a frame, whose bin is not before that of earlier ones by more than a few.
  void Learn(PointsView points_m, std::int64_t bin, const CarrierPose& carrier);

  // Fits ground and support to the places learned so far.
  void Fit(FitWorkspace* workspace);

  // The same in two halves, to be called one after the other once it is fitted.
  void FitGround(FitWorkspace* workspace);
  void FillSupport(FitWorkspace* workspace);

  // True after Fit().
  bool is_fitted() const { return fitted_ != nullptr; }

  // Returns the plots and bodies of the frame in the workspace, one that was learned; valid until
  // the next call. Sets the place rates of the plots, and makes the returns of the frame relative
  // to its own viewpoint.
  FramePlots& FindPlots(std::int64_t bin, bool is_newest, const Occupancy::IsTargetSince& is_target,
                        FrameWorkspace* workspace);

  const Occupancy& occupancy() const { return occupancy_; }
  const Support& support() const { return fitted_->support; }

  // Erases places that were not hit for long.
  void Sweep() { occupancy_.Sweep(); }

 private:
  void DropStrays(FrameWorkspace* workspace) const;
  void SetWatchedBelow(const CarrierPose& carrier, Plot* plot) const;
  void SetPlaceRate(const FrameWorkspace& workspace, const IndexView& returns, Plot* plot) const;

  // Ground and support as of the last fit.
  struct Fitted {
    explicit Fitted(const RobustConfig& config) : support(ground, config.support) {}
    Fitted(const Fitted&) = delete;
    Fitted& operator=(const Fitted&) = delete;

    Ground ground;
    Support support;
  };

  const RobustConfig* config_;
  Occupancy occupancy_;
  std::vector<Eigen::Vector3f> first_returns_m_;  // for the lowest elevation, until fitted
  double lowest_elevation_rad_ = 0.0;
  WatchedElevations watched_;
  std::unique_ptr<Fitted> fitted_;
  int num_fits_ = 0;
};

}  // namespace unlidar
