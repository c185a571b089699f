#include "live/stamp_validator.hpp"

#include <cmath>
#include <cstdlib>

#include "base/recording.hpp"

namespace unlidar {
namespace {

// Larger differences are those of clocks, not of network delay.
constexpr TimeNs kMaxClockDifferenceNs = 1'000'000'000;

// A clock that went back by less catches up sooner than a restart learns the scene.
constexpr TimeNs kCatchUpNs = 5'000'000'000;

// Frames within this time of the host clock may be a burst of packets and confirm nothing.
constexpr TimeNs kBurstNs = 200'000'000;

// Required advantage in distance to the host clock: hysteresis for two clocks on both sides of it.
constexpr TimeNs kHostClockMarginNs = 500'000'000;

}  // namespace

StampValidator::StampValidator(const LiveConfig& config)
    : reorder_ns_(NsOf(config.reorder_s)), silent_ns_(NsOf(config.silent_s)) {
  if (std::isfinite(config.window_s)) window_ns_ = NsOf(config.window_s);
}

StampValidator::Verdict StampValidator::Judge(const FrameStamp& stamp) {
  UpdateClock(stamp);
  Clock& clock = clocks_[stamp.sensor];
  const TimeNs time_ns = stamp.time_ns;
  if (newest_ns_ ? IsReachedByMajority(stamp.sensor, time_ns)
                 : !stamp.arrival || clock.MatchesHostClock()) {
    const bool is_late = newest_ns_ && time_ns < *newest_ns_ - reorder_ns_;
    if (!is_late || time_ns >= *newest_ns_ - std::max(kMaxClockDifferenceNs, reorder_ns_)) {
      clock.run = 0;
      if (is_late) return Verdict::kLate;
      if (!newest_ns_) ConfirmRun(stamp);
      matches_host_clock_ = clock.MatchesHostClock();
      reached_ns_ = newest_ns_ ? std::max(reached_ns_, time_ns) : time_ns;
      return Verdict::kTaken;
    }
  }
  if (clock.run++ == 0) {
    clock.run_begin_ns = clock.run_end_ns = time_ns;
    if (now_) clock.run_steady_ns = now_->steady_ns;
  }
  clock.run_begin_ns = std::min(clock.run_begin_ns, time_ns);
  clock.run_end_ns = std::max(clock.run_end_ns, time_ns);
  const bool is_behind = newest_ns_ && time_ns < *newest_ns_;
  const TimeNs back_ns = std::max(reorder_ns_, std::min(kCatchUpNs, window_ns_.value_or(0)));
  if (is_behind && (!window_ns_ || *newest_ns_ - time_ns <= back_ns)) return Verdict::kLate;
  if (!IsRunConfirmed(stamp)) return Verdict::kUnconfirmed;
  ConfirmRun(stamp);
  matches_host_clock_ = clock.MatchesHostClock();
  const bool is_restart =
      is_behind || (window_ns_ && newest_ns_ && clock.run_begin_ns - *newest_ns_ > *window_ns_);
  return is_restart ? Verdict::kRestart : Verdict::kTaken;
}

// Updates the clock of a sensor and the elapsed time of the stream.
void StampValidator::UpdateClock(const FrameStamp& stamp) {
  Clock& clock = clocks_[stamp.sensor];
  now_ = stamp.arrival;
  if (now_) now_->unix_ns = std::clamp(now_->unix_ns, -kMaxStampNs, kMaxStampNs);
  if (clock.last_ns) {
    std::rotate(clock.steps_ns.begin(), clock.steps_ns.begin() + 1, clock.steps_ns.end());
    clock.steps_ns.back() = std::max<TimeNs>(stamp.time_ns - *clock.last_ns, 0);
  }
  if (clock.last_ns && stamp.time_ns > *clock.last_ns && ContinuesFrom(clock, stamp.time_ns)) {
    const TimeNs heard_ns = clock.heard_ns + (stamp.time_ns - *clock.last_ns);
    stream_ns_ = std::clamp(heard_ns, stream_ns_, kMaxStampNs);
  }
  if (clock.run > 0 && !ContinuesFrom(clock, stamp.time_ns)) clock.run = 0;
  clock.is_run_confirmed = false;
  clock.last_ns = stamp.time_ns;
  clock.heard_ns = stream_ns_;
  if (now_) clock.heard_steady_ns = now_->steady_ns;
  clock.host_clock_error_ns = now_ ? std::abs(stamp.time_ns - now_->unix_ns) : kMaxStampNs;
}

// True if a clock is in a run that has reached about this time.
bool StampValidator::IsInRunOf(const Clock& clock, TimeNs time_ns) const {
  return clock.run > 0 && std::abs(NowOf(clock) - time_ns) <= kMaxClockDifferenceNs;
}

bool StampValidator::IsActive(const Clock& clock) const {
  if (!clock.last_ns) return false;
  return ElapsedNs(clock) <= silent_ns_ ||
         (now_ && now_->steady_ns - clock.heard_steady_ns <= kBurstNs);
}

bool StampValidator::ContinuesFrom(const Clock& clock, TimeNs time_ns) const {
  return std::abs(time_ns - *clock.last_ns) <=
         std::max(kMaxClockDifferenceNs, 2 * clock.period_ns());
}

// True if most other active clocks have reached a time; for a single sensor, if it is within a
// short pause of the newest stamp.
bool StampValidator::IsReachedByMajority(std::uint32_t sensor, TimeNs time_ns) const {
  std::size_t others = 0;
  std::size_t reached = 0;
  for (std::size_t i = 0; i < clocks_.size(); ++i) {
    const Clock& clock = clocks_[i];
    if (i == sensor || clock.run > 0 || !IsActive(clock)) continue;
    ++others;
    const TimeNs slack_ns = std::max(reorder_ns_, clock.period_ns());
    if (time_ns <= NowOf(clock) + slack_ns) ++reached;
  }
  if (others > 0) return reached >= (others + 1) / 2;
  const TimeNs pause_ns = std::max({silent_ns_, reorder_ns_, 2 * clocks_[sensor].period_ns()});
  return time_ns <= std::max(*newest_ns_, reached_ns_) + pause_ns;
}

bool StampValidator::IsConfirmed(std::uint32_t sensor, TimeNs time_ns) const {
  const Clock& clock = clocks_[sensor];
  if (newest_ns_ && time_ns < *newest_ns_ - reorder_ns_) return false;
  if (clock.is_run_confirmed && clock.HasInRun(time_ns)) return true;
  // A sensor that is farther ahead has another clock, and its earlier stamps are wrong, too.
  return newest_ns_ &&
         IsReachedByMajority(sensor, std::max(time_ns, *clock.last_ns - kMaxClockDifferenceNs));
}

bool StampValidator::IsPending(std::uint32_t sensor, TimeNs time_ns) const {
  const Clock& clock = clocks_[sensor];
  const TimeNs kept_ns =
      std::max(silent_ns_ + 2 * kMaxClockDifferenceNs, 2 * kFramesToConfirm * clock.period_ns());
  return clock.run > 0 && IsActive(clock) && clock.HasInRun(time_ns) &&
         *clock.last_ns - time_ns <= kept_ns;
}

bool StampValidator::IsRunConfirmed(const FrameStamp& stamp) const {
  const Clock& own = clocks_[stamp.sensor];
  int frames = own.run;
  int agreeing = 1;
  int contradicting = 0;
  bool is_stream_heard = false;
  TimeNs others_host_clock_error_ns = kMaxStampNs;  // smallest of the contradicting sensors
  for (std::size_t i = 0; i < clocks_.size(); ++i) {
    const Clock& clock = clocks_[i];
    if (i == stamp.sensor || !IsActive(clock)) continue;
    if (newest_ns_ && clock.run == 0) is_stream_heard = true;
    if (IsInRunOf(clock, stamp.time_ns)) {
      ++agreeing;
      frames += clock.run;
    } else {
      ++contradicting;
      others_host_clock_error_ns = std::min(others_host_clock_error_ns, clock.host_clock_error_ns);
    }
  }
  const bool matches_host_clock = own.MatchesHostClock();
  const bool contradicts_host_clock = newest_ns_ && matches_host_clock_ && !matches_host_clock;
  const TimeNs min_run_ns = contradicts_host_clock              ? silent_ns_
                            : newest_ns_ && matches_host_clock_ ? kBurstNs
                                                                : 0;
  if (frames < kFramesToConfirm || (now_ && now_->steady_ns - own.run_steady_ns < min_run_ns)) {
    return false;
  }
  if (!is_stream_heard) return agreeing >= contradicting;
  if (contradicts_host_clock) return false;
  const bool wins_tie = matches_host_clock &&
                        (!matches_host_clock_ ||
                         own.host_clock_error_ns + kHostClockMarginNs < others_host_clock_error_ns);
  return wins_tie ? agreeing >= contradicting : agreeing > contradicting;
}

// Confirms the runs of all sensors that agree with the stamp.
void StampValidator::ConfirmRun(const FrameStamp& stamp) {
  for (std::size_t i = 0; i < clocks_.size(); ++i) {
    Clock& clock = clocks_[i];
    const bool agrees = IsActive(clock) && IsInRunOf(clock, stamp.time_ns);
    if (i != stamp.sensor && !agrees) continue;
    if (clock.run == 0) clock.run_begin_ns = clock.run_end_ns = stamp.time_ns;
    clock.run = 0;
    clock.is_run_confirmed = true;
  }
}

void StampValidator::Begin() {
  newest_ns_.reset();
  reached_ns_ = -kMaxStampNs;
}

}  // namespace unlidar
