#include "floating.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <unordered_map>

namespace unlidar {
namespace {

// Which plots are nothing but returns that came before or after with the very same coordinates: no
// LiDAR measures a place twice alike, so these are repetitions of one frame.
std::vector<char> AreReplayed(const Recording& recording, const std::vector<Plot>& plots) {
  struct Hash {
    std::size_t operator()(const std::array<float, 3>& p) const {
      std::size_t h = 0;
      for (const float x : p) h = h * 1000003U + std::hash<float>()(x);
      return h;
    }
  };
  const auto key = [&](std::uint32_t i) {
    const Eigen::Vector3f& p = recording.points_m[i];
    return std::array<float, 3>{p.x(), p.y(), p.z()};
  };
  struct Frames {
    std::uint32_t first;
    bool are_more;
  };
  std::unordered_map<std::array<float, 3>, Frames, Hash> frames_of;
  for (const Plot& plot : plots) {
    for (const std::uint32_t i : plot.returns) {
      Frames& frames = frames_of.try_emplace(key(i), Frames{plot.frame, false}).first->second;
      frames.are_more = frames.are_more || frames.first != plot.frame;
    }
  }
  std::vector<char> are_replayed;
  are_replayed.reserve(plots.size());
  for (const Plot& plot : plots) {
    are_replayed.push_back(
        std::all_of(plot.returns.begin(), plot.returns.end(),
                    [&](std::uint32_t i) { return frames_of.at(key(i)).are_more; }));
  }
  return are_replayed;
}

}  // namespace

void ConfirmFloating(const Recording& recording, const SupportConfig& config,
                     std::vector<Plot>* plots) {
  constexpr TimeNs kSameTimeNs = 300'000'000;
  constexpr RangeRadius kPlace{0.35, 0.012};
  constexpr std::uint32_t kMinPlots = 3;
  // To stand still is to be seen at one place again and again.
  RangeGrid places(kPlace, 1);
  for (const Plot& plot : *plots) places.Add(plot.position_m.cast<float>(), 0);
  std::vector<char> stands;
  std::vector<std::uint32_t> count(1);
  for (const Plot& plot : *plots) {
    count[0] = 0;
    places.Collect(plot.position_m.cast<float>(), &count);
    stands.push_back(count[0] >= kMinPlots);
  }
  // What is beside each at the same time, against what is farther about it.
  constexpr double kSurroundings = 3.0;  // times the reach
  constexpr double kShare = 1.0 / (kSurroundings * kSurroundings * kSurroundings - 1.0);
  enum Tally : std::size_t { kCompany, kOthers, kSelf, kPlots, kNumTallies };
  RangeGrid tallies({config.body_m, 0.01}, kNumTallies);
  for (std::size_t i = 0, first = 0; i < plots->size(); ++i) {
    const Plot& plot = (*plots)[i];
    while ((*plots)[first].time_ns < plot.time_ns - kSameTimeNs) ++first;
    if (!plot.is_floating || !stands[i]) continue;
    const double reach_m = config.ReachM(plot.position_m.norm());
    std::array<std::uint32_t, kNumTallies> tally{};
    tally[kPlots] = 1;
    for (std::size_t k = first;
         k < plots->size() && (*plots)[k].time_ns <= plot.time_ns + kSameTimeNs; ++k) {
      if (!stands[k]) continue;
      const double distance_m = (plot.position_m - (*plots)[k].position_m).norm();
      if (distance_m >= kSurroundings * reach_m) continue;
      ++tally[distance_m <= config.body_m ? kSelf : distance_m < reach_m ? kCompany : kOthers];
    }
    for (std::size_t t = 0; t < kNumTallies; ++t) {
      tallies.Add(plot.position_m.cast<float>(), t, tally[t]);
    }
  }
  const std::vector<char> are_replayed = AreReplayed(recording, *plots);
  std::vector<std::uint32_t> sums(kNumTallies);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = plot.is_floating && stands[i] != 0;
    if (!plot.is_floating) continue;
    std::fill(sums.begin(), sums.end(), 0);
    tallies.Collect(plot.position_m.cast<float>(), &sums);
    // A plot beside it counts once for every plot of its own that is near in time.
    const double times = static_cast<double>(sums[kSelf]) / sums[kPlots];
    const double company = sums[kCompany] / times;
    const double chance = kShare * sums[kOthers] / times;
    const bool is_held = company > chance + 2.0 * std::sqrt(chance);
    plot.is_floating = !is_held && !are_replayed[i];
  }
}

}  // namespace unlidar
