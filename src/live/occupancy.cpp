#include "live/occupancy.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace unlidar {
namespace {

// Counts from before the window fade by a factor of e in this many bins.
constexpr double kFadeBins = 600.0;
constexpr int kSettledBins = 10;    // observed bins from which structure is kept for a while
constexpr float kForgotten = 0.5F;  // faded hits below which a place is empty
constexpr std::size_t kMaxEmptyAdjacent = 2;  // of the six adjacent places, may be empty by chance
// With fewer observed bins, any place that is still being hit may be a support.
constexpr int kYoungBins = 20;
constexpr float kSupportingHits = 3.0F;
constexpr float kSupportingShare = 0.5F;  // of the hits of structure

double Fade(std::int64_t bins) { return std::exp(-static_cast<double>(bins) / kFadeBins); }

int NumBits(std::uint64_t word) { return __builtin_popcountll(word); }

std::uint64_t LowBits(std::int64_t count) {
  return count >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1;
}

// Dwell around the set bit `at`, from bit `first` to `last`, with breaks of at most `max_break`.
struct Dwell {
  int first;
  int last;
};

Dwell DwellAt(std::uint64_t word, int at, int max_break) {
  Dwell dwell{at, at};
  for (int i = at - 1; i >= 0 && dwell.first - i <= max_break + 1; --i) {
    if (word >> i & 1U) dwell.first = i;
  }
  for (int i = at + 1; i < 64 && i - dwell.last <= max_break + 1; ++i) {
    if (word >> i & 1U) dwell.last = i;
  }
  return dwell;
}

}  // namespace

Occupancy::Occupancy(const BackgroundConfig& config)
    : config_(config),
      max_break_(static_cast<int>(config.max_break_s / config.bin_s)),
      places_(config.place) {}

void Occupancy::AddFrame(std::int64_t bin) {
  if (bin > newest_) {
    const std::int64_t passed = bin - newest_;
    const std::uint64_t out =
        passed >= kWindow ? observed_bins_ : observed_bins_ & ~LowBits(kWindow - passed);
    older_observed_bins_ = (older_observed_bins_ + NumBits(out)) * Fade(passed);
    frames_ *= Fade(passed);
    bins_with_frames_ *= Fade(passed);
    observed_bins_ = passed >= kWindow ? 0 : observed_bins_ << passed;
    newest_ = bin;
  }
  const std::int64_t age = newest_ - bin;
  if (age >= kWindow) return;
  frames_ += 1.0;
  if (!(observed_bins_ >> age & 1U)) {
    observed_bins_ |= std::uint64_t{1} << age;
    bins_with_frames_ += 1.0;
  }
}

// Shifts the bits of a place to the newest bin. Hits that leave the window are added to the older
// ones, unless they belong to a dwell that fills the window: a long hover must not become
// structure. Structure that is hit often has long dwells, too, and keeps its hits.
void Occupancy::Shift(Place* place) const {
  const std::int64_t passed = newest_ - place->own.bin;
  if (passed <= 0) return;
  const std::uint64_t out =
      passed >= kWindow ? place->own.word : place->own.word & ~LowBits(kWindow - passed);
  if (!place->is_dwell_long || place->is_structure) {
    place->older += static_cast<float>(NumBits(out));
  }
  place->older *= static_cast<float>(Fade(passed));
  place->own.word = passed >= kWindow ? 0 : place->own.word << passed;
  place->own.bin = newest_;
}

void Occupancy::Add(const Eigen::Vector3f& point_m, std::int64_t bin) {
  const std::int64_t age = newest_ - bin;
  if (age < 0 || age >= kWindow) return;
  const std::uint64_t bit = std::uint64_t{1} << age;
  Place unknown;
  unknown.own.bin = newest_;
  places_.VisitOverlappingShells(point_m, unknown, [&](std::uint32_t, Place& place, bool is_own) {
    Shift(&place);
    if (place.own.word & bit) return;
    place.own.word |= bit;
    place.point_m = point_m;
    place.is_own = is_own;
  });
}

void Occupancy::UpdateNeighbourhood(const Eigen::Vector3f& point_m, Place* place) {
  if (place->near.bin == newest_ && place->near.word != 0) return;
  Hits hits;
  places_.VisitNeighbourhood(point_m, [&](Place& neighbour) {
    Shift(&neighbour);
    Count(neighbour, &hits);
  });
  place->near = {hits.word, newest_};
  place->older_near = OlderOf(hits);
}

Occupancy::Hits Occupancy::HitsAround(const Eigen::Vector3f& point_m) const {
  Hits hits;
  places_.VisitNeighbourhood(point_m, [&](const Place& place) { Count(place, &hits); });
  return hits;
}

// The bins of older hits are not stored: hits of different voxels are taken as independent.
void Occupancy::Count(const Place& place, Hits* hits) const {
  const std::int64_t passed = newest_ - place.own.bin;
  hits->word |= passed >= kWindow ? 0 : place.own.word << passed;
  if (place.older > 0.0F) {
    hits->free_share *=
        1.0F - std::min(1.0F, place.older / static_cast<float>(older_observed_bins_));
  }
}

float Occupancy::OlderOf(const Hits& hits) const {
  return (1.0F - hits.free_share) * static_cast<float>(older_observed_bins_);
}

// Returns per frame and m^3 at a place that is hit in `occupied` of `exposed` bins.
double Occupancy::RateOf(float occupied, float exposed, const Eigen::Vector3f& point_m) const {
  const double hits_per_bin =
      -std::log1p(-std::min(0.999, static_cast<double>(occupied / exposed)));
  return hits_per_bin * bins_with_frames_ / frames_ / places_.VolumeM3(point_m);
}

double Occupancy::RateAround(const Eigen::Vector3f& point_m, std::int64_t bin) const {
  const std::int64_t age = newest_ - bin;
  if (age < 0 || age >= kWindow) return 0.0;
  const auto step_m = static_cast<float>(std::pow(places_.VolumeM3(point_m), 1.0 / 3.0));
  std::array<Hits, 6> hits{};
  std::size_t num_free = 0;
  for (std::size_t k = 0; k < hits.size(); ++k) {
    const auto axis = static_cast<Eigen::Index>(k / 2);
    const Eigen::Vector3f offset_m = (k % 2 == 0 ? step_m : -step_m) * Eigen::Vector3f::Unit(axis);
    hits[k] = HitsAround(point_m + offset_m);
    // Early exit for open air.
    num_free += hits[k].word == 0 && hits[k].free_share >= 1.0F ? 1U : 0U;
    if (num_free > kMaxEmptyAdjacent) return 0.0;
  }
  const std::uint64_t here = HitsAround(point_m).word | std::uint64_t{1} << age;
  const Dwell dwell = DwellAt(here, static_cast<int>(age), max_break_);
  const std::uint64_t others = observed_bins_ & (~LowBits(dwell.last + 1) | LowBits(dwell.first));
  const float exposed =
      static_cast<float>(NumBits(others)) + static_cast<float>(older_observed_bins_);
  if (exposed < 1.0F) return 0.0;
  std::array<float, 6> occupied{};
  std::transform(hits.begin(), hits.end(), occupied.begin(), [&](const Hits& about) {
    return static_cast<float>(NumBits(about.word & others)) + OlderOf(about);
  });
  std::sort(occupied.begin(), occupied.end());
  return RateOf(occupied[kMaxEmptyAdjacent], exposed, point_m);
}

Occupancy::Verdict Occupancy::Judge(const Eigen::Vector3f& point_m, std::int64_t bin, int scene,
                                    const FloatsIn& floats, const IsTargetSince& is_target) {
  Verdict verdict;
  Place* const found = places_.Find(point_m);
  const std::int64_t age = newest_ - bin;
  verdict.is_structure = true;
  if (found == nullptr || age < 0 || age >= kWindow) return verdict;
  Place& place = *found;
  const auto set_floating = [&] {
    if (std::exchange(place.scene, scene) != scene) place.floats = floats(point_m);
    verdict.floats = place.floats;
  };
  if (place.judged_until >= newest_) {
    set_floating();
    return verdict;
  }
  UpdateNeighbourhood(point_m, &place);
  const std::uint64_t word = place.near.word | std::uint64_t{1} << age;
  const Dwell dwell = DwellAt(word, static_cast<int>(age), max_break_);
  const std::uint64_t in_dwell = LowBits(dwell.last + 1) & ~LowBits(dwell.first);
  float occupied = static_cast<float>(NumBits(word & observed_bins_ & ~in_dwell));
  float exposed = static_cast<float>(NumBits(observed_bins_ & ~in_dwell));
  // A dwell near the end of the window may reach beyond it.
  place.is_dwell_long = dwell.last + max_break_ + 1 >= kWindow;
  if (!place.is_dwell_long) verdict.dwell_begin_bin = newest_ - dwell.last;
  if (place.is_dwell_long || 2 * NumBits(in_dwell & observed_bins_) > NumBits(observed_bins_)) {
    occupied = std::max(occupied, place.past_occupied);
    exposed = std::max(exposed, place.past_exposed);
  } else {
    occupied += place.older_near;
    exposed += static_cast<float>(older_observed_bins_);
    place.past_occupied = occupied;
    place.past_exposed = exposed;
  }
  const auto min_exposed =
      static_cast<float>(config_.min_exposure * static_cast<double>(NumBits(observed_bins_)));
  const bool is_unknown = exposed < min_exposed;
  verdict.is_structure =
      is_unknown || occupied > static_cast<float>(config_.max_occupancy) * exposed;
  place.is_structure = verdict.is_structure;
  place.is_supporter =
      verdict.is_structure ||
      (occupied >= kSupportingHits &&
       occupied > kSupportingShare * static_cast<float>(config_.max_occupancy) * exposed);
  if (verdict.is_structure) {
    set_floating();
    // A dwell that began with a known target is the target.
    if (is_unknown && !verdict.floats && verdict.dwell_begin_bin && is_target &&
        is_target(point_m, *verdict.dwell_begin_bin)) {
      verdict.is_structure = place.is_structure = place.is_supporter = false;
      return verdict;
    }
    // Spread over bins, so that not all places are judged again at once.
    if (NumBits(observed_bins_) >= kSettledBins) {
      place.judged_until = newest_ + 4 + static_cast<std::int64_t>(1e3F * place.point_m.norm()) % 8;
    }
    return verdict;
  }
  if (occupied <= 1.0F) return verdict;
  verdict.place_rate = static_cast<float>(RateOf(occupied - 1.0F, exposed, point_m));
  return verdict;
}

void Occupancy::GetStructure(std::vector<Eigen::Vector3f>* points_m) const {
  GetReturnsOf([](const Place& place) { return place.is_structure; }, points_m);
}

// In the first seconds a place with few hits may be a pole. A place that an object has left is no
// longer hit.
void Occupancy::GetSupporters(std::vector<Eigen::Vector3f>* points_m) const {
  const bool is_young = NumBits(observed_bins_) < kYoungBins;
  const auto is_supporter = [&](const Place& place) {
    if (!is_young || place.is_structure) return place.is_supporter;
    const Bits& own = place.own;
    return own.word != 0 && newest_ - own.bin + __builtin_ctzll(own.word) <= max_break_;
  };
  GetReturnsOf(is_supporter, points_m);
}

template <class IsWanted>
void Occupancy::GetReturnsOf(const IsWanted& is_wanted,
                             std::vector<Eigen::Vector3f>* points_m) const {
  points_m->clear();
  places_.VisitAll([&](const Place& place) {
    if (place.is_own && is_wanted(place)) points_m->push_back(place.point_m);
  });
  std::sort(points_m->begin(), points_m->end(), [](const auto& a, const auto& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  });
}

void Occupancy::Sweep() {
  places_.EraseIf([&](Place& place) {
    Shift(&place);
    return place.own.word == 0 && place.older < 4.0F * kForgotten;
  });
}

}  // namespace unlidar
