// Which stamps a stream believes: its time is that of most LiDARs, never of one that is astray.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/recording.hpp"
#include "io/arrival.hpp"
#include "io/frame_directory.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

struct FrameStamp {
  std::uint32_t sensor = 0;
  TimeNs time_ns = 0;  // with the sensor's time offset
  std::optional<Arrival> arrival;
};

// Each sensor that was heard lately has a clock: its last stamp, and the time that has passed
// since, by the steps of all stamps, or by this computer where its clock bears the stream out. A
// stamp is borne out where the clocks of most other sensors have come as far; that of a sensor
// alone, where it is no farther ahead than a short pause. Any other frame is set aside. When
// several in a row go on from each other, and no more sensors contradict them than agree, they are
// the clock of now: all that were set aside are taken then.
//
// This computer's clock bears out a stamp within kHostClockToleranceNs. As long as it bears out the
// stream nothing else takes over from sensors that are still heard; where it bears out the frames
// that were set aside it decides a tie; where it bears out both sides, the side whose stamps are
// nearer to it wins. It never refuses the stamps of an old recording that is played.
class StampValidator {
 public:
  static constexpr int kFramesToConfirm = 8;  // frames in a row; fewer may be astray
  static constexpr TimeNs kHostClockToleranceNs = 60'000'000'000;

  // Taken: now, in order. Late: newer ones were taken. Aside: not borne out yet.
  // Anew: borne out, and unrelated to all that was taken before.
  enum class Verdict { kTaken, kLate, kUnconfirmed, kRestart };

  explicit StampValidator(const LiveConfig& config);

  void AddSensor() { clocks_.emplace_back(); }

  // On the next frame that has come, also of one that is left out for another reason.
  Verdict Judge(const FrameStamp& stamp);

  // Whether a frame that was set aside may be taken now, in the order of stamps.
  bool IsConfirmed(std::uint32_t sensor, TimeNs time_ns) const;

  // Whether it may yet be borne out: the last frames of its sensor, which is heard, go on from it.
  bool IsPending(std::uint32_t sensor, TimeNs time_ns) const;

  // Takes a stamp, or as much time as has passed; newest_ns() never falls by it.
  void Take(TimeNs time_ns);

  // Whether the last frame of a sensor was none of the stream's clock.
  bool IsOutOfSync(std::uint32_t sensor) const { return clocks_[sensor].run > 0; }

  // The sensor is another one from now on.
  void Replace(std::uint32_t sensor) { clocks_[sensor] = Clock(); }

  // No stamp was taken yet.
  void Begin();
  bool has_begun() const { return newest_ns_.has_value(); }

  TimeNs newest_ns() const { return newest_ns_.value_or(0); }

 private:
  struct Clock {
    std::optional<TimeNs> last_ns;     // stamp, whatever became of it
    std::array<TimeNs, 3> steps_ns{};  // the last ones, 0 where it went back
    TimeNs heard_ns = 0;               // by stream_ns_
    TimeNs heard_steady_ns = 0;
    TimeNs host_clock_error_ns =
        kMaxStampNs;  // the last stamp from this computer's clock, either way
    // The frames in a row that are apart from the others, and go on from each other.
    int run = 0;
    TimeNs run_begin_ns = 0;
    TimeNs run_end_ns = 0;
    TimeNs run_steady_ns = 0;  // when it began
    bool is_run_confirmed = false;

    // From frame to frame, also where only every so many come.
    // A longer step is none of a LiDAR; sums of some such periods and a stamp are still times.
    TimeNs period_ns() const {
      constexpr TimeNs kMaxPeriodNs = kMaxStampNs / (4 * kFramesToConfirm);
      return std::min(*std::min_element(steps_ns.begin(), steps_ns.end()), kMaxPeriodNs);
    }
  };

  void UpdateClock(const FrameStamp& stamp);
  void ExtendOutOfSyncRun(const FrameStamp& stamp, Clock* clock) const;
  bool MatchesHostClock(const FrameStamp& stamp) const;
  bool IsActive(const Clock& clock) const;
  TimeNs ElapsedNs(const Clock& clock) const;
  TimeNs NowOf(const Clock& clock) const;
  bool IsReachedByMajority(std::uint32_t sensor, TimeNs time_ns) const;
  bool ContinuesFrom(const Clock& clock, TimeNs time_ns) const;
  bool IsRunConfirmed(const FrameStamp& stamp) const;
  void ConfirmRun(const FrameStamp& stamp);

  TimeNs reorder_ns_;
  TimeNs silent_ns_;
  std::optional<TimeNs> window_ns_;  // none: endless
  std::vector<Clock> clocks_;
  std::optional<TimeNs> newest_ns_;
  TimeNs reached_ns_ = 0;  // the newest stamp that was borne out, whether or not it was taken
  bool matches_host_clock_ = false;  // the newest stamp
  TimeNs stream_ns_ = 0;             // time that has passed, by steps of stamps from frame to frame
  std::optional<Arrival> now_;
};

}  // namespace unlidar
