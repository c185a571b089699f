// Measurements and decisions of a search, for --trace.
#pragma once

#include <functional>
#include <vector>

#include "base/recording.hpp"
#include "scene/plots.hpp"
#include "tracking/rejection.hpp"
#include "tracking/tracker.hpp"

namespace unlidar {

// Decision on a path.
struct PathVerdict {
  double crowding_penalty = 0.0;  // subtracted from its score
  Rejection rejection = Rejection::kNone;
};

struct SearchTrace {
  const std::vector<Plot>& plots;            // in order of time
  const std::vector<char>& are_bodies;       // (returns)
  const std::vector<Path>& paths;            // by falling score
  const std::vector<PathVerdict>& verdicts;  // (paths)
  double score_threshold;
};

// Called at the end of a search; recording and trace are valid during the call only.
using TraceSink = std::function<void(const Recording& recording, const SearchTrace& trace)>;

}  // namespace unlidar
