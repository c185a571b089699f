#include "live/rejoin.hpp"

#include <cstdint>
#include <numeric>

#include "tracking/path_exchange.hpp"

namespace unlidar {

std::vector<std::pair<std::size_t, Hypothesis>> RejoinedPlots(
    const TrackModel& model, const Hypothesis& confirmed, const std::vector<FollowedPlot>& plots) {
  const TrackModel judge = model.With(TimeOutOfView::kLogUniform);
  const auto way_of = [&](const std::vector<std::uint32_t>& members) {
    std::vector<std::pair<std::size_t, Hypothesis>> way;
    Hypothesis h = confirmed;
    for (const std::uint32_t i : members) {
      h = judge.PredictAndUpdate(h, plots[i].seen.plot, plots[i].at);
      way.emplace_back(i, h);
    }
    return way;
  };
  const auto with_score = [&](std::vector<std::uint32_t> members) {
    const double score = way_of(members).back().second.score;
    return Path{std::move(members), score};
  };
  std::vector<std::uint32_t> all(plots.size());
  std::iota(all.begin(), all.end(), 0U);
  Path path = with_score(std::move(all));
  const auto without = [&](std::size_t first, std::size_t last) {
    std::vector<std::uint32_t> rest = path.plots;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(first),
               rest.begin() + static_cast<std::ptrdiff_t>(last));
    return with_score(std::move(rest));
  };
  while (DropStretch([&](std::uint32_t i) { return plots[i].seen.plot.time_ns; }, without,
                     Droppable::kRunsBeforeLast, &path)) {
  }
  return way_of(path.plots);
}

}  // namespace unlidar
