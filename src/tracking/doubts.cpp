#include "tracking/doubts.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "tracking/backwards.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"

namespace unlidar {
namespace {

using Members = std::vector<std::uint32_t>;

// Ways that are less likely than the path by more do not count: none of them changes a probability
// by 1e-5.
constexpr double kFarLog = 12.0;
// Doubts of less would make no sigma larger by half a hundredth.
constexpr double kLeastProbability = 1e-3;
// Times of one sighting, told by a plot and by all returns of a frame, differ by less.
constexpr TimeNs kSameFrameNs = 50'000'000;

// The ways in which a target may have gone on from where its path is beyond doubt: the last plot
// behind which it brings `birth_cost` yet. They are searched for as paths are, but nothing else
// begins; and what goes unseen is taken to be there yet, so that it pays for it.
class Ways {
 public:
  Ways(const std::vector<Plot>& plots, const Members& members, std::vector<char> free,
       const Watch& watch, const TrackerConfig& config)
      : plots_(plots), watch_(watch), config_(config) {
    std::vector<const Plot*> path;
    std::vector<Moment> moments;
    for (const std::uint32_t i : members) {
      path.push_back(&plots[i]);
      moments.push_back(MomentOf(plots[i], plots.front(), watch));
    }
    std::vector<std::vector<Hypothesis>> own;
    std::size_t best = 0;
    for (const double sigma : config.sigma_a_mps2) {
      models_.emplace_back(sigma, watch, config);
      own.push_back(FollowPath(models_.back(), path, moments, 0.0, config));
      if (own.back().back().score > own[best].back().score) best = own.size() - 1;
    }
    std::size_t cut = members.size() - 1;
    while (cut > 0 && own[best].back().score - own[best][cut].score < config.birth_cost) --cut;
    tail_.assign(members.begin() + static_cast<std::ptrdiff_t>(cut), members.end());
    SetFrames();
    for (const std::uint32_t i : members) free[i] = 1;
    const double score = own[best][cut].score;
    std::vector<Hypothesis> firsts;
    for (const std::vector<Hypothesis>& way : own) {
      firsts.push_back(way[cut]);
      firsts.back().score -= score;
      firsts.back().plot = static_cast<std::int32_t>(members[cut]);
    }
    const double least = models_[best].ScoreUnseen(own[best].back(), end_) - score - kFarLog;
    Search(firsts, free, least);
  }

  // `log_seen`: by how much what was seen of it behind its last plot makes the path likelier.
  std::vector<Doubt> Doubts(double log_seen) const {
    double best = -std::numeric_limits<double>::infinity();
    for (const auto& [way, model] : ways_) best = std::max(best, way.score);
    std::vector<double> weights;
    double all = 0.0;
    for (const auto& [way, model] : ways_) {
      weights.push_back(std::exp(way.score - best - (IsPath(way) ? 0.0 : log_seen)));
      all += weights.back();
    }
    std::vector<Doubt> doubts;
    for (const TimeNs time_ns : frames_ns_) {
      Doubt doubt;
      doubt.time_ns = time_ns;
      double sum = 0.0;
      Eigen::Vector3d square_sum_m2 = Eigen::Vector3d::Zero();
      const auto own = After(tail_, time_ns);
      for (std::size_t k = 0; k < ways_.size(); ++k) {
        const auto& [way, model] = ways_[k];
        const std::size_t next = After(way.steps, time_ns);
        if (IsOwn(way, next, own)) continue;
        const auto [position_m, variance_m2] = At(way, next, models_[model], time_ns);
        const Eigen::Vector3d from_origin_m = position_m - plots_[tail_.front()].position_m;
        sum += weights[k];
        doubt.position_m += weights[k] * from_origin_m;
        square_sum_m2.array() += weights[k] * (from_origin_m.array().square() + variance_m2);
      }
      if (sum > kLeastProbability * all) {
        doubt.probability = sum / all;
        doubt.position_m /= sum;
        doubt.variance_m2 = square_sum_m2 / sum - doubt.position_m.cwiseAbs2();
        doubt.position_m += plots_[tail_.front()].position_m;
      }
      doubts.push_back(doubt);
    }
    return doubts;
  }

 private:
  // Appends the ways that go on from these, one for each model.
  void Search(const std::vector<Hypothesis>& firsts, const std::vector<char>& free, double least) {
    const std::vector<double> log_births(plots_.size(), -std::numeric_limits<double>::infinity());
    std::vector<TrackSearch> searches;
    for (std::size_t m = 0; m < models_.size(); ++m) {
      searches.emplace_back(plots_, log_births, free, models_[m], config_);
      searches.back().Begin(firsts[m]);
    }
    const Plot& first = plots_[tail_.front()];
    Slice slice;
    for (std::size_t i = tail_.front(); i < plots_.size(); i = slice.last) {
      SetSlice(plots_, log_births, i, MomentOf(plots_[i], plots_.front(), watch_), config_, &slice);
      if (plots_[i].frame == first.frame) continue;
      if (plots_[i].frame_time_ns > frames_ns_.back()) break;
      if (slice.at.time_s <= firsts.front().time_s) continue;
      for (TrackSearch& search : searches) search.Extend(slice);
    }
    for (std::size_t m = 0; m < searches.size(); ++m) {
      std::vector<Way> ways;
      searches[m].AppendWays(end_, least, &ways);
      for (Way& way : ways) ways_.push_back({std::move(way), m});
    }
  }

  bool IsPath(const Way& way) const {
    return std::equal(way.steps.begin(), way.steps.end(), tail_.begin(), tail_.end(),
                      [](const Way::Step& step, std::uint32_t i) { return step.plot == i; });
  }

  void SetFrames() {
    const TimeNs first_ns = plots_[tail_.front()].frame_time_ns;
    const TimeNs last_ns = plots_[tail_.back()].frame_time_ns + NsOf(config_.max_gap_s);
    for (const Watch::Sensor& sensor : watch_.sensors) {
      for (const TimeNs time_ns : sensor.frame_times_ns) {
        if (first_ns <= time_ns && time_ns <= last_ns) frames_ns_.push_back(time_ns);
      }
    }
    std::sort(frames_ns_.begin(), frames_ns_.end());
    end_.time_s = Seconds(frames_ns_.back());
    for (std::uint32_t s = 0; s < watch_.sensors.size(); ++s) {
      end_.frames_before.push_back(watch_.FramesBefore(s, frames_ns_.back() + 1));
    }
  }

  double Seconds(TimeNs time_ns) const {
    return static_cast<double>(time_ns - plots_.front().frame_time_ns) * kSecondsPerNs;
  }

  // The first plot of a way that is later; 1 at least, as nothing before its first is asked for.
  std::size_t After(const Members& members, TimeNs time_ns) const {
    std::size_t next = 1;
    while (next < members.size() && plots_[members[next]].frame_time_ns <= time_ns) ++next;
    return next;
  }
  std::size_t After(const std::vector<Way::Step>& steps, TimeNs time_ns) const {
    std::size_t next = 1;
    while (next < steps.size() && plots_[steps[next].plot].frame_time_ns <= time_ns) ++next;
    return next;
  }

  // Whether a way leads from one plot of the path to the next one.
  bool IsOwn(const Way& way, std::size_t next, std::size_t own) const {
    if (way.steps[next - 1].plot != tail_[own - 1]) return false;
    if (next == way.steps.size()) return own == tail_.size();
    return own < tail_.size() && way.steps[next].plot == tail_[own];
  }

  // Where it was by a way, and the variance per axis: by what was known at the plot before, and by
  // the one after, if there is one.
  std::pair<Eigen::Vector3d, double> At(const Way& way, std::size_t next, const TrackModel& model,
                                        TimeNs time_ns) const {
    const Way::Step& from = way.steps[next - 1];
    const Motion to_here = model.MotionOver(Seconds(time_ns) - from.time_s);
    const Eigen::Matrix3d mean = from.state.mean * to_here.transition.transpose();
    const Eigen::Matrix3d covariance =
        to_here.transition * from.state.covariance * to_here.transition.transpose() + to_here.noise;
    if (next == way.steps.size()) return {mean.col(0), covariance(0, 0)};
    const Way::Step& to = way.steps[next];
    const Motion on = model.MotionOver(to.time_s - Seconds(time_ns));
    const Eigen::Vector3d onto_position = on.transition.row(0).transpose();
    const double with_next = covariance.row(0).dot(onto_position);
    const double of_next = onto_position.dot(covariance * onto_position) + on.noise(0, 0) +
                           plots_[to.plot].variance_m2;
    const Eigen::Vector3d surprise_m = plots_[to.plot].position_m - mean * onto_position;
    return {mean.col(0) + with_next / of_next * surprise_m,
            covariance(0, 0) - with_next * with_next / of_next};
  }

  const std::vector<Plot>& plots_;
  const Watch& watch_;
  const TrackerConfig& config_;
  Members tail_;  // of the path
  std::vector<TimeNs> frames_ns_;
  Moment end_;  // of the last of them
  std::vector<TrackModel> models_;
  std::vector<std::pair<Way, std::size_t>> ways_;  // and their models
};

}  // namespace

std::vector<Doubt> DoubtsOf(std::size_t path, const std::vector<Path>& paths,
                            const std::vector<Plot>& plots, const Watch& watch,
                            const TrackerConfig& config,
                            const std::vector<Measurement>& measurements) {
  std::vector<char> free(plots.size(), 1);
  for (const Path& other : paths) {
    if (other.score < config.birth_cost) continue;
    for (const std::uint32_t i : other.plots) free[i] = 0;
  }
  const Members& members = paths[path].plots;
  double seen_before = 0.0;
  double seen_behind = 0.0;
  for (const Measurement& m : measurements) {
    if (m.time_ns < plots[members.front()].time_ns - kSameFrameNs) seen_before += m.log_ratio;
    if (m.time_ns > plots[members.back()].time_ns + kSameFrameNs) seen_behind += m.log_ratio;
  }
  std::vector<Doubt> doubts = Ways(plots, members, free, watch, config).Doubts(seen_behind);
  std::vector<Plot> mirrored;
  for (auto plot = plots.rbegin(); plot != plots.rend(); ++plot) {
    mirrored.push_back(Backwards(*plot));
  }
  Members back;
  for (auto i = members.rbegin(); i != members.rend(); ++i) {
    back.push_back(static_cast<std::uint32_t>(plots.size()) - 1 - *i);
  }
  const std::vector<char> free_back(free.rbegin(), free.rend());
  const Watch backwards = Backwards(watch);
  const Ways ways(mirrored, back, free_back, backwards, config);
  for (Doubt doubt : ways.Doubts(seen_before)) {
    doubt.time_ns = Backwards(doubt.time_ns);
    doubts.push_back(doubt);
  }
  std::stable_sort(doubts.begin(), doubts.end(),
                   [](const Doubt& a, const Doubt& b) { return a.time_ns < b.time_ns; });
  return doubts;
}

}  // namespace unlidar
