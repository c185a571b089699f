#include "io/livox_time.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "base/algorithms.hpp"
#include "base/recording.hpp"
#include "io/frame_directory.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kMaxSlewDivisor = 5'000;  // 200 ppm
constexpr int kSecondsToSynchronise = 10;

template <class Packets, class Value>
TimeNs MedianOf(const Packets& packets, const Value& value) {
  std::array<TimeNs, LivoxTime::kLastPackets> values{};
  const auto end = std::transform(packets.begin(), packets.end(), values.begin(), value);
  return NthSmallest(values.begin(), end, (end - values.begin()) / 2);
}

}  // namespace

void PowerOnClock::Follow(TimeNs lag_ns, TimeNs next_frame_ns, TimeNs frame_ns) {
  const TimeNs max_slew_ns = frame_ns / kMaxSlewDivisor;
  before_ns_ = zero_ns_;
  turned_at_ns_ = next_frame_ns - zero_ns_;
  zero_ns_ += std::clamp(lag_ns - zero_ns_, -max_slew_ns, max_slew_ns);
}

bool PowerOnClock::WasHostClockSet(TimeNs stamp_ns, const Arrival& arrival) {
  const TimeNs host_ns = arrival.unix_ns - arrival.steady_ns;
  if (std::abs(host_ns - host_ns_) <= LivoxTime::kMaxStepNs) return false;
  host_ns_ = host_ns;
  // Suspending the computer also changes the difference, but not its Unix time.
  return std::abs(arrival.unix_ns - stamp_ns - zero_ns_) > LivoxTime::kMaxStepNs;
}

std::optional<LivoxTime::Reading> LivoxTime::Take(const LivoxPacket& packet, const Arrival& arrival,
                                                  TimeNs earliest_ns) {
  const Arrival host{std::clamp<TimeNs>(arrival.unix_ns, 0, kMaxStampNs), arrival.steady_ns};
  const bool counts_from_power_on = packet.clock == LivoxClock::kPowerOn;
  const TimeNs stamp_ns = packet.stamp_ns;
  const TimeNs lag_ns = host.unix_ns - stamp_ns;
  const TimeNs zero_ns = std::min(std::max(host.unix_ns, earliest_ns), kMaxStampNs) - stamp_ns;
  if (counts_from_power_on && !power_on_) {
    const bool goes_on = !last_.empty() && IsNear(stamp_ns);  // lost its synchronisation
    power_on_.emplace(goes_on ? 0 : zero_ns, host);
  } else if (counts_from_power_on && power_on_->WasHostClockSet(stamp_ns, host)) {
    power_on_.emplace(lag_ns, host);
    return Restart(host.unix_ns, lag_ns);
  }
  const TimeNs offset_ns = counts_from_power_on ? power_on_->OffsetOf(stamp_ns) : 0;
  if (stamp_ns > kMaxStampNs - offset_ns) return std::nullopt;
  const TimeNs time_ns = stamp_ns + offset_ns;
  if (last_.empty() || IsNear(time_ns)) {
    astray_in_a_row_ = 0;
    Remember({time_ns, lag_ns});
    return Reading{time_ns, false};
  }
  if (!IsRunConfirmed(time_ns)) return std::nullopt;
  if (counts_from_power_on) power_on_.emplace(zero_ns, host);
  return Restart(counts_from_power_on ? stamp_ns + zero_ns : time_ns, lag_ns);
}

bool LivoxTime::IsRunConfirmed(TimeNs time_ns) {
  const bool agrees = last_astray_ns_ && std::abs(time_ns - *last_astray_ns_) <= kMaxStepNs;
  astray_in_a_row_ = agrees ? astray_in_a_row_ + 1 : 1;
  last_astray_ns_ = time_ns;
  return astray_in_a_row_ >= kLastPackets;
}

LivoxTime::Reading LivoxTime::Restart(TimeNs time_ns, TimeNs lag_ns) {
  last_.clear();
  astray_in_a_row_ = 0;
  Remember({time_ns, lag_ns});
  return {time_ns, true};
}

void LivoxTime::Remember(const Taken& taken) {
  last_.push_back(taken);
  if (last_.size() > kLastPackets) last_.pop_front();
  now_ns_ = MedianOf(last_, [](const Taken& one) { return one.time_ns; });
  const std::int64_t frame = now_ns_ / frame_ns_;
  if (std::exchange(followed_, frame) == frame || !power_on_) return;
  const TimeNs lag_ns = MedianOf(last_, [](const Taken& one) { return one.lag_ns; });
  power_on_->Follow(lag_ns, (frame + 1) * frame_ns_, frame_ns_);
}

const char* SyncStateName(SyncState state) {
  constexpr std::array kNames = {"synchronised", "lost", "unsynchronised"};
  return kNames[static_cast<std::size_t>(state)];
}

void LivoxSync::Take(LivoxClock clock, TimeNs time_ns) {
  const bool is_synchronised = clock == LivoxClock::kSynchronised;
  if (!state_) state_ = is_synchronised ? SyncState::kSynchronised : SyncState::kUnsynchronised;
  // A clock that is set begins a second anew, in either direction.
  if (!begin_ns_) begin_ns_ = time_ns;
  if (std::abs(time_ns - *begin_ns_) >= kNsPerSecond) {
    const bool was_synchronised = synchronised_ > free_;
    synchronised_in_a_row_ = was_synchronised ? synchronised_in_a_row_ + 1 : 0;
    if (!was_synchronised && state_ == SyncState::kSynchronised) {
      state_ = SyncState::kLost;
      ++losses_;
    } else if (synchronised_in_a_row_ >= kSecondsToSynchronise) {
      state_ = SyncState::kSynchronised;
    }
    begin_ns_ = time_ns;
    synchronised_ = free_ = 0;
  }
  ++(is_synchronised ? synchronised_ : free_);
}

}  // namespace unlidar
