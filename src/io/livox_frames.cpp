#include "io/livox_frames.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "base/algorithms.hpp"
#include "base/recording.hpp"
#include "io/frame_directory.hpp"
#include "io/input_limits.hpp"

namespace unlidar {
namespace {

// Packets are reordered by less than this plus half of LivoxTime::kLastPackets.
constexpr TimeNs kMaxReorderNs = 5'000'000;

// Memory of a packet besides its points: a map node and two heap blocks.
constexpr std::size_t kPartBytes = 192;

std::int64_t FloorDivide(std::int64_t value, std::int64_t by) {
  return value / by - (value % by < 0 ? 1 : 0);
}

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

void LivoxFrameCutter::Add(const LivoxPacket& packet, const Arrival& arrival) {
  if (packet.rays == 0) return;
  const std::int64_t last =  // of the frames opened or emitted
      open_.empty() ? closed_.value_or(-1) : open_.rbegin()->first;
  const auto reading = time_.Take(packet, arrival, (last + 1) * frame_ns_);
  if (!reading) {
    ++counts_.astray;
    return;
  }
  sync_.Take(packet.clock, reading->time_ns);
  if (reading->is_restart) Restart();
  CloseUntil(time_.now_ns() - kMaxReorderNs);
  const TimeNs time_ns = reading->time_ns;
  const std::int64_t index = FloorDivide(time_ns, frame_ns_);
  const Order order{time_ns, packet.counter ? packet.counter->packet : std::uint16_t{0}};
  const auto frame = open_.find(index);
  if (frame != open_.end() && frame->second.parts.count(order) > 0) {
    ++counts_.repeated;
    return;
  }
  const TimeNs before_ns = std::exchange(last_ns_, time_ns).value_or(time_ns);
  if (packet.counter) {
    CountBy(*packet.counter);
  } else if (time_ns < before_ns) {
    ++counts_.reordered;
  }
  if (closed_ && index <= *closed_) {
    ++counts_.late;
    return;
  }
  OpenFrame& open = open_[index];
  // Packets with no points left also count: each takes memory.
  if (open.points + packet.points.size() > kMaxFramePoints || open.parts.size() >= kMaxFrameParts) {
    ++counts_.excess;
    return;
  }
  open.points += packet.points.size();
  const std::size_t bytes = kPartBytes + packet.points.size() * sizeof(LivoxPoint);
  open.bytes += bytes;
  open.arrival = arrival;
  unfinished_bytes_ += bytes;
  open.parts.emplace(order, packet);
  ++counts_.used;
  counts_.noise_points += packet.noise_points;
}

void LivoxFrameCutter::Restart() {
  Flush();
  closed_.reset();
  last_ns_.reset();
  expected_.reset();
  last_counted_ns_.reset();
}

void LivoxFrameCutter::CountBy(LivoxCounter counter) {
  constexpr std::uint16_t kHalf = 1U << 15U;
  if (expected_ && counter.frame != expected_->frame) {
    const auto frames_on = static_cast<std::uint8_t>(counter.frame - expected_->frame);
    if (frames_on >= 1U << 7U) {  // of an earlier frame of the sensor
      ++counts_.reordered;
      return;
    }
    expected_ = LivoxCounter{0, counter.frame};
  }
  const auto ahead = static_cast<std::uint16_t>(expected_ ? counter.packet - expected_->packet : 0);
  if (ahead >= kHalf) {
    ++counts_.reordered;
    counts_.lost -= std::min<std::uint64_t>(counts_.lost, 1);
    return;
  }
  counts_.lost += ahead;
  expected_ = LivoxCounter{static_cast<std::uint16_t>(counter.packet + 1), counter.frame};
}

void LivoxFrameCutter::DropUnfinished() {
  for (const auto& [index, frame] : open_) {
    counts_.used -= frame.parts.size();
    counts_.excess += frame.parts.size();
  }
  open_.clear();
  unfinished_bytes_ = 0;
}

void LivoxFrameCutter::CloseUntil(TimeNs time_ns) {
  while (!open_.empty() && (open_.begin()->first + 1) * frame_ns_ <= time_ns) {
    const auto frame = open_.extract(open_.begin());
    closed_ = frame.key();
    unfinished_bytes_ -= frame.mapped().bytes;
    Close(frame.key(), frame.mapped());
  }
}

void LivoxFrameCutter::Close(std::int64_t index, const OpenFrame& frame) {
  // Median time between packets, for packets that do not state their span.
  std::vector<TimeNs> spacings_ns;
  for (auto part = frame.parts.begin(); std::next(part) != frame.parts.end(); ++part) {
    spacings_ns.push_back(std::next(part)->first.first - part->first.first);
  }
  TimeNs spacing_ns = 0;
  if (!spacings_ns.empty()) {
    spacing_ns = NthSmallest(spacings_ns.begin(), spacings_ns.end(),
                             static_cast<std::ptrdiff_t>(spacings_ns.size() / 2));
  }
  CountGaps(frame, spacing_ns);

  LivoxFrame over;
  over.stamp_ns = index * frame_ns_;
  over.arrival = frame.arrival;
  over.cloud.points_m.reserve(frame.points);
  over.cloud.integer_times.reserve(frame.points);
  for (const auto& [order, part] : frame.parts) {
    const std::int64_t span_ns = part.span_ns.value_or(spacing_ns * (part.rays - 1) / part.rays);
    for (const LivoxPoint& point : part.points) {
      const std::int64_t within_ns =
          part.rays > 1 ? span_ns * point.ray / (std::int64_t{part.rays} - 1) : 0;
      over.cloud.points_m.push_back(point.position_m);
      over.cloud.integer_times.push_back(order.first - over.stamp_ns + within_ns);
    }
  }
  over_.push_back(std::move(over));
}

// Counts lost packets by gaps in the times, for packets without a counter.
void LivoxFrameCutter::CountGaps(const OpenFrame& frame, TimeNs spacing_ns) {
  for (const auto& [order, part] : frame.parts) {
    if (part.span_ns) continue;
    const TimeNs gap_ns = order.first - last_counted_ns_.value_or(order.first);
    last_counted_ns_ = order.first;
    // After a longer pause the number of lost packets is unknown.
    if (spacing_ns <= 0 || gap_ns > LivoxTime::kMaxStepNs) continue;
    const TimeNs packets = (gap_ns + spacing_ns / 2) / spacing_ns;
    counts_.lost += static_cast<std::uint64_t>(std::max<TimeNs>(packets - 1, 0));
  }
}

std::optional<LivoxFrame> LivoxFrameCutter::Next() {
  if (over_.empty()) return std::nullopt;
  LivoxFrame frame = std::move(over_.front());
  over_.pop_front();
  return frame;
}

}  // namespace unlidar
