#include "unlidar/robust/floating.hpp"

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

// Which plots stand still: seen at one place again and again, more often than all about it.
std::vector<char> AreStanding(const std::vector<Plot>& plots, const RangeRadius& place) {
  constexpr double kWider = 3.0;
  constexpr std::uint32_t kMinPlots = 3;
  RangeGrid places(place, 1);
  RangeGrid regions({kWider * place.constant_m, kWider * place.slope}, 1);
  for (const Plot& plot : plots) {
    places.Add(plot.position_m.cast<float>(), 0);
    regions.Add(plot.position_m.cast<float>(), 0);
  }
  std::vector<char> are_standing;
  for (const Plot& plot : plots) {
    const Eigen::Vector3f place_m = plot.position_m.cast<float>();
    std::vector<std::uint32_t> here(1, 0);
    std::vector<std::uint32_t> about(1, 0);
    places.Collect(place_m, &here);
    regions.Collect(place_m, &about);
    const double chance = about[0] * places.VolumeM3(place_m) / regions.VolumeM3(place_m);
    are_standing.push_back(here[0] >= kMinPlots && here[0] > chance + 3.0 * std::sqrt(chance));
  }
  return are_standing;
}

// What else stands beside each floating plot at the same time, against what does farther about it.
class Company {
 public:
  Company(const std::vector<Plot>& plots, const std::vector<char>& are_standing,
          const SupportConfig& config)
      : tallies_({config.body_m, 0.01}, kNumTallies) {
    constexpr TimeNs kSameTimeNs = 300'000'000;
    for (std::size_t i = 0, first = 0; i < plots.size(); ++i) {
      const Plot& plot = plots[i];
      while (plots[first].frame_time_ns < plot.frame_time_ns - kSameTimeNs) ++first;
      if (!plot.is_floating) continue;
      const double reach_m = config.ReachM(plot.position_m.norm());
      std::array<std::uint32_t, kNumTallies> tally{};
      tally[kPlots] = 1;
      for (std::size_t k = first;
           k < plots.size() && plots[k].frame_time_ns <= plot.frame_time_ns + kSameTimeNs; ++k) {
        if (!are_standing[k]) continue;
        const double distance_m = (plot.position_m - plots[k].position_m).norm();
        if (distance_m >= kSurroundings * reach_m) continue;
        ++tally[distance_m <= config.body_m ? kSelf : distance_m < reach_m ? kBeside : kAbout];
      }
      for (std::size_t t = 0; t < kNumTallies; ++t) {
        tallies_.Add(plot.position_m.cast<float>(), t, tally[t]);
      }
    }
  }

  // Whether there is more beside a floating plot than by chance.
  bool Holds(const Plot& plot) const {
    std::vector<std::uint32_t> sums(kNumTallies, 0);
    tallies_.Collect(plot.position_m.cast<float>(), &sums);
    // A plot beside it was counted for every plot of its own that is near in time.
    const double times = static_cast<double>(sums[kSelf]) / sums[kPlots];
    const double chance =
        sums[kAbout] / times / (kSurroundings * kSurroundings * kSurroundings - 1.0);
    return sums[kBeside] / times > chance + 2.0 * std::sqrt(chance);
  }

 private:
  static constexpr double kSurroundings = 5.0;  // times the reach
  enum Tally : std::size_t { kSelf, kBeside, kAbout, kPlots, kNumTallies };

  RangeGrid tallies_;
};

}  // namespace

void MarkFloating(const Recording& recording, const Support& support, const RangeRadius& place,
                  std::vector<Plot>* plots) {
  const std::vector<char> are_standing = AreStanding(*plots, place);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = are_standing[i] != 0 && support.IsFloating(plot.position_m.cast<float>());
  }
  const Company company(*plots, are_standing, support.config());
  const std::vector<char> are_replayed = AreReplayed(recording, *plots);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    plot.is_floating = plot.is_floating && !company.Holds(plot) && !are_replayed[i];
  }
}

}  // namespace unlidar
