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
  struct Candidate {
    double score;
    Gain gain;
    std::size_t index;  // of the prediction
  };

  // Carries all hypotheses on to the plots [first, last) of one time.
  void Extend(std::size_t first, std::size_t last);
  void Add(const Hypothesis& hypothesis);
  void Predict(double time_s);
  void KeepBest(std::size_t first, std::size_t last);
  void FindCandidates(std::size_t first, std::size_t last);
  double LeastScore(std::size_t plot) const;

  const std::vector<Plot>& plots_;
  const std::vector<double>& log_births_;
  const std::vector<char>& free_;
  TrackModel model_;
  const TrackerConfig& config_;
  std::vector<Hypothesis> history_;
  std::vector<std::int32_t> active_;     // those that may go on: indices into the history
  std::vector<Prediction> predictions_;  // of the active ones, at the time at hand
  VarianceRange variances_;              // of the plots at the time at hand
  std::vector<std::vector<Candidate>> candidates_;  // per plot of the time at hand
};

}  // namespace unlidar
