#include "scene/scene_frames.hpp"

#include <algorithm>
#include <cstddef>

namespace unlidar {

std::vector<FrameInfo> SceneFrames(const Recording& recording) {
  constexpr std::size_t kSeconds = 90;
  std::vector<std::size_t> seconds;  // (frames) index of its second among those with frames
  TimeNs begin_ns = 0;
  for (const FrameInfo& frame : recording.frames) {
    const bool is_next = seconds.empty() || frame.stamp_ns >= begin_ns + kNsPerSecond;
    if (is_next) begin_ns = frame.stamp_ns;
    seconds.push_back(seconds.empty() ? 0 : seconds.back() + (is_next ? 1 : 0));
  }
  std::vector<FrameInfo> frames;
  for (std::size_t f = 0; f < seconds.size(); ++f) {
    if (seconds[f] % (1 + seconds.back() / kSeconds) == 0) frames.push_back(recording.frames[f]);
  }
  return frames;
}

std::vector<std::uint32_t> ReturnsOf(const std::vector<FrameInfo>& frames,
                                     const std::vector<std::uint32_t>& returns) {
  std::vector<std::uint32_t> found;
  auto at = returns.begin();
  for (const FrameInfo& frame : frames) {
    at = std::lower_bound(at, returns.end(), frame.first_return);
    const auto last = std::lower_bound(at, returns.end(), frame.last_return);
    found.insert(found.end(), at, last);
    at = last;
  }
  return found;
}

}  // namespace unlidar
