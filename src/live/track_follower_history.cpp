// History of a followed track: its settled plots and its paths, and the nodes that they need.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "base/algorithms.hpp"
#include "base/maths.hpp"
#include "collection/body.hpp"
#include "live/track_follower.hpp"

namespace unlidar {
namespace {

constexpr std::int32_t kKept = 0;  // mark of a node
constexpr std::size_t kNoPlot = ~std::size_t{0};

}  // namespace

void TrackFollower::Settle(TimeNs until_ns, std::vector<LivePlot>* settled) {
  std::int32_t at = NewestConfirmed();
  while (at != kNoIndex) {
    const Node& node = NodeAt(at);
    if (PlotOf(node).plot.frame_time_ns <= until_ns) break;
    at = node.parent;
  }
  if (at == kNoIndex || at == settled_) return;
  const auto first = static_cast<std::ptrdiff_t>(settled->size());
  for (std::int32_t k = at; k != kNoIndex && k != settled_; k = NodeAt(k).parent) {
    settled->push_back(PlotOf(NodeAt(k)));
    AddToTimings(NodeAt(k), &settled_timings_);
  }
  std::reverse(settled->begin() + first, settled->end());
  settled_ = at;
  // Deletes the hypotheses that do not pass through the settled node.
  EraseIf(&leaves_, [&](std::int32_t leaf) {
    std::int32_t k = leaf;
    while (k != kNoIndex && k > settled_) {
      k = NodeAt(k).parent;
    }
    return k != settled_;
  });
  for (auto its = settled->begin() + first; its != settled->end(); ++its) {
    AddToBody(*its, NodeAt(at).h.state.mean.col(1));
  }
  Forget();
}

// Adds to width and shape of the body, as BodySpread of a recording has them: across the ray,
// less what the target moves meanwhile. Without point times that is known from the frame alone.
void TrackFollower::AddToBody(const LivePlot& seen, const Eigen::Vector3d& velocity_mps) {
  if (seen.plot.num_returns < 2) return;
  const auto freedom = static_cast<double>(seen.plot.num_returns) - 1.0;
  const Eigen::Vector3d across = AcrossRay(seen.plot.ray_m);
  const double speed_mps = across.dot(velocity_mps);
  const double streak_m2 = across.dot(StreakM2(seen.plot.streak_s, velocity_mps) * across);
  const double weight = BodyWeight(Square(collect_.extent_sigma_m), streak_m2);
  const double moved_m2 = speed_mps * (2.0 * across.dot(seen.time_covariance_ms.cast<double>()) -
                                       speed_mps * static_cast<double>(seen.time_scatter_s2)) +
                          freedom * streak_m2;
  body_scatter_m2_ += weight * (across.dot(seen.scatter_m2.Full() * across) - moved_m2);
  body_count_ += weight * freedom;
  body_sigma_m_ = std::sqrt(std::max(body_scatter_m2_, 0.0) / body_count_);
  const double passed_m2 = Square(speed_mps) * static_cast<double>(seen.time_scatter_s2) / freedom;
  if (!uses_round_bodies_ || !ShowsShape(Square(collect_.extent_sigma_m), passed_m2 + streak_m2)) {
    return;
  }
  facing_side_.Add(seen.facing_sums);
  facing_ = facing_side_.Share(body_sigma_m_, collect_.centroid_offset);
}

std::int32_t TrackFollower::LikeliestEnd() const {
  const auto best =
      std::max_element(nodes_.begin(), nodes_.end(),
                       [](const Node& a, const Node& b) { return a.h.score < b.h.score; });
  return static_cast<std::int32_t>(best - nodes_.begin());
}

void TrackFollower::GetLikeliestPath(std::vector<LivePlot>* plots) const {
  for (std::int32_t at = LikeliestEnd(); at != kNoIndex; at = NodeAt(at).parent) {
    plots->push_back(PlotOf(NodeAt(at)));
  }
  std::reverse(plots->begin(), plots->end());
}

// Marks a leaf and its ancestors as kept, back to those that are settled and before `from_s`.
void TrackFollower::MarkAncestors(std::int32_t leaf, double from_s) {
  for (std::int32_t k = leaf; k != kNoIndex && scratch_.moved[static_cast<std::size_t>(k)] != kKept;
       k = NodeAt(k).parent) {
    if (k < settled_ && NodeAt(k).h.time_s < from_s) return;
    scratch_.moved[static_cast<std::size_t>(k)] = kKept;
  }
}

// Deletes the nodes that no leaf descends from, with their plots, and those older than the fit
// needs: among strays nearly all lead nowhere. The likeliest path may end at any node until nodes
// are settled.
void TrackFollower::Forget() {
  constexpr std::size_t kMinNodesToCompact = 512;
  if (nodes_.size() < kMinNodesToCompact) return;
  const double from_s = settled_ == kNoIndex ? 0.0 : NodeAt(settled_).h.time_s - kTrackFitS;
  std::vector<std::int32_t>& moved = scratch_.moved;
  moved.reserve(nodes_.capacity());
  moved.assign(nodes_.size(), kNoIndex);
  for (const std::int32_t leaf : leaves_) MarkAncestors(leaf, from_s);
  if (settled_ == kNoIndex) MarkAncestors(LikeliestEnd(), from_s);
  std::vector<std::size_t>& moved_plots = scratch_.moved_plots;
  moved_plots.reserve(plots_.capacity());
  moved_plots.assign(plots_.size(), kNoPlot);
  std::size_t kept = 0;
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    if (moved[k] != kKept) continue;
    Node node = nodes_[k];
    if (node.parent != kNoIndex) node.parent = moved[static_cast<std::size_t>(node.parent)];
    moved[k] = static_cast<std::int32_t>(kept);  // it may be confirmed itself
    node.confirmed = moved[static_cast<std::size_t>(std::max(settled_, node.confirmed))];
    moved_plots[node.plot] = 0;
    nodes_[kept++] = node;
  }
  nodes_.resize(kept);
  num_kept_nodes_ = kept;
  for (std::int32_t& leaf : leaves_) leaf = moved[static_cast<std::size_t>(leaf)];
  if (settled_ != kNoIndex) settled_ = moved[static_cast<std::size_t>(settled_)];
  std::size_t num_plots = 0;
  for (std::size_t i = 0; i < plots_.size(); ++i) {
    if (moved_plots[i] == kNoPlot) continue;
    if (num_plots != i) plots_[num_plots] = std::move(plots_[i]);
    moved_plots[i] = num_plots++;
  }
  plots_.resize(num_plots);
  for (Node& node : nodes_) node.plot = moved_plots[node.plot];
  frame_times_.Forget(plots_.front().plot.frame);
}

}  // namespace unlidar
