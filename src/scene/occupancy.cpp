#include "scene/occupancy.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "scene/time_bins.hpp"

namespace unlidar {
namespace {

// The number of bins that must be exposed, a share of those observed, grows up to this many.
constexpr int kEnoughBins = RecentBins::kWindow / 2;
constexpr double kEnoughFromMoving = 1.0;  // the same of a carrier that moves
constexpr int kSettledBins = 10;           // observed bins from which structure is kept for a while
constexpr int kKeptBins = 5;               // bins after which structure is judged again
constexpr int kJudgingTurns = 64;          // turns of a bin: more than it has frames
constexpr std::size_t kMaxEmptyAdjacent = 2;  // of the six adjacent places, may be empty by chance
// With fewer observed bins, any place that is still being hit may be a support.
constexpr int kYoungBins = 20;
constexpr double kSupportingHits = 3.0;
constexpr double kSupportingShare = 0.5;  // of the hits of structure

}  // namespace

Occupancy::Occupancy(const BackgroundConfig& config, bool knows_strays)
    : config_(config),
      knows_strays_(knows_strays),
      max_break_(static_cast<int>(config.max_dwell_gap_s / kBinS)),
      frame_counts_(RecentBins::kWindow, 0),
      places_(config.place) {}

void Occupancy::AddFrame(PointsView points_m, std::int64_t bin, const CarrierPose& carrier,
                         OwnVoxels* voxels) {
  has_many_returns_ = points_m.size() > kManyReturns;
  CountFrame(bin);
  occlusion_.Add(points_m, bin, carrier);
  const std::int64_t age = newest_ - bin;
  if (age < 0 || age >= RecentBins::kWindow) return;
  Place unknown;
  unknown.bin = newest_;
  const auto add = [&](std::size_t i, Place& place, bool is_own) {
    if (place.bin != newest_) Age(&place);
    ++place.num_returns;
    if (place.hits.Contains(static_cast<int>(age))) return;
    place.hits.Insert(static_cast<int>(age));
    place.point_m = points_m[i];
    place.is_own = is_own;
  };
  places_.VisitOverlappingShells(points_m, unknown, add, voxels);
}

void Occupancy::CountFrame(std::int64_t bin) {
  if (bin > newest_) {
    const std::int64_t passed = std::min<std::int64_t>(bin - newest_, RecentBins::kWindow);
    for (std::int64_t b = bin - passed + 1; b <= bin; ++b) {
      num_frames_ -= std::exchange(frame_counts_[RecentBins::SlotOf(b)], 0U);
    }
    observed_.Age(bin - newest_);
    newest_ = static_cast<std::int32_t>(bin);
  }
  const std::int64_t age = newest_ - bin;
  if (age >= RecentBins::kWindow) return;
  observed_.Insert(static_cast<int>(age));
  ++frame_counts_[RecentBins::SlotOf(bin)];
  ++num_frames_;
  // The newest bin is expected to get as many frames as the one before.
  const std::uint32_t count = frame_counts_[RecentBins::SlotOf(newest_)];
  const std::uint32_t expected = newest_ > 0 ? frame_counts_[RecentBins::SlotOf(newest_ - 1)] : 0;
  turns_ = expected == 0 ? kJudgingTurns : static_cast<int>(kJudgingTurns * count / expected);
}

void Occupancy::Age(Place* place) const {
  place->hits.Age(newest_ - place->bin);
  place->bin = newest_;
}

double Occupancy::RateAround(const Eigen::Vector3f& point_m, std::int64_t bin,
                             double least_rate) const {
  const std::int64_t age = newest_ - bin;
  if (age < 0 || age >= RecentBins::kWindow) return least_rate;
  const Dwell dwell = DwellAt(HitsAround(point_m), static_cast<int>(age), max_break_);
  const int exposed = observed_.SizeOutside(dwell.youngest, dwell.oldest);
  if (exposed == 0) return least_rate;
  const auto step_m = static_cast<float>(std::pow(places_.VolumeM3(point_m), 1.0 / 3.0));
  std::array<double, 6> rates{};
  std::size_t num_low = 0;
  for (std::size_t k = 0; k < rates.size(); ++k) {
    const auto axis = static_cast<Eigen::Index>(k / 2);
    const Eigen::Vector3f offset_m = (k % 2 == 0 ? step_m : -step_m) * Eigen::Vector3f::Unit(axis);
    const RecentBins hits = HitsAround(point_m + offset_m) & observed_;
    rates[k] = RateOf(hits.SizeOutside(dwell.youngest, dwell.oldest), exposed, point_m);
    // Early exit, as in open air.
    num_low += rates[k] <= least_rate ? 1U : 0U;
    if (num_low > kMaxEmptyAdjacent) return least_rate;
  }
  std::sort(rates.begin(), rates.end());
  return rates[kMaxEmptyAdjacent];
}

// Number of bins outside a dwell from which its place can be judged. A moving carrier sees each
// place for a part of the time.
double Occupancy::MinExposed() const {
  const double share = config_.min_exposure * std::min(observed_.Size(), kEnoughBins);
  return field_of_view().is_carrier_moving() ? std::min(share, kEnoughFromMoving) : share;
}

// Bins in which a place that is hit in `hits` was hit or nothing hid it. A place behind something
// nearer is unobserved, not free. If it was seen through gaps of something nearer during this dwell
// it can be seen so at other times, too.
RecentBins Occupancy::VisibleBins(const Place& place, int age, const RecentBins& hits,
                                  const Dwell& dwell) const {
  if (hits == observed_) return observed_;
  const auto [behind, unseen] = occlusion_.HiddenBins(place.point_m, newest_ - age, newest_);
  const RecentBins through_gaps = hits & behind;
  const bool is_through_gaps =
      through_gaps.Size() > through_gaps.SizeOutside(dwell.youngest, dwell.oldest);
  RecentBins hidden = unseen;
  if (!is_through_gaps) hidden |= behind;
  return observed_ - (hidden - hits);
}

// Judges a place by the bins outside its dwell. A dwell that takes most of the window leaves few to
// judge it by: those of an earlier verdict on it count as well then, as a long hover must not
// become structure, nor structure that a long dwell hides anything else.
void Occupancy::JudgeAnew(const Eigen::Vector3f& point_m, int age, Place* place) const {
  const bool was_structure = place->is_structure;
  RecentBins hits = HitsOf(*place);
  if (hits != observed_) hits = HitsAround(point_m);  // otherwise they would add nothing
  const Dwell dwell = DwellAt(hits, age, max_break_);
  const std::int32_t dwell_before = std::exchange(place->dwell_first, newest_ - dwell.oldest);
  place->dwell_last = newest_ - dwell.youngest;
  if (place->dwell_first != dwell_before && !IsLong(*place)) {
    place->past_occupied = place->past_exposed = 0;
  }
  const int num_observed = observed_.Size();
  const double min_exposed = MinExposed();
  const RecentBins visible = VisibleBins(*place, age, hits, dwell);
  int exposed = visible.SizeOutside(dwell.youngest, dwell.oldest);
  int occupied = (hits & observed_).SizeOutside(dwell.youngest, dwell.oldest);
  const int num_in_dwell = num_observed - observed_.SizeOutside(dwell.youngest, dwell.oldest);
  if (IsLong(*place) || exposed < min_exposed || 2 * num_in_dwell > num_observed) {
    exposed = std::max<int>(exposed, place->past_exposed);
    occupied = std::max<int>(occupied, place->past_occupied);
  } else {
    place->past_exposed = static_cast<std::int16_t>(exposed);
    place->past_occupied = static_cast<std::int16_t>(occupied);
  }
  const double max_occupied = config_.max_occupancy * exposed;
  place->is_unknown = exposed < min_exposed;
  place->is_structure = place->is_unknown || occupied > max_occupied;
  // A place among strays is clutter, not structure. Where there is one at most times and within
  // reach of any track, a lone return tells nothing, and it is left at that.
  const double stray_rate = place->is_structure ? UsualStrayRate(point_m) : 0.0;
  place->is_behind_strays = stray_rate > 0.0;
  const double rate = place->is_behind_strays ? RateThroughout(hits, point_m) : 0.0;
  const bool may_be_strays = place->is_behind_strays && stray_rate > kMinStrayShare * rate;
  const bool is_of_strays = may_be_strays && AreStraysEnough(point_m, VoxelRate(point_m, age));
  const bool is_among_strays = is_of_strays && rate < kMaxStrayRate;
  if (is_among_strays) place->is_structure = false;
  place->stray_rate = is_of_strays && !is_among_strays ? static_cast<float>(rate) : 0.0F;
  place->is_supporter = place->is_structure ||
                        (occupied >= kSupportingHits && occupied > kSupportingShare * max_occupied);
  // A single bin may be a passing target.
  place->place_rate = place->is_structure || occupied <= 1
                          ? 0.0F
                          : static_cast<float>(RateOf(occupied - 1.0, exposed, point_m));
  if (is_among_strays) place->place_rate = static_cast<float>(rate);
  place->valid_until = newest_;
  // Structure is judged again after some bins. Most places begin together, so the first time is
  // drawn at random; otherwise all of them would be judged in one bin. In large frames that begins
  // early with what has been there throughout: nothing tells more about it until it goes.
  const bool is_throughout = num_in_dwell == num_observed && !place->is_behind_strays;
  const bool is_settled = num_observed >= kSettledBins || (has_many_returns_ && is_throughout);
  if ((place->is_structure || is_among_strays) && is_settled) {
    const bool is_first = place->is_structure && (!was_structure || num_observed == kSettledBins);
    place->valid_until += is_first ? ChanceOf(*place) % kKeptBins : kKeptBins - 1;
  }
}

// True if the last verdict on a place holds for a return in `bin`. Structure that is due is judged
// in turns by all frames of a bin, not by the first alone: in clear air, and once the scene is
// settled, as the verdicts of some frames before tell of strays too late.
bool Occupancy::IsValid(const Place& place, std::int64_t bin) const {
  if (bin < place.dwell_first || bin > place.dwell_last + max_break_ + 1) return false;
  if (newest_ <= place.valid_until) return true;
  return place.is_structure && !place.is_behind_strays && newest_ == place.valid_until + 1 &&
         (observed_.Size() > kSettledBins || (has_many_returns_ && place.is_unknown)) &&
         ChanceOf(place) / kKeptBins % kJudgingTurns >= turns_;
}

void Occupancy::Judge(PointsView points_m, std::int64_t bin, const OwnVoxels& voxels, int scene,
                      const FloatsIn& floats, const IsTargetSince& is_target,
                      std::vector<Verdict>* verdicts) {
  Verdict structure;
  structure.is_structure = true;
  verdicts->assign(points_m.size(), structure);
  const std::int64_t age = newest_ - bin;
  if (age < 0 || age >= RecentBins::kWindow) return;
  places_.VisitOwn(points_m, voxels, [&](std::size_t i, Place& place) {
    Verdict& verdict = (*verdicts)[i];
    const bool is_valid = IsValid(place, bin);
    if (!is_valid) JudgeAnew(points_m[i], static_cast<int>(age), &place);
    // The verdict may be older than this return, which extends the dwell.
    place.dwell_last = std::max(place.dwell_last, static_cast<std::int32_t>(bin));
    verdict.is_structure = place.is_structure;
    verdict.place_rate = place.place_rate;
    verdict.stray_rate = place.stray_rate;
    if (!IsLong(place)) verdict.dwell_begin_bin = place.dwell_first;
    if (!verdict.is_structure) return;
    // Tested with each new verdict only: a new scene would have all places tested at once.
    if ((!is_valid || place.scene == kNoScene) && std::exchange(place.scene, scene) != scene) {
      place.floats = floats(points_m[i]);
    }
    verdict.floats = place.floats;
    // A dwell that began with a known target is the target.
    if (place.is_unknown && !verdict.floats && verdict.dwell_begin_bin && is_target &&
        is_target(points_m[i], *verdict.dwell_begin_bin)) {
      verdict.is_structure = place.is_structure = place.is_supporter = false;
      place.valid_until = newest_ - 1;
    }
  });
}

// True if the dwell may reach beyond the window.
bool Occupancy::IsLong(const Place& place) const {
  return newest_ - place.dwell_first + max_break_ + 1 >= RecentBins::kWindow;
}

void Occupancy::JudgeAll() {
  places_.VisitAll([&](Place& place) {
    Age(&place);
    if (place.is_own && !place.hits.IsEmpty()) {
      JudgeAnew(place.point_m, place.hits.Youngest(), &place);
    }
  });
}

void Occupancy::GetStructure(std::vector<Eigen::Vector3f>* points_m) const {
  points_m->clear();
  places_.VisitAll([&](const Place& place) {
    if (place.is_own && place.is_structure) points_m->push_back(place.point_m);
  });
}

// In the first seconds a place with few hits may be a pole. A place that an object has left is no
// longer hit.
void Occupancy::GetSupporters(std::vector<Eigen::Vector3f>* points_m,
                              std::vector<char>* are_lasting) const {
  points_m->clear();
  are_lasting->clear();
  const bool is_young = observed_.Size() < kYoungBins;
  places_.VisitAll([&](const Place& place) {
    if (!place.is_own) return;
    const bool is_supporter = is_young && !place.is_structure
                                  ? newest_ - place.bin + place.hits.Youngest() <= max_break_
                                  : place.is_supporter;
    // Structure by evidence, or by want of it where the place was hit for most of the time.
    const bool lasts =
        place.is_structure && (!place.is_unknown || 2 * place.hits.Size() > observed_.Size());
    if (!is_supporter && !lasts) return;
    points_m->push_back(place.point_m);
    are_lasting->push_back(lasts ? 1 : 0);
  });
}

void Occupancy::Sweep() {
  places_.EraseIf([&](Place& place) {
    Age(&place);
    return place.hits.IsEmpty();
  });
}

}  // namespace unlidar
