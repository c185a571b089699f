// Validation of stamps: the time of a stream is that of most LiDARs, never of a single deviant one.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "io/arrival.hpp"
#include "io/frame_directory.hpp"
#include "unlidar/config.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

struct FrameStamp {
  std::uint32_t sensor = 0;
  TimeNs time_ns = 0;  // with the sensor's time offset
  std::optional<Arrival> arrival;
};

// Each active sensor has a clock: its last stamp plus the time elapsed since, from the steps of
// all stamps, or from the host clock (this computer) where that agrees with the stream. A stamp is
// confirmed if the clocks of most other sensors have reached it; the stamp of a single sensor, if
// it is ahead by no more than a short pause. Any other frame is held. When several in a row
// continue from each other, and no more sensors contradict them than agree, they become the
// current clock, and all frames held with them are taken.
//
// The host clock agrees with a stamp within kHostClockToleranceNs. While it agrees with the stream,
// no other clock takes over from sensors that are still active; if it agrees with the held frames,
// it decides a tie; if it agrees with both sides, the side whose stamps are nearer to it wins. It
// never rejects the stamps of an old recording that is played back.
class StampValidator {
 public:
  static constexpr int kFramesToConfirm = 8;  // frames in a row; fewer may be wrong
  static constexpr TimeNs kHostClockToleranceNs = 60'000'000'000;

  // kTaken: confirmed, in order. kLate: newer frames were taken. kUnconfirmed: to be held.
  // kRestart: confirmed, and unrelated to all frames taken before.
  enum class Verdict { kTaken, kLate, kUnconfirmed, kRestart };

  explicit StampValidator(const LiveConfig& config);

  void AddSensor() { clocks_.emplace_back(); }

  // Judges the next frame received, also one that is skipped for another reason.
  Verdict Judge(const FrameStamp& stamp);

  // True if a held frame may be taken now, in the order of stamps.
  bool IsConfirmed(std::uint32_t sensor, TimeNs time_ns) const;

  // True if it may still be confirmed: its sensor is active, and its last frames continue from it.
  bool IsPending(std::uint32_t sensor, TimeNs time_ns) const;

  // Advances newest_ns() to a stamp or the time now; never moves it back.
  void Take(TimeNs time_ns) { newest_ns_ = std::max(newest_ns_.value_or(time_ns), time_ns); }

  // True if the last frame of a sensor did not follow the clock of the stream.
  bool IsOutOfSync(std::uint32_t sensor) const { return clocks_[sensor].run > 0; }

  // Resets the clock of a sensor that is replaced by another one.
  void Replace(std::uint32_t sensor) { clocks_[sensor] = Clock(); }

  // Restarts the stream: no stamp is taken yet.
  void Begin();
  bool has_begun() const { return newest_ns_.has_value(); }

  TimeNs newest_ns() const { return newest_ns_.value_or(0); }

 private:
  struct Clock {
    std::optional<TimeNs> last_ns;     // last stamp, taken or not
    std::array<TimeNs, 3> steps_ns{};  // last steps, 0 where the stamp went back
    TimeNs heard_ns = 0;               // stream_ns_ at the last stamp
    TimeNs heard_steady_ns = 0;
    TimeNs host_clock_error_ns = kMaxStampNs;  // of the last stamp, absolute
    // Run: consecutive frames that are out of sync with the stream and continue from each other.
    int run = 0;
    TimeNs run_begin_ns = 0;
    TimeNs run_end_ns = 0;
    TimeNs run_steady_ns = 0;  // host time of its start
    bool is_run_confirmed = false;

    bool MatchesHostClock() const { return host_clock_error_ns <= kHostClockToleranceNs; }

    bool HasInRun(TimeNs time_ns) const { return run_begin_ns <= time_ns && time_ns <= run_end_ns; }

    // Shortest recent step, robust to lost frames. Capped above the period of any LiDAR, so that
    // sums of a few periods and a stamp do not overflow.
    TimeNs period_ns() const {
      constexpr TimeNs kMaxPeriodNs = kMaxStampNs / (4 * kFramesToConfirm);
      return std::min(*std::min_element(steps_ns.begin(), steps_ns.end()), kMaxPeriodNs);
    }
  };

  void UpdateClock(const FrameStamp& stamp);
  bool IsInRunOf(const Clock& clock, TimeNs time_ns) const;
  bool IsActive(const Clock& clock) const;
  TimeNs ElapsedNs(const Clock& clock) const {
    return matches_host_clock_ && now_ ? now_->steady_ns - clock.heard_steady_ns
                                       : stream_ns_ - clock.heard_ns;
  }
  // Clamped, so that the difference of two such times does not overflow.
  TimeNs NowOf(const Clock& clock) const {
    return std::min(*clock.last_ns + ElapsedNs(clock), kMaxStampNs);
  }
  bool IsReachedByMajority(std::uint32_t sensor, TimeNs time_ns) const;
  bool ContinuesFrom(const Clock& clock, TimeNs time_ns) const;
  bool IsRunConfirmed(const FrameStamp& stamp) const;
  void ConfirmRun(const FrameStamp& stamp);

  TimeNs reorder_ns_;
  TimeNs silent_ns_;
  std::optional<TimeNs> window_ns_;  // none: endless
  std::vector<Clock> clocks_;
  std::optional<TimeNs> newest_ns_;
  TimeNs reached_ns_ = 0;            // newest confirmed stamp, taken or not
  bool matches_host_clock_ = false;  // of the newest stamp
  TimeNs stream_ns_ = 0;             // elapsed time, from the steps of stamps between frames
  std::optional<Arrival> now_;
};

}  // namespace unlidar
