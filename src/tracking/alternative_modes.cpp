#include "tracking/alternative_modes.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "base/maths.hpp"
#include "tracking/path_exchange.hpp"
#include "tracking/scan_schedule.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"

namespace unlidar {
namespace {

// A plot of a hypothesis.
struct Step {
  std::uint32_t plot = 0;
  double time_s = 0.0;  // middle of its frame
  State state;          // after its plot
};

// One of the hypotheses of a search, with its plots.
struct AlternativePath {
  std::vector<Step> steps;  // from the first plot on
  double score = 0.0;       // including missed detections since the last step
  std::size_t model = 0;    // index
};

// Modes of lower probability would increase no sigma by more than 0.5 %.
constexpr double kMinProbability = 1e-3;
// The times of one detection, from its plot and from all returns of the frame, differ by less.
constexpr TimeNs kSameFrameNs = 50'000'000;

// The hypotheses of how a target continued after the last plot of its path that is certain: the
// last one behind which the path still gains kInitiationLog. The search is that for paths, but
// without births; a target that is missed is assumed to be still present, so its missed detections
// count.
class AlternativePaths {
 public:
  // `is_reversed`: before the first plot that is certain, in reversed time, as `scan_schedule` is.
  AlternativePaths(const std::vector<Plot>& plots, const std::vector<char>& are_free,
                   const Path& reported, const ScanSchedule& scan_schedule, bool is_reversed,
                   const TrackerConfig& config)
      : scan_schedule_(scan_schedule), config_(config) {
    const auto plot_at = [&](std::size_t i) {
      return is_reversed ? TimeReversed(plots[i]) : plots[i];
    };
    begin_ns_ = plot_at(is_reversed ? plots.size() - 1 : 0).frame_time_ns;
    Members members = reported.plots;
    if (is_reversed) std::reverse(members.begin(), members.end());
    std::vector<Plot> path;
    path.reserve(members.size());
    std::vector<const Plot*> filtered;
    std::vector<FrameTime> frame_times;
    for (const std::uint32_t i : members) {
      path.push_back(plot_at(i));
      filtered.push_back(&path.back());
      frame_times.push_back(FrameTimeOf(path.back(), begin_ns_, scan_schedule));
    }
    std::vector<std::vector<Hypothesis>> own;
    std::size_t best = 0;
    for (const double sigma : config.sigma_a_mps2) {
      models_.emplace_back(sigma, scan_schedule, config);
      own.push_back(FilterPath(models_.back(), filtered, frame_times, 0.0, config));
      if (own.back().back().score > own[best].back().score) best = own.size() - 1;
    }
    std::size_t cut = members.size() - 1;
    while (cut > 0 && own[best].back().score - own[best][cut].score < kInitiationLog) --cut;
    SetFrames(path[cut].frame_time_ns, path.back().frame_time_ns);
    // Copies of the plots within these frames: a recording has many more.
    std::vector<char> free;
    const std::size_t num_ahead = is_reversed ? members[cut] + 1U : plots.size() - members[cut];
    for (std::size_t k = 0; k < num_ahead; ++k) {
      const std::size_t i = is_reversed ? members[cut] - k : members[cut] + k;
      Plot plot = plot_at(i);
      if (plot.frame_time_ns > frames_ns_.back()) break;
      plots_.push_back(std::move(plot));
      free.push_back(are_free[i]);
    }
    for (std::size_t k = cut; k < members.size(); ++k) {
      const std::uint32_t plot =
          is_reversed ? members[cut] - members[k] : members[k] - members[cut];
      tail_.push_back({plot, own[best][k].time_s, own[best][k].state});
      free[plot] = 1;
    }
    const double score = own[best][cut].score;
    std::vector<Hypothesis> initial_hypotheses;
    for (const std::vector<Hypothesis>& alternative : own) {
      initial_hypotheses.push_back(alternative[cut]);
      initial_hypotheses.back().score -= score;
      initial_hypotheses.back().plot = static_cast<std::int32_t>(tail_.front().plot);
    }
    const double min_score =
        models_[best].ScoreAfterMisses(own[best].back(), end_) - score - kNegligibleLog;
    Search(initial_hypotheses, free, min_score);
  }

  // `log_evidence_ratio`: log likelihood ratio in favour of the path, from measurements after its
  // last plot.
  std::vector<AlternativeMode> AlternativeModes(double log_evidence_ratio) const {
    double best = -std::numeric_limits<double>::infinity();
    for (const AlternativePath& one : alternatives_) best = std::max(best, one.score);
    std::vector<double> weights;
    double all = 0.0;
    for (const AlternativePath& alternative : alternatives_) {
      weights.push_back(std::exp(alternative.score - best -
                                 (IsReportedPath(alternative) ? 0.0 : log_evidence_ratio)));
      all += weights.back();
    }
    std::vector<AlternativeMode> alternative_modes;
    for (const TimeNs time_ns : frames_ns_) {
      AlternativeMode mode;
      mode.time_ns = time_ns;
      double sum = 0.0;
      Eigen::Vector3d square_sum_m2 = Eigen::Vector3d::Zero();
      const auto own = After(tail_, time_ns);
      for (std::size_t k = 0; k < alternatives_.size(); ++k) {
        const AlternativePath& alternative = alternatives_[k];
        const std::size_t next = After(alternative.steps, time_ns);
        if (IsOnReportedPath(alternative, next, own)) continue;
        const auto [position_m, variance_m2] = At(alternative, next, time_ns);
        const Eigen::Vector3d from_origin_m = position_m - plots_[tail_.front().plot].position_m;
        sum += weights[k];
        mode.position_m += weights[k] * from_origin_m;
        square_sum_m2.array() += weights[k] * (from_origin_m.array().square() + variance_m2);
      }
      if (sum > kMinProbability * all) {
        mode.probability = sum / all;
        mode.position_m /= sum;
        mode.variance_m2 = square_sum_m2 / sum - mode.position_m.cwiseAbs2();
        mode.position_m += plots_[tail_.front().plot].position_m;
      }
      alternative_modes.push_back(mode);
    }
    return alternative_modes;
  }

 private:
  // Appends the alternatives that continue from these hypotheses, one per model.
  void Search(const std::vector<Hypothesis>& initial_hypotheses, const std::vector<char>& free,
              double min_score) {
    const std::vector<double> log_births(plots_.size(), -std::numeric_limits<double>::infinity());
    std::vector<TrackSearch> searches;
    std::vector<std::vector<Hypothesis>> hypotheses(models_.size());  // (models, nodes)
    for (std::size_t m = 0; m < models_.size(); ++m) {
      searches.emplace_back(log_births, free, models_[m], config_);
      searches.back().Begin(initial_hypotheses[m]);
      searches.back().AppendLatest(&hypotheses[m]);
    }
    for (const Scan& scan : ScansOf(plots_, log_births, scan_schedule_, begin_ns_)) {
      if (scan.at.time_s <= initial_hypotheses.front().time_s) continue;
      for (std::size_t m = 0; m < searches.size(); ++m) {
        searches[m].Extend(scan);
        searches[m].AppendLatest(&hypotheses[m]);
      }
    }
    for (std::size_t m = 0; m < models_.size(); ++m)
      AppendAlternatives(hypotheses[m], m, min_score);
  }

  // Appends all hypotheses (nodes) of a search, with missed detections from their last plots to the
  // end, whose score is then at least `min_score`.
  void AppendAlternatives(const std::vector<Hypothesis>& hypotheses, std::size_t model,
                          double min_score) {
    for (const Hypothesis& last : hypotheses) {
      if (last.score < min_score) continue;
      AlternativePath alternative;
      alternative.model = model;
      alternative.score = models_[model].ScoreAfterMisses(last, end_);
      if (alternative.score < min_score) continue;
      for (const Hypothesis* h = &last; h != nullptr;
           h = h->parent == kNoIndex ? nullptr : &hypotheses[static_cast<std::size_t>(h->parent)]) {
        alternative.steps.push_back({static_cast<std::uint32_t>(h->plot), h->time_s, h->state});
      }
      std::reverse(alternative.steps.begin(), alternative.steps.end());
      alternatives_.push_back(std::move(alternative));
    }
  }

  bool IsReportedPath(const AlternativePath& alternative) const {
    return std::equal(alternative.steps.begin(), alternative.steps.end(), tail_.begin(),
                      tail_.end(), [](const Step& a, const Step& b) { return a.plot == b.plot; });
  }

  // Sets the frames from that of the first plot of the tail to those in which its last one may
  // still be missed.
  void SetFrames(TimeNs first_ns, TimeNs tail_end_ns) {
    const TimeNs last_ns = tail_end_ns + NsOf(config_.max_gap_s);
    for (const ScanSchedule::Sensor& sensor : scan_schedule_.sensors) {
      for (const TimeNs time_ns : sensor.frame_times_ns) {
        if (first_ns <= time_ns && time_ns <= last_ns) frames_ns_.push_back(time_ns);
      }
    }
    std::sort(frames_ns_.begin(), frames_ns_.end());
    end_.time_s = Seconds(frames_ns_.back());
    for (std::uint32_t s = 0; s < scan_schedule_.sensors.size(); ++s) {
      end_.frames_before.push_back(scan_schedule_.FramesBefore(s, frames_ns_.back() + 1));
    }
  }

  double Seconds(TimeNs time_ns) const { return SecondsOf(time_ns - begin_ns_); }

  // Index of the first plot of a path later than a time; at least 1, as no time before its first
  // plot is tested.
  std::size_t After(const std::vector<Step>& steps, TimeNs time_ns) const {
    std::size_t next = 1;
    while (next < steps.size() && plots_[steps[next].plot].frame_time_ns <= time_ns) ++next;
    return next;
  }

  // True if the alternative connects the same two consecutive plots as the path does.
  bool IsOnReportedPath(const AlternativePath& alternative, std::size_t next,
                        std::size_t own) const {
    if (alternative.steps[next - 1].plot != tail_[own - 1].plot) return false;
    if (next == alternative.steps.size()) return own == tail_.size();
    return own < tail_.size() && alternative.steps[next].plot == tail_[own].plot;
  }

  // Position according to an alternative, and variance per axis: predicted from the plot before and
  // updated with the plot after, if there is one.
  std::pair<Eigen::Vector3d, double> At(const AlternativePath& alternative, std::size_t next,
                                        TimeNs time_ns) const {
    const TrackModel& model = models_[alternative.model];
    const Step& from = alternative.steps[next - 1];
    const Motion to_here = model.MotionOver(Seconds(time_ns) - from.time_s);
    const Eigen::Matrix3d mean = from.state.mean * to_here.transition.transpose();
    const Eigen::Matrix3d covariance =
        to_here.transition * from.state.covariance * to_here.transition.transpose() + to_here.noise;
    if (next == alternative.steps.size()) return {mean.col(0), covariance(0, 0)};
    const Step& to = alternative.steps[next];
    const Motion on = model.MotionOver(to.time_s - Seconds(time_ns));
    const Eigen::Vector3d onto_position = on.transition.row(0).transpose();
    const double cross_covariance_m2 = covariance.row(0).dot(onto_position);
    const double innovation_variance_m2 = onto_position.dot(covariance * onto_position) +
                                          on.noise(0, 0) + plots_[to.plot].variance_m2;
    const Eigen::Vector3d innovation_m = plots_[to.plot].position_m - mean * onto_position;
    return {mean.col(0) + cross_covariance_m2 / innovation_variance_m2 * innovation_m,
            covariance(0, 0) - cross_covariance_m2 * cross_covariance_m2 / innovation_variance_m2};
  }

  TimeNs begin_ns_ = 0;  // of the first frame with plots
  const ScanSchedule& scan_schedule_;
  const TrackerConfig& config_;
  std::vector<Plot> plots_;  // from the first of the tail on
  std::vector<Step> tail_;   // the path from the cut on
  std::vector<TimeNs> frames_ns_;
  FrameTime end_;  // of the last frame
  std::vector<TrackModel> models_;
  std::vector<AlternativePath> alternatives_;
};

}  // namespace

std::vector<AlternativeMode> AlternativeModesOf(std::size_t path, const std::vector<Path>& paths,
                                                const std::vector<Plot>& plots,
                                                const ScanSchedule& scan_schedule,
                                                const TrackerConfig& config,
                                                const std::vector<Measurement>& measurements) {
  std::vector<char> free(plots.size(), 1);
  for (const Path& other : paths) {
    if (other.score < kInitiationLog) continue;
    for (const std::uint32_t i : other.plots) free[i] = 0;
  }
  const Members& members = paths[path].plots;
  double log_ratio_before = 0.0;
  double log_ratio_after = 0.0;
  for (const Measurement& m : measurements) {
    if (m.time_ns < plots[members.front()].time_ns - kSameFrameNs) log_ratio_before += m.log_ratio;
    if (m.time_ns > plots[members.back()].time_ns + kSameFrameNs) log_ratio_after += m.log_ratio;
  }
  std::vector<AlternativeMode> alternative_modes =
      AlternativePaths(plots, free, paths[path], scan_schedule, false, config)
          .AlternativeModes(log_ratio_after);
  const ScanSchedule time_reversed = TimeReversed(scan_schedule);
  const AlternativePaths alternatives(plots, free, paths[path], time_reversed, true, config);
  for (AlternativeMode mode : alternatives.AlternativeModes(log_ratio_before)) {
    mode.time_ns = TimeReversed(mode.time_ns);
    alternative_modes.push_back(mode);
  }
  std::stable_sort(alternative_modes.begin(), alternative_modes.end(),
                   By(&AlternativeMode::time_ns));
  return alternative_modes;
}

}  // namespace unlidar
