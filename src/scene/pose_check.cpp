#include "scene/pose_check.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/format.hpp"
#include "scene/sampled_returns.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {
namespace {

// Of EgoMotion.

constexpr TimeNs kSnapshotSpanNs = 200'000'000;
constexpr std::array<TimeNs, 3> kLagsNs = {kBinNs, 4 * kBinNs, 16 * kBinNs};
constexpr TimeNs kMaxPauseNs = 10'000'000'000;  // a longer pause resets the state

// Snapshots that are kept: more than the longest lag spans.
constexpr auto kNumSnapshots = static_cast<std::size_t>(kLagsNs.back() / kBinNs) + 4;

constexpr float kUprightM = 0.5F;  // more than any ground rises across a cell

// Search range: shifts, in cells, and turns between two snapshots.
constexpr int kShift = 16;
constexpr int kTurns = 15;  // to either side
constexpr double kTurnDeg = 2.0;
constexpr int kRasterReach = EgoMotion::kReach + kShift + 3;  // of turned and shifted cells
constexpr int kRasterSide = 2 * kRasterReach;

constexpr std::size_t kMinSharedCells = 30;
constexpr std::size_t kMaxCells = 100;
// Measured gain of the best motion over none: at most 0.065 for stationary sensors with rain, sway,
// walkers and traffic; 0.19 to 0.77 for sensors that are carried, drive or turn.
constexpr double kMinMatchGain = 0.12;
constexpr double kMinMatch = 0.6;
constexpr int kSnapshotsToConfirm = 4;
// Largest change of a true motion in half a second; chance matches vary by more.
constexpr double kMaxChangeMps = 4.0;
constexpr double kMaxChangeDegPerS = 12.0;

std::size_t RasterIndex(int x, int y) {
  return static_cast<std::size_t>((x + kRasterReach) * kRasterSide + y + kRasterReach);
}

// Of UpDirection.

constexpr TimeNs kCollectNs = 5'000'000'000;
constexpr std::size_t kMaxPointsOfFrame = 1024;
constexpr std::size_t kMaxPoints = 40'000;
constexpr std::size_t kMinPoints = 500;
// Steeper than any ground, so that directions 45 degrees apart cover every orientation.
constexpr double kMaxGroundSlope = 0.5;
constexpr float kRoughM = 1.0F;  // exceeds the roughness of ground
// Objects stand on ground; a plane without any may be a wall.
constexpr double kMinShareAbove = 0.1;
// Cells, and ratio of ground to that of z, required of another direction. With z up, other
// directions have at most 0.53 of the ground of z.
constexpr double kMinGroundCells = 20.0;
constexpr double kMinGroundRatio = 2.0;
// A floor is flat and at most the height of a hall below. In a hall or under a roof, a visible
// floor has at least 4 cells; outdoor scenes turned upside down have at most 0.2. A LiDAR on its
// side may mistake a facade for a floor.
constexpr double kMaxFloorSlope = 0.2;
constexpr double kFloorBandM = 0.1;
constexpr double kMinFloorCells = 4.0;
constexpr double kMaxFloorDepthM = 15.0;

}  // namespace

EgoMotion::EgoMotion()
    : lowest_m_(Cells().size()),
      highest_m_(lowest_m_.size()),
      raster_(static_cast<std::size_t>(kRasterSide) * kRasterSide) {
  sampled_.reserve(2 * kMaxCells);
  transformed_.reserve(2 * kMaxCells);
  ResetHeights();
}

void EgoMotion::AddFrame(TimeNs time_ns, PointsView points_m, const Eigen::Vector3f& origin_m) {
  if (found_) return;
  if (last_ns_ && (time_ns < *last_ns_ || time_ns - *last_ns_ > kMaxPauseNs)) {
    ResetHeights();
    is_recording_ = false;
    snapshots_.clear();
    moving_snapshots_ = 0;
  }
  last_ns_ = time_ns;
  // Tolerance for uneven stamps.
  constexpr TimeNs kSlackNs = kSnapshotSpanNs / 4;
  if (is_recording_ && time_ns >= snapshot_begin_ns_ + kSnapshotSpanNs - kSlackNs) EndSnapshot();
  if (!is_recording_ && (snapshots_.empty() || time_ns >= snapshot_begin_ns_ + kBinNs - kSlackNs)) {
    is_recording_ = true;
    snapshot_begin_ns_ = time_ns;
  }
  if (!is_recording_) return;
  const std::size_t step = SampleStep(points_m.size(), kWatchedReturns);
  for (std::size_t i = 0; i < points_m.size(); i += step) {
    const Eigen::Vector3f relative_m = points_m[i] - origin_m;
    const float level_m = relative_m.head<2>().norm();
    if (!(level_m >= kOwnRangeM && level_m < static_cast<float>(kReach))) continue;
    const std::size_t cell = CellAt(static_cast<int>(std::floor(relative_m.x())),
                                    static_cast<int>(std::floor(relative_m.y())));
    lowest_m_[cell] = std::min(lowest_m_[cell], relative_m.z());
    highest_m_[cell] = std::max(highest_m_[cell], relative_m.z());
  }
}

void EgoMotion::ResetHeights() {
  std::fill(lowest_m_.begin(), lowest_m_.end(), std::numeric_limits<float>::infinity());
  std::fill(highest_m_.begin(), highest_m_.end(), -std::numeric_limits<float>::infinity());
}

void EgoMotion::EndSnapshot() {
  is_recording_ = false;
  if (snapshots_.size() == kNumSnapshots) snapshots_.pop_front();
  Snapshot& snapshot = snapshots_.Append();
  snapshot.time_ns = snapshot_begin_ns_;
  for (std::size_t i = 0; i < snapshot.cells.size(); ++i) {
    snapshot.cells[i] = highest_m_[i] - lowest_m_[i] > kUprightM;
  }
  ResetHeights();
  std::optional<Motion> motion;
  for (const TimeNs lag_ns : kLagsNs) {
    // The newest snapshot of this time before the one just ended.
    const Snapshot* earlier = nullptr;
    for (std::size_t i = snapshots_.size() - 1; i-- > 0 && earlier == nullptr;) {
      const TimeNs apart_ns = snapshots_[i].time_ns - (snapshot.time_ns - lag_ns);
      if (std::abs(apart_ns) <= lag_ns / 5) earlier = &snapshots_[i];
    }
    if (earlier == nullptr || motion) continue;
    if (std::min(snapshot.cells.count(), earlier->cells.count()) < kMinSharedCells) continue;
    const Match match = MatchOf(snapshot, *earlier);
    if (match.moved >= kMinMatch && match.moved - match.stationary >= kMinMatchGain) {
      motion = match.motion;
    }
  }
  const bool is_consistent =
      motion && moving_snapshots_ > 0 &&
      (motion->velocity_mps - motion_.velocity_mps).norm() <= kMaxChangeMps &&
      std::abs(motion->turn_deg_per_s - motion_.turn_deg_per_s) <= kMaxChangeDegPerS;
  moving_snapshots_ = motion ? (is_consistent ? moving_snapshots_ + 1 : 1) : 0;
  motion_ = motion.value_or(Motion());
  if (moving_snapshots_ >= kSnapshotsToConfirm) found_ = motion;
}

EgoMotion::Match EgoMotion::MatchOf(const Snapshot& snapshot, const Snapshot& earlier) {
  std::fill(raster_.begin(), raster_.end(), 0);
  const std::size_t step = (snapshot.cells.count() + kMaxCells - 1) / kMaxCells;
  sampled_.clear();
  std::size_t number = 0;
  for (int x = -kReach; x < kReach; ++x) {
    for (int y = -kReach; y < kReach; ++y) {
      if (snapshot.cells[CellAt(x, y)] && number++ % step == 0) sampled_.emplace_back(x, y);
      if (!earlier.cells[CellAt(x, y)]) continue;
      // Dilated by one cell: rays do not hit the same place twice.
      for (int i = x - 1; i <= x + 1; ++i) {
        for (int j = y - 1; j <= y + 1; ++j) raster_[RasterIndex(i, j)] = 1;
      }
    }
  }
  transformed_ = sampled_;
  const auto share_at = [&](int x, int y) {
    int hits = 0;
    for (const auto& cell : transformed_) hits += raster_[RasterIndex(cell.x() + x, cell.y() + y)];
    return hits / static_cast<double>(transformed_.size());
  };
  Match match;
  match.stationary = match.moved = share_at(0, 0);
  if (match.stationary > 1.0 - kMinMatchGain) return match;
  const double lag_s = SecondsOf(snapshot.time_ns - earlier.time_ns);
  for (int turn = -kTurns; turn <= kTurns; ++turn) {
    const double angle_rad = turn * kTurnDeg * M_PI / 180.0;
    const double c = std::cos(angle_rad);
    const double s = std::sin(angle_rad);
    for (std::size_t i = 0; i < sampled_.size(); ++i) {
      const double x = sampled_[i].x() + 0.5;
      const double y = sampled_[i].y() + 0.5;
      transformed_[i] = {static_cast<int>(std::floor(c * x - s * y)),
                         static_cast<int>(std::floor(s * x + c * y))};
    }
    for (int x = -kShift; x <= kShift; ++x) {
      for (int y = -kShift; y <= kShift; ++y) {
        const double share = share_at(x, y);
        if (share <= match.moved) continue;
        match.moved = share;
        match.motion = {Eigen::Vector2d(x, y) / lag_s, turn * kTurnDeg / lag_s};
      }
    }
  }
  return match;
}

UpDirection::UpDirection() : ground_(kMaxGroundSlope) {
  directions_.emplace_back(Eigen::Vector3f::UnitZ());
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const bool is_z = x == 0 && y == 0 && z >= 0;
        if (is_z) continue;
        directions_.push_back(Eigen::Vector3i(x, y, z).cast<float>().normalized());
      }
    }
  }
}

void UpDirection::AddFrame(TimeNs time_ns, PointsView points_m, const Eigen::Vector3f& origin_m) {
  if (IsDone()) return;
  if (points_m.size() > 0 && !begin_ns_) begin_ns_ = time_ns;
  const bool is_over =
      begin_ns_ && time_ns - *begin_ns_ >= kCollectNs && points_m_.size() >= kMinPoints;
  if (is_over || points_m_.size() >= kMaxPoints) return TestNext();
  const std::size_t step = std::max<std::size_t>(1, points_m.size() / kMaxPointsOfFrame);
  for (std::size_t i = 0; i < points_m.size(); i += step) {
    points_m_.push_back(points_m[i] - origin_m);
  }
}

UpDirection::Evidence UpDirection::EvidenceOf(const Eigen::Vector3f& up, double min_cells) {
  const Eigen::Matrix3f rotation =
      Eigen::Quaternionf::FromTwoVectors(up, Eigen::Vector3f::UnitZ()).toRotationMatrix();
  rotated_m_.clear();
  for (const Eigen::Vector3f& point_m : points_m_) rotated_m_.push_back(rotation * point_m);
  ground_.Fit(rotated_m_);
  Evidence evidence;
  if (ground_.support() < min_cells) return evidence;
  double above = 0.0;
  double below = 0.0;
  for (const Eigen::Vector3f& point_m : rotated_m_) {
    const double height_m = ground_.HeightAbove(point_m);
    above += height_m > kRoughM ? 1.0 : 0.0;
    below += height_m < -kRoughM ? 1.0 : 0.0;
  }
  const auto all = static_cast<double>(points_m_.size());
  evidence.ground = ground_.support() * (all - above - below) / all * (all - below) / all;
  if (below > above) evidence.ground *= above / below;  // objects hang from it: a ceiling
  evidence.has_objects_above = above >= kMinShareAbove * all;
  return evidence;
}

bool UpDirection::HasFloor() {
  rotated_m_.clear();
  for (const Eigen::Vector3f& point_m : points_m_) {
    if (point_m.z() < -static_cast<float>(kGroundThicknessM)) rotated_m_.push_back(point_m);
  }
  Ground floor(kMaxFloorSlope);
  floor.Fit(rotated_m_);
  return floor.FlatSupport(kFloorBandM) >= kMinFloorCells && floor.height_m() > -kMaxFloorDepthM;
}

void UpDirection::TestNext() {
  const auto finish = [&] {
    step_ = std::numeric_limits<std::size_t>::max();
    points_m_ = {};
    rotated_m_ = {};
  };
  if (points_m_.size() < kMinPoints || (step_ == 0 && HasFloor())) return finish();
  if (step_ == 1) {
    best_ground_ = kMinGroundRatio * EvidenceOf(directions_.front(), 0.0).ground;
  } else if (step_ > 1) {
    const Eigen::Vector3f& up = directions_[step_ - 1];
    const Evidence evidence = EvidenceOf(up, std::max(kMinGroundCells, best_ground_));
    if (evidence.has_objects_above && evidence.ground > best_ground_) {
      best_ground_ = evidence.ground;
      best_up_ = up;
    }
  }
  if (++step_ > directions_.size()) finish();
}

void PoseCheck::AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m) {
  up_.AddFrame(time_ns, points_m, sensor.origin_m);
  if (sensor.carrier == nullptr) motion_.AddFrame(time_ns, points_m, sensor.origin_m);
}

std::vector<Warning> PoseCheck::WarningsOf(const std::string& sensor) const {
  std::vector<Warning> warnings;
  if (const auto& motion = motion_.found()) {
    warnings.push_back(
        {"sensor_moves",
         sensor + ": the LiDAR moves (about " + FixedText(motion->velocity_mps.norm(), 1) +
             " m/s, " + FixedText(std::abs(motion->turn_deg_per_s), 0) +
             " degrees/s): drones are found only from one that stands still, or whose poses "
             "are known (--poses)"});
  }
  const auto up = up_.found();
  if (up && up->z() < -0.9F) {
    warnings.push_back(
        {"upside_down", sensor + ": upside down: the ground is above; z must point up (sensors." +
                            sensor + ".rotation), positions and tracks are wrong"});
  } else if (up) {
    std::string axes;
    for (const float value : *up) axes += (axes.empty() ? "" : ", ") + FixedText(value, 1);
    warnings.push_back(
        {"z_not_up", sensor + ": z does not point up: the ground says that up is about (" + axes +
                         "); turn it by sensors." + sensor +
                         ".rotation, positions and tracks are wrong"});
  }
  return warnings;
}

}  // namespace unlidar
