#include "live/track_follower.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace unlidar {
namespace {

constexpr std::size_t kMaxLeaves = 24;
constexpr double kPauseS = 1.0;      // after it a track has to be found again,
constexpr double kFoundAgain = 8.0;  // by so much likelihood
constexpr double kFitS = 6.0;        // of measurements behind the settled one that a fit looks at
constexpr TimeNs kScalesNs = 1'500'000'000;  // how long the scales of a fit last
constexpr double kPriorReturns = 10.0;
constexpr double kGateSigmas = 6.0;

}  // namespace

TrackFollower::TrackFollower(int id, const Flight& flight, const std::vector<TrackModel>& models,
                             const TrackerConfig& tracker, const CollectConfig& collect,
                             const TrajectoryConfig& trajectory)
    : id_(id),
      models_(&models),
      tracker_(tracker),
      collect_(collect),
      trajectory_config_(trajectory),
      plots_(flight.plots.begin(), flight.plots.end()),
      first_evidence_ns_(flight.plots.front().plot.time_ns),
      body_sum_m2_(kPriorReturns * collect.body_sigma_m * collect.body_sigma_m),
      body_count_(kPriorReturns),
      body_sigma_m_(collect.body_sigma_m) {
  const std::vector<SeenPlot>& path = flight.plots;
  for (std::uint32_t m = 0; m < models.size(); ++m) {
    const TrackModel& model = models[m];
    std::vector<Node> best;
    for (const double speed_mps : tracker.birth_speeds_mps) {
      std::vector<Node> chain(1);
      chain[0].h = model.Birth(path[0].plot, flight.log_birth, path[0].at, speed_mps);
      chain[0].model = m;
      for (std::size_t k = 1; k < path.size(); ++k) {
        Node node = chain.back();
        const Motion motion = model.MotionOver(path[k].at.time_s - node.h.time_s);
        const Prediction p = model.Predict(node.h, model.ScoreUnseen(node.h, path[k].at), motion);
        node.h = model.Update(node.h, motion, p, path[k].plot, path[k].at,
                              model.GainOf(p, path[k].plot));
        node.plot = k;
        chain.push_back(node);
      }
      if (best.empty() || chain.back().h.score > best.back().h.score) best = std::move(chain);
    }
    for (std::size_t k = 0; k < best.size(); ++k) {
      best[k].parent = k == 0 ? kNone : static_cast<std::int32_t>(nodes_.size()) - 1;
      best[k].now = best[k].h.score;
      nodes_.push_back(best[k]);
    }
    leaves_.push_back(static_cast<std::int32_t>(nodes_.size()) - 1);
  }
}

std::vector<double> TrackFollower::GainsOf(const std::vector<SeenPlot>& plots,
                                           const Moment& at) const {
  std::vector<double> gains(plots.size(), -1e9);
  const Node& best = nodes_[static_cast<std::size_t>(BestLeaf())];
  const TrackModel& model = (*models_)[best.model];
  const double unseen = model.ScoreUnseen(best.h, at);
  const Prediction p = model.Predict(best.h, unseen, model.MotionOver(at.time_s - best.h.time_s));
  for (std::size_t i = 0; i < plots.size(); ++i) gains[i] = model.GainOf(p, plots[i].plot).log;
  return gains;
}

void TrackFollower::Extend(const std::vector<SeenPlot>& plots, const std::vector<char>& is_allowed,
                           const Moment& at) {
  // The best way to each plot, for each model: index of the leaf, and its score.
  struct Way {
    double score = -1e300;
    std::int32_t leaf = kNone;
    Gain gain;
  };
  const std::size_t num_models = models_->size();
  std::vector<Way> ways(plots.size() * num_models);
  std::vector<std::pair<Motion, Prediction>> predicted;
  for (const std::int32_t leaf : leaves_) {
    const Node& node = nodes_[static_cast<std::size_t>(leaf)];
    const TrackModel& model = (*models_)[node.model];
    const double dt_s = at.time_s - node.h.time_s;
    const Motion motion = model.MotionOver(dt_s);
    predicted.emplace_back(motion, model.Predict(node.h, model.ScoreUnseen(node.h, at), motion));
    const Prediction& p = predicted.back().second;
    for (std::size_t i = 0; i < plots.size(); ++i) {
      if (!is_allowed[i]) continue;
      const Plot& plot = plots[i].plot;
      const double reach_m = kGateSigmas * std::sqrt(p.agile.position_m2 + plot.variance_m2) +
                             0.2 * p.velocity_mps.norm();
      if ((plot.position_m - p.position_m).squaredNorm() > reach_m * reach_m) continue;
      const Gain gain = model.GainOf(p, plot);
      Way& way = ways[i * num_models + node.model];
      if (p.score + gain.log > way.score) way = {p.score + gain.log, leaf, gain};
    }
  }
  std::vector<std::int32_t> next;
  for (std::size_t k = 0; k < leaves_.size(); ++k) {
    Node& node = nodes_[static_cast<std::size_t>(leaves_[k])];
    node.now = predicted[k].second.score;
    if (at.time_s - node.h.time_s <= tracker_.max_gap_s) next.push_back(leaves_[k]);
  }
  for (std::size_t i = 0; i < plots.size(); ++i) {
    bool is_taken = false;
    for (std::size_t m = 0; m < num_models; ++m) {
      const Way& way = ways[i * num_models + m];
      if (way.leaf == kNone) continue;
      const auto index = static_cast<std::size_t>(
          std::find(leaves_.begin(), leaves_.end(), way.leaf) - leaves_.begin());
      const Node from = nodes_[static_cast<std::size_t>(way.leaf)];
      Node node = from;
      node.h = (*models_)[from.model].Update(from.h, predicted[index].first,
                                             predicted[index].second, plots[i].plot, at, way.gain);
      if (node.h.state.mean.col(1).norm() > tracker_.max_speed_mps) continue;
      if (at.time_s - from.h.time_s > kPauseS) {
        ++node.segment;
        node.segment_score = from.h.score;
      }
      if (!is_taken) {
        plots_.push_back(plots[i]);
        is_taken = true;
      }
      node.plot = first_plot_ + plots_.size() - 1;
      node.parent = way.leaf;
      node.now = node.h.score;
      next.push_back(static_cast<std::int32_t>(nodes_.size()));
      nodes_.push_back(node);
    }
  }
  if (next.empty()) return;  // nothing can go on: it ends
  std::sort(next.begin(), next.end(), [&](std::int32_t a, std::int32_t b) {
    const double score_a = nodes_[static_cast<std::size_t>(a)].now;
    const double score_b = nodes_[static_cast<std::size_t>(b)].now;
    return score_a > score_b || (score_a == score_b && a < b);
  });
  next.resize(std::min(next.size(), kMaxLeaves));
  leaves_ = std::move(next);
}

std::int32_t TrackFollower::BestLeaf() const {
  return *std::max_element(leaves_.begin(), leaves_.end(), [&](std::int32_t a, std::int32_t b) {
    return nodes_[static_cast<std::size_t>(a)].now < nodes_[static_cast<std::size_t>(b)].now;
  });
}

std::int32_t TrackFollower::Head() const {
  std::int32_t at = BestLeaf();
  while (true) {
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    if (node.segment == 0 || node.h.score - node.segment_score >= kFoundAgain) return at;
    std::int32_t before = node.parent;
    while (before != kNone && nodes_[static_cast<std::size_t>(before)].segment == node.segment) {
      before = nodes_[static_cast<std::size_t>(before)].parent;
    }
    if (before == kNone) return at;
    at = before;
  }
}

double TrackFollower::score() const { return nodes_[static_cast<std::size_t>(BestLeaf())].h.score; }

TimeNs TrackFollower::last_evidence_ns() const {
  return PlotOf(nodes_[static_cast<std::size_t>(Head())]).plot.time_ns;
}

std::vector<SeenPlot> TrackFollower::Settle(TimeNs until_ns) {
  std::vector<SeenPlot> settled;
  std::int32_t at = Head();
  while (at != kNone) {
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    if (PlotOf(node).plot.frame_time_ns <= until_ns) break;
    at = node.parent;
  }
  if (at == kNone || at == settled_) return settled;
  for (std::int32_t k = at; k != kNone && k != settled_;
       k = nodes_[static_cast<std::size_t>(k)].parent) {
    settled.push_back(PlotOf(nodes_[static_cast<std::size_t>(k)]));
  }
  std::reverse(settled.begin(), settled.end());
  settled_ = at;
  // What does not go on from there is no way any more.
  leaves_.erase(std::remove_if(leaves_.begin(), leaves_.end(),
                               [&](std::int32_t leaf) {
                                 std::int32_t k = leaf;
                                 while (k != kNone && k > settled_) {
                                   k = nodes_[static_cast<std::size_t>(k)].parent;
                                 }
                                 return k != settled_;
                               }),
                leaves_.end());
  // How far the returns of the body spread across the ray and the motion.
  for (const SeenPlot& seen : settled) {
    const auto n = static_cast<double>(seen.plot.returns.size());
    if (n < 2.0) continue;
    const Eigen::Vector3d across =
        seen.plot.ray_m.cross(nodes_[static_cast<std::size_t>(at)].h.state.mean.col(1))
            .stableNormalized();
    if (across.squaredNorm() < 0.5) continue;
    body_sum_m2_ += across.dot(seen.scatter_m2 * across);
    body_count_ += n - 1.0;
  }
  body_sigma_m_ = std::sqrt(body_sum_m2_ / body_count_);
  Forget();
  return settled;
}

// Of what is settled only what a fit still looks at is kept.
void TrackFollower::Forget() {
  const double from_s = nodes_[static_cast<std::size_t>(settled_)].h.time_s - kFitS;
  constexpr std::size_t kWorthWhile = 512;
  if (nodes_.size() < kWorthWhile) return;
  std::vector<std::int32_t> moved(nodes_.size(), kNone);
  constexpr std::int32_t kWanted = 0;
  std::size_t first_plot = first_plot_ + plots_.size() - 1;
  for (const std::int32_t leaf : leaves_) {
    for (std::int32_t k = leaf; k != kNone;) {
      const Node& node = nodes_[static_cast<std::size_t>(k)];
      if (k < settled_ && node.h.time_s < from_s) break;
      first_plot = std::min(first_plot, node.plot);
      if (moved[static_cast<std::size_t>(k)] == kWanted) break;
      moved[static_cast<std::size_t>(k)] = kWanted;
      k = node.parent;
    }
  }
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    if (moved[k] != kWanted) continue;
    Node node = nodes_[k];
    if (node.parent != kNone) node.parent = moved[static_cast<std::size_t>(node.parent)];
    moved[k] = static_cast<std::int32_t>(kept);
    nodes_[kept++] = node;
  }
  nodes_.resize(kept);
  for (std::int32_t& leaf : leaves_) leaf = moved[static_cast<std::size_t>(leaf)];
  settled_ = moved[static_cast<std::size_t>(settled_)];
  for (; first_plot_ < first_plot; ++first_plot_) plots_.pop_front();
}

// As the collection of a recording measures the returns of a frame.
Measurement TrackFollower::Measure(const Node& node) const {
  const SeenPlot& seen = PlotOf(node);
  const auto n = static_cast<double>(seen.plot.returns.size());
  const double range_m = seen.plot.ray_m.norm();
  const double beam_m = collect_.beam_sigma_rad * range_m;
  Measurement m;
  m.time_ns = seen.plot.time_ns;
  m.position_m = seen.plot.position_m +
                 collect_.facing_side * body_sigma_m_ * seen.plot.ray_m.stableNormalized();
  m.viewpoint_m = seen.plot.position_m - seen.plot.ray_m;
  m.support = static_cast<int>(seen.plot.returns.size());
  const Eigen::Vector3d along_m = node.h.state.mean.col(1) * seen.plot.streak_s;
  m.covariance_m2 = (collect_.centre_sigma_m * collect_.centre_sigma_m +
                     (body_sigma_m_ * body_sigma_m_ + beam_m * beam_m) / n) *
                        Eigen::Matrix3d::Identity() +
                    along_m * along_m.transpose() / 12.0 / n;
  return m;
}

void TrackFollower::Fit() {
  measurements_.clear();
  returns_.clear();
  const std::int32_t head = Head();
  const double from_s =
      settled_ == kNone
          ? -1e300
          : nodes_[static_cast<std::size_t>(std::min(head, settled_))].h.time_s - kFitS;
  for (std::int32_t k = head; k != kNone; k = nodes_[static_cast<std::size_t>(k)].parent) {
    const Node& node = nodes_[static_cast<std::size_t>(k)];
    if (node.h.time_s < from_s) break;
    measurements_.push_back(Measure(node));
    returns_.emplace_back(PlotOf(node).stamp_ns, measurements_.back().support);
  }
  std::stable_sort(
      measurements_.begin(), measurements_.end(),
      [](const Measurement& a, const Measurement& b) { return a.time_ns < b.time_ns; });
  const TimeNs now_ns = measurements_.back().time_ns;
  if (!trajectory_ || now_ns - scales_ns_ > kScalesNs) {
    trajectory_ = FitTrajectory(measurements_, trajectory_config_);
    scales_ns_ = now_ns;
  } else {
    trajectory_ = RefitTrajectory(measurements_, trajectory_->scales, trajectory_config_);
  }
}

int TrackFollower::ReturnsBetween(TimeNs from_ns, TimeNs to_ns) const {
  int sum = 0;
  for (const auto& [stamp_ns, returns] : returns_) {
    if (stamp_ns >= from_ns && stamp_ns < to_ns) sum += returns;
  }
  return sum;
}

bool TrackFollower::IsNear(const Eigen::Vector3d& place_m, double time_s) const {
  constexpr double kNear_m = 1.5;
  const Node* before = &nodes_[static_cast<std::size_t>(BestLeaf())];
  while (before->h.time_s > time_s && before->parent != kNone) {
    before = &nodes_[static_cast<std::size_t>(before->parent)];
  }
  const Eigen::Vector3d at_m =
      before->h.state.mean.col(0) + (time_s - before->h.time_s) * before->h.state.mean.col(1);
  return (at_m - place_m).norm() < kNear_m;
}

}  // namespace unlidar
