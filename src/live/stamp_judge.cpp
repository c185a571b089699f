#include "live/stamp_judge.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace unlidar {
namespace {

// Clocks farther from each other are apart: late frames are no matter of the network then.
constexpr TimeNs kApartNs = 1'000'000'000;

// A clock that has gone back by less catches up sooner than the scene is learned anew.
constexpr TimeNs kCatchUpNs = 5'000'000'000;

// Frames that come at once, by this computer's clock, bear out nothing: a burst of packets.
constexpr TimeNs kBurstNs = 200'000'000;

// By so much nearer to this computer's clock: two clocks on both sides of it do not take turns.
constexpr TimeNs kNearerNs = 500'000'000;

}  // namespace

StampJudge::StampJudge(const LiveConfig& config)
    : reorder_ns_(NsOf(config.reorder_s)), silent_ns_(NsOf(config.silent_s)) {
  if (std::isfinite(config.window_s)) window_ns_ = NsOf(config.window_s);
}

StampJudge::Verdict StampJudge::Judge(const FrameStamp& stamp) {
  Hear(stamp);
  Clock& clock = clocks_[stamp.sensor];
  const TimeNs time_ns = stamp.time_ns;
  if (newest_ns_ ? IsReached(stamp.sensor, time_ns) : !stamp.arrival || IsByHost(stamp)) {
    const bool is_late = newest_ns_ && time_ns < *newest_ns_ - reorder_ns_;
    if (!is_late || time_ns >= *newest_ns_ - std::max(kApartNs, reorder_ns_)) {
      clock.run = 0;
      if (is_late) return Verdict::kLate;
      if (!newest_ns_) BelieveRun(stamp);
      is_by_host_ = IsByHost(stamp);
      reached_ns_ = newest_ns_ ? std::max(reached_ns_, time_ns) : time_ns;
      return Verdict::kTaken;
    }
  }
  SetApart(stamp, &clock);
  const bool is_behind = newest_ns_ && time_ns < *newest_ns_;
  const TimeNs back_ns = std::max(reorder_ns_, std::min(kCatchUpNs, window_ns_.value_or(0)));
  if (is_behind && (!window_ns_ || *newest_ns_ - time_ns <= back_ns)) return Verdict::kLate;
  if (!IsRunBelieved(stamp)) return Verdict::kAside;
  BelieveRun(stamp);
  is_by_host_ = IsByHost(stamp);
  const bool is_anew =
      is_behind || (window_ns_ && newest_ns_ && clock.run_begin_ns - *newest_ns_ > *window_ns_);
  return is_anew ? Verdict::kAnew : Verdict::kTaken;
}

// Takes in that a sensor talks, and how much time its stamps say has passed.
void StampJudge::Hear(const FrameStamp& stamp) {
  Clock& clock = clocks_[stamp.sensor];
  now_ = stamp.arrival;
  if (now_) now_->unix_ns = std::clamp(now_->unix_ns, -kMaxStampNs, kMaxStampNs);
  if (clock.last_ns) {
    std::rotate(clock.steps_ns.begin(), clock.steps_ns.begin() + 1, clock.steps_ns.end());
    clock.steps_ns.back() = std::max<TimeNs>(stamp.time_ns - *clock.last_ns, 0);
  }
  if (clock.last_ns && stamp.time_ns > *clock.last_ns && GoesOnWith(clock, stamp.time_ns)) {
    const TimeNs heard_ns = clock.heard_ns + (stamp.time_ns - *clock.last_ns);
    stream_ns_ = std::clamp(heard_ns, stream_ns_, kMaxStampNs);
  }
  if (clock.run > 0 && !GoesOnWith(clock, stamp.time_ns)) clock.run = 0;
  clock.is_run_believed = false;
  clock.last_ns = stamp.time_ns;
  clock.heard_ns = stream_ns_;
  if (now_) clock.heard_steady_ns = now_->steady_ns;
  clock.off_host_ns = now_ ? std::abs(stamp.time_ns - now_->unix_ns) : kMaxStampNs;
}

void StampJudge::SetApart(const FrameStamp& stamp, Clock* clock) const {
  if (clock->run++ == 0) {
    clock->run_begin_ns = clock->run_end_ns = stamp.time_ns;
    if (now_) clock->run_steady_ns = now_->steady_ns;
  }
  clock->run_begin_ns = std::min(clock->run_begin_ns, stamp.time_ns);
  clock->run_end_ns = std::max(clock->run_end_ns, stamp.time_ns);
}

bool StampJudge::IsByHost(const FrameStamp& stamp) const {
  return now_ && std::abs(stamp.time_ns - now_->unix_ns) <= kHostClockNs;
}

TimeNs StampJudge::ElapsedNs(const Clock& clock) const {
  return is_by_host_ && now_ ? now_->steady_ns - clock.heard_steady_ns
                             : stream_ns_ - clock.heard_ns;
}

// A sum of stamps and times that have passed must be a time as well: differences of two are then.
TimeNs StampJudge::NowOf(const Clock& clock) const {
  return std::min(*clock.last_ns + ElapsedNs(clock), kMaxStampNs);
}

bool StampJudge::IsHeard(const Clock& clock) const {
  if (!clock.last_ns) return false;
  return ElapsedNs(clock) <= silent_ns_ ||
         (now_ && now_->steady_ns - clock.heard_steady_ns <= kBurstNs);
}

bool StampJudge::GoesOnWith(const Clock& clock, TimeNs time_ns) const {
  return std::abs(time_ns - *clock.last_ns) <= std::max(kApartNs, 2 * clock.period_ns());
}

// Whether the clocks of most have come so far.
bool StampJudge::IsReached(std::uint32_t sensor, TimeNs time_ns) const {
  std::size_t others = 0;
  std::size_t reached = 0;
  for (std::size_t i = 0; i < clocks_.size(); ++i) {
    const Clock& clock = clocks_[i];
    if (i == sensor || clock.run > 0 || !IsHeard(clock)) continue;
    ++others;
    const TimeNs slack_ns = std::max(reorder_ns_, clock.period_ns());
    if (time_ns <= NowOf(clock) + slack_ns) ++reached;
  }
  if (others > 0) return reached >= (others + 1) / 2;
  const TimeNs pause_ns = std::max({silent_ns_, reorder_ns_, 2 * clocks_[sensor].period_ns()});
  return time_ns <= std::max(*newest_ns_, reached_ns_) + pause_ns;
}

bool StampJudge::IsBorneOut(std::uint32_t sensor, TimeNs time_ns) const {
  const Clock& clock = clocks_[sensor];
  if (newest_ns_ && time_ns < *newest_ns_ - reorder_ns_) return false;
  if (clock.is_run_believed && clock.run_begin_ns <= time_ns && time_ns <= clock.run_end_ns) {
    return true;
  }
  // A clock that is farther ahead is another one: its frames are not those of their stamps.
  return newest_ns_ && IsReached(sensor, std::max(time_ns, *clock.last_ns - kApartNs));
}

bool StampJudge::IsPending(std::uint32_t sensor, TimeNs time_ns) const {
  const Clock& clock = clocks_[sensor];
  const TimeNs kept_ns = std::max(silent_ns_ + 2 * kApartNs, 2 * kBelieved * clock.period_ns());
  return clock.run > 0 && IsHeard(clock) && clock.run_begin_ns <= time_ns &&
         time_ns <= clock.run_end_ns && *clock.last_ns - time_ns <= kept_ns;
}

bool StampJudge::IsRunBelieved(const FrameStamp& stamp) const {
  const Clock& own = clocks_[stamp.sensor];
  int frames = own.run;
  int agreeing = 1;
  int contradicting = 0;
  bool is_stream_heard = false;
  TimeNs others_off_host_ns = kMaxStampNs;  // of those that contradict, the nearest
  for (std::size_t i = 0; i < clocks_.size(); ++i) {
    const Clock& clock = clocks_[i];
    if (i == stamp.sensor || !IsHeard(clock)) continue;
    if (newest_ns_ && clock.run == 0) is_stream_heard = true;
    if (clock.run > 0 && std::abs(NowOf(clock) - stamp.time_ns) <= kApartNs) {
      ++agreeing;
      frames += clock.run;
    } else {
      ++contradicting;
      others_off_host_ns = std::min(others_off_host_ns, clock.off_host_ns);
    }
  }
  const bool is_by_host = IsByHost(stamp);
  const bool is_against_host = newest_ns_ && is_by_host_ && !is_by_host;
  const TimeNs patience_ns = is_against_host             ? silent_ns_
                             : newest_ns_ && is_by_host_ ? kBurstNs
                                                         : 0;
  if (frames < kBelieved || (now_ && now_->steady_ns - own.run_steady_ns < patience_ns)) {
    return false;
  }
  if (!is_stream_heard) return agreeing >= contradicting;
  if (is_against_host) return false;
  const bool wins_tie =
      is_by_host && (!is_by_host_ || own.off_host_ns + kNearerNs < others_off_host_ns);
  return wins_tie ? agreeing >= contradicting : agreeing > contradicting;
}

// All that agree with it are of one clock from now on.
void StampJudge::BelieveRun(const FrameStamp& stamp) {
  for (std::size_t i = 0; i < clocks_.size(); ++i) {
    Clock& clock = clocks_[i];
    const bool is_own = i == stamp.sensor;
    if (!is_own &&
        (clock.run == 0 || !IsHeard(clock) || std::abs(NowOf(clock) - stamp.time_ns) > kApartNs)) {
      continue;
    }
    if (clock.run == 0) clock.run_begin_ns = clock.run_end_ns = stamp.time_ns;
    clock.run = 0;
    clock.is_run_believed = true;
  }
}

void StampJudge::Begin() {
  newest_ns_.reset();
  reached_ns_ = -kMaxStampNs;
}

void StampJudge::Take(TimeNs time_ns) {
  newest_ns_ = std::max(newest_ns_.value_or(time_ns), time_ns);
}

}  // namespace unlidar
