#include "scene/ego_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace unlidar {
namespace {

constexpr TimeNs kEveryNs = 500'000'000;
constexpr TimeNs kLookSpanNs = 200'000'000;
constexpr std::array<TimeNs, 3> kLagsNs = {500'000'000, 2'000'000'000, 8'000'000'000};
constexpr std::ptrdiff_t kMostOfLook = 8192;  // of a frame, evenly spread
constexpr TimeNs kForgetNs = 10'000'000'000;  // after it, nothing that was seen before counts

constexpr std::size_t kLooksKept = 20;  // more than the longest lag has

constexpr float kStationM = 1.0F;  // the station itself
constexpr float kUprightM = 0.5F;  // steeper than any ground across a cell

// Tried: shifts and turns between two looks.
constexpr int kShift = 16;
constexpr int kTurns = 15;  // to either side,
constexpr double kTurnDeg = 2.0;
constexpr int kDrawnReach = 40 + kShift + 3;  // of cells turned and shifted
constexpr int kDrawnSide = 2 * kDrawnReach;

constexpr std::size_t kLeastCells = 30;
constexpr std::size_t kMostCells = 100;
// A sensor that stands matches at most 0.065 better moved, with rain, sway, walkers and traffic;
// one that is carried, drives or turns matches 0.19 to 0.77 better.
constexpr double kLeastGain = 0.12;
constexpr double kLeastMatch = 0.6;
constexpr int kLooksToTell = 4;
// What sensors change in half a second, and matches of what has no order do not keep to.
constexpr double kMostChangeMps = 4.0;
constexpr double kMostChangeDegPerS = 12.0;

std::size_t DrawnAt(int x, int y) {
  return static_cast<std::size_t>((x + kDrawnReach) * kDrawnSide + y + kDrawnReach);
}

bool AreAlike(const EgoMotion::Motion& a, const EgoMotion::Motion& b) {
  return (a.velocity_mps - b.velocity_mps).norm() <= kMostChangeMps &&
         std::abs(a.turn_deg_per_s - b.turn_deg_per_s) <= kMostChangeDegPerS;
}

}  // namespace

EgoMotion::EgoMotion()
    : lowest_m_(Cells().size()),
      highest_m_(lowest_m_.size()),
      looks_(kLooksKept),
      drawn_(static_cast<std::size_t>(kDrawnSide) * kDrawnSide) {
  some_.reserve(2 * kMostCells);
  turned_.reserve(2 * kMostCells);
  matches_.reserve(kLagsNs.size());
  ForgetCollected();
}

void EgoMotion::AddFrame(TimeNs time_ns, const Eigen::Vector3f* begin_m,
                         const Eigen::Vector3f* end_m, const Eigen::Vector3f& origin_m) {
  if (found_) return;
  if (last_ns_ && (time_ns < *last_ns_ || time_ns - *last_ns_ > kForgetNs)) {
    ForgetCollected();
    is_looking_ = false;
    num_looks_ = 0;
    looks_in_motion_ = 0;
  }
  last_ns_ = time_ns;
  // With a tolerance, since stamps are not even.
  constexpr TimeNs kSlackNs = kLookSpanNs / 4;
  if (is_looking_ && time_ns >= look_begin_ns_ + kLookSpanNs - kSlackNs) EndLook();
  if (!is_looking_ && (num_looks_ == 0 || time_ns >= look_begin_ns_ + kEveryNs - kSlackNs)) {
    is_looking_ = true;
    look_begin_ns_ = time_ns;
  }
  if (is_looking_) Collect(begin_m, end_m, origin_m);
}

void EgoMotion::ForgetCollected() {
  std::fill(lowest_m_.begin(), lowest_m_.end(), std::numeric_limits<float>::infinity());
  std::fill(highest_m_.begin(), highest_m_.end(), -std::numeric_limits<float>::infinity());
}

void EgoMotion::Collect(const Eigen::Vector3f* begin_m, const Eigen::Vector3f* end_m,
                        const Eigen::Vector3f& origin_m) {
  const std::ptrdiff_t step = std::max<std::ptrdiff_t>(1, (end_m - begin_m) / kMostOfLook);
  for (std::ptrdiff_t i = 0; i < end_m - begin_m; i += step) {
    const Eigen::Vector3f relative_m = begin_m[i] - origin_m;
    const float level_m = relative_m.head<2>().norm();
    if (!(level_m >= kStationM && level_m < static_cast<float>(kReach))) continue;
    const std::size_t cell = CellAt(static_cast<int>(std::floor(relative_m.x())),
                                    static_cast<int>(std::floor(relative_m.y())));
    lowest_m_[cell] = std::min(lowest_m_[cell], relative_m.z());
    highest_m_[cell] = std::max(highest_m_[cell], relative_m.z());
  }
}

void EgoMotion::EndLook() {
  is_looking_ = false;
  Look& look = looks_[num_looks_ % kLooksKept];
  look.time_ns = look_begin_ns_;
  for (std::size_t i = 0; i < look.cells.size(); ++i) {
    look.cells[i] = highest_m_[i] - lowest_m_[i] > kUprightM;
  }
  ForgetCollected();
  matches_.clear();
  std::optional<Motion> motion;
  for (const TimeNs lag_ns : kLagsNs) {
    const Look* const earlier = LookBefore(look.time_ns - lag_ns, lag_ns / 5);
    if (earlier == nullptr || motion) continue;
    if (std::min(look.cells.count(), earlier->cells.count()) < kLeastCells) continue;
    matches_.push_back(MatchOf(look, *earlier));
    const Match& match = matches_.back();
    if (match.moved >= kLeastMatch && match.moved - match.as_it_is >= kLeastGain) {
      motion = match.motion;
    }
  }
  ++num_looks_;
  const bool goes_on = motion && looks_in_motion_ > 0 && AreAlike(*motion, motion_);
  looks_in_motion_ = motion ? (goes_on ? looks_in_motion_ + 1 : 1) : 0;
  motion_ = motion.value_or(Motion());
  if (looks_in_motion_ >= kLooksToTell) found_ = motion;
}

// The newest look of about this time, but for the one that has just ended; null if there is none.
const EgoMotion::Look* EgoMotion::LookBefore(TimeNs time_ns, TimeNs tolerance_ns) const {
  const std::size_t known = std::min(num_looks_, kLooksKept - 1);
  for (std::size_t ago = 1; ago <= known; ++ago) {
    const Look& look = looks_[(num_looks_ - ago) % kLooksKept];
    if (std::abs(look.time_ns - time_ns) <= tolerance_ns) return &look;
  }
  return nullptr;
}

// Each cell with those about it: rays do not hit the same place twice.
void EgoMotion::Draw(const Look& look) {
  std::fill(drawn_.begin(), drawn_.end(), 0);
  for (int x = -kReach; x < kReach; ++x) {
    for (int y = -kReach; y < kReach; ++y) {
      if (!look.cells[CellAt(x, y)]) continue;
      for (int i = x - 1; i <= x + 1; ++i) {
        for (int j = y - 1; j <= y + 1; ++j) drawn_[DrawnAt(i, j)] = 1;
      }
    }
  }
}

EgoMotion::Match EgoMotion::MatchOf(const Look& look, const Look& earlier) {
  Draw(earlier);
  const std::size_t step = (look.cells.count() + kMostCells - 1) / kMostCells;
  some_.clear();
  std::size_t number = 0;
  for (int x = -kReach; x < kReach; ++x) {
    for (int y = -kReach; y < kReach; ++y) {
      if (look.cells[CellAt(x, y)] && number++ % step == 0) some_.push_back({x, y});
    }
  }
  turned_ = some_;
  const auto share_at = [&](int x, int y) {
    int hits = 0;
    for (const Cell& cell : turned_) hits += drawn_[DrawnAt(cell.x + x, cell.y + y)];
    return hits / static_cast<double>(turned_.size());
  };
  Match match;
  match.as_it_is = match.moved = share_at(0, 0);
  if (match.as_it_is > 1.0 - kLeastGain) return match;
  const double lag_s = static_cast<double>(look.time_ns - earlier.time_ns) * kSecondsPerNs;
  for (int turn = -kTurns; turn <= kTurns; ++turn) {
    const double angle_rad = turn * kTurnDeg * M_PI / 180.0;
    const double c = std::cos(angle_rad);
    const double s = std::sin(angle_rad);
    for (std::size_t i = 0; i < some_.size(); ++i) {
      const double x = some_[i].x + 0.5;
      const double y = some_[i].y + 0.5;
      turned_[i] = {static_cast<int>(std::floor(c * x - s * y)),
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
