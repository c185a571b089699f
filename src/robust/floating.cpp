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
  constexpr double kSurroundings = 3.0;  // times the reach
  constexpr double kMaxChance = 1.0;     // company to be expected from what the surroundings hold
  RangeGrid held({config.body_m, 0.01}, 1);
  for (std::size_t i = 0, first = 0; i < plots->size(); ++i) {
    const Plot& plot = (*plots)[i];
    while ((*plots)[first].time_ns < plot.time_ns - kSameTimeNs) ++first;
    if (!plot.is_floating) continue;
    const double reach_m = config.reach.At(plot.position_m.norm());
    int company = 0;
    int others = 0;
    for (std::size_t k = first;
         k < plots->size() && (*plots)[k].time_ns <= plot.time_ns + kSameTimeNs; ++k) {
      const double distance_m = (plot.position_m - (*plots)[k].position_m).norm();
      if (distance_m <= config.body_m || distance_m >= kSurroundings * reach_m) continue;
      ++(distance_m < reach_m ? company : others);
    }
    const double chance = others / (std::pow(kSurroundings, 3) - 1.0);
    if (company > 0 && chance < kMaxChance) held.Add(plot.position_m.cast<float>(), 0);
  }
  const std::vector<char> are_replayed = AreReplayed(recording, *plots);
  std::vector<std::uint32_t> count(1);
  for (std::size_t i = 0; i < plots->size(); ++i) {
    Plot& plot = (*plots)[i];
    if (!plot.is_floating) continue;
    count[0] = 0;
    held.Collect(plot.position_m.cast<float>(), &count);
    plot.is_floating = count[0] == 0 && !are_replayed[i];
  }
}

}  // namespace unlidar
