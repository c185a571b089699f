// The best path through plots: dynamic programming over all of them in order of time.
#pragma once

#include <cstdint>
#include <vector>

#include "track_model.hpp"

namespace unlidar {

class TrackSearch {
 public:
  // Searches at once; `free` is kept and may change before Best is asked. Sizes of `log_births` and
  // `free`: that of `plots`.
  TrackSearch(const std::vector<Plot>& plots, const std::vector<double>& log_births,
              const std::vector<char>& free, const TrackModel& model, const TrackerConfig& config);

  // The best path through plots that are still free.
  Path Best() const;

 private:
  struct Active {
    std::int32_t history;
    double score_if_visible;
    double score;
  };
  struct Candidate {
    double score;
    Gain gain;
    std::size_t index;
  };

  // Carries all hypotheses on to the plots [first, last) of one time.
  void Extend(std::size_t first, std::size_t last);
  void Retire(double time_s, std::size_t num_plots);
  void FindCandidates(std::size_t first, std::size_t last, double time_s);
  double LeastScore(std::size_t plot) const;

  const std::vector<Plot>& plots_;
  const std::vector<double>& log_births_;
  const std::vector<char>& free_;
  TrackModel model_;
  const TrackerConfig& config_;
  std::vector<Hypothesis> history_;
  std::vector<Active> active_;
  std::vector<Prediction> predictions_;
  std::vector<std::vector<Candidate>> candidates_;  // per plot of the time at hand
};

}  // namespace unlidar
