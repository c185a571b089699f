#include "scene/ego_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "scene/sampled_returns.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {
namespace {

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
      if (snapshot.cells[CellAt(x, y)] && number++ % step == 0) sampled_.push_back({x, y});
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
    for (const Cell& cell : transformed_) hits += raster_[RasterIndex(cell.x + x, cell.y + y)];
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
      const double x = sampled_[i].x + 0.5;
      const double y = sampled_[i].y + 0.5;
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

}  // namespace unlidar
