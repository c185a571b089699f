#include "scene/sensor_health.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "base/angles.hpp"
#include "scene/sampled_returns.hpp"
#include "scene/time_bins.hpp"

namespace unlidar {
namespace {

constexpr int kSnapshotsToChange = 6;
constexpr double kMinSnapshots = 10.0;      // to know the expected structure
constexpr double kMinSnapshotsAnew = 60.0;  // to conclude that a sensor was moved
constexpr double kMaxSnapshots = 28'800;    // four hours

// Directions are 5 degrees wide at the horizon. A surface fills one or two range cells of a
// direction, each 15 % long, fog all of them; they are so small that 1,000 strays per frame seldom
// hit one twice.
constexpr std::size_t kHeights = 36;
constexpr std::size_t kDirections = kAzimuthColumns * kHeights;
constexpr std::size_t kRanges = 48;
constexpr float kNearestM = 0.5F;
const float kRangesPerLog2 = 1.0F / std::log2(1.15F);

constexpr float kAirM = 30.0F;  // flakes and drops return nothing from beyond
constexpr float kStructureRate = 0.6F;
// Minimum numbers of places and directions for a decision: with fewer, a person may hide most.
constexpr double kMinStructure = 40.0;
constexpr int kMinDirections = 60;
// In clear air at least 0.97 of the structure is seen and 0.1 to 0.7 places per direction change
// between snapshots; with 300 strays per frame 1.0 to 2.8, with 1,000 in fog or snow 5.3. A sensor
// is blinded below the first limit or above the second; kMargin is the hysteresis for recovery.
constexpr double kMinSeenRatio = 0.5;
constexpr double kMaxStraysPerDirection = 4.0;
constexpr double kMargin = 0.8;
constexpr double kMaxNearShare = 0.8;       // share of the directions
constexpr double kMinStructureRatio = 0.6;  // of the structure known before

std::size_t RangeOf(float range_m) {
  const float at = std::log2(std::max(range_m, kNearestM) / kNearestM) * kRangesPerLog2;
  return std::min(static_cast<std::size_t>(at), kRanges - 1);
}

std::size_t PlaceOf(const Eigen::Vector3f& relative_m) {
  const float range_m = std::max(relative_m.norm(), kNearestM);
  const float height = 0.5F * (relative_m.z() / range_m + 1.0F);
  const auto row =
      std::min(static_cast<std::size_t>(height * static_cast<float>(kHeights)), kHeights - 1);
  return (row * kAzimuthColumns + AzimuthColumn(relative_m)) * kRanges + RangeOf(range_m);
}

const std::size_t kWindowRange = RangeOf(kOwnRangeM);
const std::size_t kAirRange = RangeOf(kAirM);

}  // namespace

SensorHealth::SensorHealth()
    : hits_(kDirections * kRanges, 0), hits_before_(hits_), has_returned_(kDirections, 0) {
  reference_.rates.resize(hits_.size(), 0.0F);
}

void SensorHealth::AddFrame(const SensorInfo& sensor, TimeNs time_ns, PointsView points_m) {
  if (sensor.carrier != nullptr) return;
  const TimeNs passed_ns = time_ns - std::exchange(last_ns_, time_ns);
  if (is_blinded_ && passed_ns > 0) blinded_ns_ += std::min(passed_ns, 2 * kBinNs);
  const TimeNs elapsed_ns = time_ns - snapshot_begin_ns_;
  if (frames_ > 0 && (passed_ns < 0 || elapsed_ns >= kBinNs)) EndSnapshot();
  if (frames_ == 0) {  // snapshots are contiguous unless frames are farther apart
    const bool is_contiguous = elapsed_ns >= kBinNs && elapsed_ns < 2 * kBinNs;
    snapshot_begin_ns_ = is_contiguous ? snapshot_begin_ns_ + kBinNs : time_ns;
  }
  ++frames_;
  const std::size_t step = SampleStep(points_m.size(), kWatchedReturns);
  for (std::size_t i = 0; i < points_m.size(); i += step) {
    const std::size_t place = PlaceOf(points_m[i] - sensor.origin_m);
    hits_[place] = 1;
    has_returned_[place / kRanges] = 1;
    ++returns_;
  }
}

SensorHealth::Snapshot SensorHealth::CompareWith(const OccupancyModel& model) const {
  Snapshot snapshot;
  snapshot.returns = returns_;
  for (std::size_t first = 0; first < hits_.size(); first += kRanges) {
    if (has_returned_[first / kRanges] == 0) continue;
    bool is_hit = false;
    bool is_known = false;
    bool is_hit_beyond = false;
    for (std::size_t range = 0; range < kRanges; ++range) {
      const bool is_place_hit = hits_[first + range] != 0;
      is_hit |= is_place_hit;
      if (range <= kWindowRange) continue;
      is_hit_beyond |= is_place_hit;
      const auto rate = static_cast<double>(model.rates[first + range]);
      if (rate >= static_cast<double>(kStructureRate)) {
        is_known = true;
        snapshot.expected += rate;
        snapshot.seen += is_place_hit ? 1.0 : 0.0;
      }
      const bool was_hit = hits_before_[first + range] != 0;
      snapshot.strays += range < kAirRange && is_place_hit != was_hit ? 1 : 0;
    }
    snapshot.directions += is_hit || is_known ? 1 : 0;
    snapshot.near_directions += is_hit && !is_hit_beyond ? 1 : 0;
  }
  return snapshot;
}

bool SensorHealth::IsDegraded(const Snapshot& snapshot) const {
  const double margin = is_blinded_ ? kMargin : 1.0;
  if (snapshot.directions >= kMinDirections &&
      (snapshot.near_directions > margin * kMaxNearShare * snapshot.directions ||
       snapshot.strays > margin * kMaxStraysPerDirection * snapshot.directions)) {
    return true;
  }
  if (reference_.snapshots < kMinSnapshots) return false;
  if (snapshot.expected >= kMinStructure &&
      snapshot.seen * margin < kMinSeenRatio * snapshot.expected) {
    return true;
  }
  return snapshot.returns == 0 && mean_returns_ >= kMinStructure;
}

void SensorHealth::Update(OccupancyModel* model) const {
  model->snapshots = std::min(model->snapshots + 1.0, kMaxSnapshots);
  const auto weight = static_cast<float>(1.0 / model->snapshots);
  for (std::size_t first = 0; first < hits_.size(); first += kRanges) {
    if (has_returned_[first / kRanges] == 0) continue;
    for (std::size_t i = first; i < first + kRanges; ++i) {
      model->rates[i] += weight * (static_cast<float>(hits_[i]) - model->rates[i]);
    }
  }
}

void SensorHealth::EndSnapshot() {
  const Snapshot snapshot = CompareWith(reference_);
  const bool is_degraded = IsDegraded(snapshot);
  contrary_snapshots_ = is_degraded == is_blinded_ ? 0 : contrary_snapshots_ + 1;
  if (contrary_snapshots_ >= kSnapshotsToChange) {
    is_blinded_ = is_degraded;
    contrary_snapshots_ = 0;
    candidate_ = {};
    if (is_blinded_) candidate_.rates.resize(hits_.size(), 0.0F);
  }
  if (is_blinded_) {
    Update(&candidate_);
    const double num_expected = CompareWith(candidate_).expected;
    if (candidate_.snapshots >= kMinSnapshotsAnew && num_expected >= kMinStructure &&
        num_expected >= kMinStructureRatio * snapshot.expected) {
      reference_ = std::exchange(candidate_, {std::vector<float>(hits_.size(), 0.0F), 0.0});
    }
  } else if (!is_degraded) {
    Update(&reference_);
    mean_returns_ += (snapshot.returns - mean_returns_) / reference_.snapshots;
  }
  hits_before_.swap(hits_);
  std::fill(hits_.begin(), hits_.end(), 0);
  frames_ = 0;
  returns_ = 0;
}

}  // namespace unlidar
