// The history of a search: its paths, and the hypotheses that they need.

#include "base/algorithms.hpp"
#include "tracking/track_search.hpp"

namespace unlidar {
namespace {

constexpr std::int32_t kKept = 0;  // mark of what stays in the history

}  // namespace

Path TrackSearch::Best() {
  const auto is_free = [&](std::uint32_t plot) { return free_[plot] != 0; };
  for (Path path; !ends_.empty(); ends_.pop_back()) {
    SetPathTo(ends_.front().hypothesis, &path);
    if (std::all_of(path.plots.begin(), path.plots.end(), is_free)) return path;
    std::pop_heap(ends_.begin(), ends_.end());
  }
  return {};
}

void TrackSearch::SetPathTo(std::int32_t hypothesis, Path* path) const {
  path->plots.clear();
  path->score = NodeAt(hypothesis).score;
  for (std::int32_t at = hypothesis; at != kNoIndex; at = NodeAt(at).parent) {
    path->plots.push_back(static_cast<std::uint32_t>(NodeAt(at).plot));
  }
  std::reverse(path->plots.begin(), path->plots.end());
}

void TrackSearch::AppendPathsToLastScan(double min_score, Queue<Path>* paths) const {
  // The hypotheses of one plot are adjacent.
  for (std::size_t first = last_scan_; first < history_.size();) {
    std::size_t best = first;
    std::size_t h = first;
    for (; h < history_.size() && history_[h].plot == history_[first].plot; ++h) {
      if (history_[h].score > history_[best].score) best = h;
    }
    if (history_[best].score >= min_score) {
      SetPathTo(static_cast<std::int32_t>(best), &paths->Append());
    }
    first = h;
  }
}

void TrackSearch::RaiseScores(std::size_t first, std::vector<double>* scores) const {
  for (std::size_t h = last_scan_; h < history_.size(); ++h) {
    if (history_[h].num_plots < static_cast<std::uint32_t>(kMinPathPlots)) continue;
    double& score = (*scores)[static_cast<std::size_t>(history_[h].plot) - first];
    score = std::max(score, history_[h].score);
  }
}

void TrackSearch::AppendLatest(std::vector<Hypothesis>* hypotheses) const {
  const auto count = static_cast<std::ptrdiff_t>(history_.size() - last_scan_);
  hypotheses->insert(hypotheses->end(), active_.end() - count, active_.end());
}

// Appends the paths that end in the last scan. One that scores no more than a part of it from its
// first plot on is never the best: wherever it is free, so is that part. Among strays nearly all
// are such.
void TrackSearch::AppendEnds(double min_score) {
  const auto min_plots = static_cast<std::uint32_t>(kMinPathPlots);
  const auto count = static_cast<std::ptrdiff_t>(history_.size() - last_scan_);
  std::for_each(active_.end() - count, active_.end(), [&](Hypothesis& h) {
    if (h.num_plots < min_plots || h.score <= std::max(min_score, h.peak_score)) return;
    h.peak_score = h.score;
    ends_.push_back({h.score, h.node});
  });
}

void TrackSearch::DropAssigned() {
  std::vector<std::int32_t>& is_assigned = marks_;
  is_assigned.resize(history_.size());
  for (std::size_t h = 0; h < history_.size(); ++h) {
    const Node& node = history_[h];
    is_assigned[h] = !free_[static_cast<std::size_t>(node.plot)] ||
                     (node.parent != kNoIndex && MarkOf(node.parent) != 0);
  }
  EraseIf(&active_, [&](const Hypothesis& h) { return MarkOf(h.node) != 0; });
}

// Marks a node and its ancestors, back to the plot `first_plot`.
void TrackSearch::MarkAncestors(std::int32_t node, std::int32_t first_plot) {
  for (std::int32_t h = node; h != kNoIndex && MarkOf(h) != kKept; h = NodeAt(h).parent) {
    if (NodeAt(h).plot < first_plot) return;
    MarkOf(h) = kKept;
  }
}

void TrackSearch::Forget(std::size_t num_plots) {
  const auto first_plot = static_cast<std::int32_t>(num_plots);
  EraseIf(&active_, [&](const Hypothesis& h) { return h.plot < first_plot; });
  marks_.reserve(history_.capacity());  // so that a stream seldom allocates
  marks_.assign(history_.size(), kNoIndex);
  for (const PathEnd& end : ends_) MarkAncestors(end.hypothesis, first_plot);
  for (const Hypothesis& h : active_) MarkAncestors(h.node, first_plot);
  std::size_t kept = 0;
  for (std::size_t h = 0; h < history_.size(); ++h) {
    if (marks_[h] != kKept) continue;
    Node node = history_[h];
    node.plot -= first_plot;
    if (node.parent != kNoIndex) node.parent = MarkOf(node.parent);
    marks_[h] = static_cast<std::int32_t>(kept);  // from now on its new index
    history_[kept++] = node;
  }
  history_.resize(kept);
  last_scan_ = kept;
  for (PathEnd& end : ends_) end.hypothesis = MarkOf(end.hypothesis);
  for (Hypothesis& h : active_) {
    h.node = MarkOf(h.node);
    h.plot = NodeAt(h.node).plot;
    h.parent = NodeAt(h.node).parent;
  }
}

}  // namespace unlidar
