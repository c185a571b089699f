// Scene of one station: structure, ground, support, and the plots that they do not explain.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/recording.hpp"
#include "scene/field_of_view.hpp"
#include "scene/occupancy.hpp"
#include "scene/plots.hpp"
#include "scene/shell_table.hpp"
#include "scene/support.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Learns the surroundings of a station from its frames, then finds the plots of a frame. Positions
// are relative to the viewpoint of the station, where its sensors were first.
class StationScene {
 public:
  // `config` must outlive it.
  explicit StationScene(const RobustConfig& config);

  // Learns from a frame, whose bin is not before that of earlier ones by more than a few. Sets
  // `voxels`, if any, for FindPlots().
  void Learn(PointsView points_m, std::int64_t bin, const CarrierPose& carrier,
             OwnVoxels* voxels = nullptr);

  // Fits ground and support to the places learned so far.
  void Fit();

  // The same in two halves, to be called one after the other once it is fitted.
  void FitGround();
  void FillSupport();

  bool is_fitted() const { return num_fits_ > 0; }

  // Returns the plots and bodies of a frame that was learned, the only one of `frame`; valid until
  // the next call. Sets the place rates of the plots, and makes the returns of the frame relative
  // to its own viewpoint.
  FramePlots& FindPlots(std::int64_t bin, const OwnVoxels& voxels,
                        const Occupancy::IsTargetSince& is_target, Recording* frame);

  // Of that frame: the returns of a plot, the verdicts on all returns, and the number of those that
  // may belong to plots or bodies.
  IndexView ReturnsOf(std::size_t plot) const { return plotter_.ReturnsOf(plot); }
  const std::vector<Occupancy::Verdict>& verdicts() const { return verdicts_; }
  std::size_t num_unexplained() const { return num_unexplained_; }

  const Occupancy& occupancy() const { return occupancy_; }
  const Support& support() const { return support_; }

  // Erases places that were not hit for long.
  void Sweep() { occupancy_.Sweep(); }

 private:
  void DropStrays(const std::vector<Eigen::Vector3f>& points_m);
  double MeanStrayRate(const IndexView& returns) const;
  void SetAboveStructure(const Eigen::Vector3f& shift_m, Plot* plot) const;
  void SetWatched(const CarrierPose& carrier, Plot* plot) const;
  void SetPlaceRate(const IndexView& returns, Plot* plot) const;

  const RobustConfig* config_;
  Occupancy occupancy_;
  std::vector<Eigen::Vector3f> first_returns_m_;  // for the lowest elevation, until fitted
  double lowest_elevation_rad_ = 0.0;
  WatchedElevations watched_;
  SightDensity sight_density_;
  Support support_;  // and ground, as of the last fit
  int num_fits_ = 0;
  std::vector<Eigen::Vector3f> structure_m_;  // buffers of fits
  std::vector<char> are_lasting_;
  // Of the last frame whose plots were found.
  FramePlotter plotter_;
  std::vector<Occupancy::Verdict> verdicts_;  // (returns)
  std::vector<std::uint32_t> candidates_;     // returns that may belong to plots or bodies
  std::size_t num_unexplained_ = 0;           // of these, before bodies are found
  Linker linker_;                             // of groups among strays
  std::vector<char> are_strays_;              // (returns)
};

}  // namespace unlidar
