#include "io/livox_frames.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace unlidar {
namespace {

// Packets overtake each other in a network by less.
constexpr TimeNs kPatienceNs = 10'000'000;

// A packet is not believed at once where its time is farther from that of the newest.
constexpr TimeNs kMaxStepNs = 1'000'000'000;

// So many packets in a row that agree are no accident.
constexpr int kBelieved = 8;

// Twice what the densest of these sensors sends in a second.
constexpr std::size_t kMaxFramePoints = std::size_t{1} << 20;

std::int64_t FloorDivide(std::int64_t value, std::int64_t by) {
  return value / by - (value % by < 0 ? 1 : 0);
}

}  // namespace

void LivoxFrameCutter::Add(const LivoxPacket& packet, TimeNs received_ns) {
  if (packet.rays == 0) return;
  const std::optional<TimeNs> time_ns = TimeOf(packet, received_ns);
  if (!time_ns) {
    ++counts_.astray;
    return;
  }
  const std::int64_t index = FloorDivide(*time_ns, frame_ns_);
  const Order order{*time_ns, packet.counter ? packet.counter->packet : std::uint16_t{0}};
  const auto frame = open_.find(index);
  if (frame != open_.end() && frame->second.parts.count(order) > 0) {
    ++counts_.repeated;
    return;
  }
  if (packet.counter) {
    CountBy(*packet.counter);
  } else if (newest_ns_ && *time_ns < *newest_ns_) {
    ++counts_.reordered;
  }
  newest_ns_ = std::max(newest_ns_.value_or(*time_ns), *time_ns);
  if (closed_ && index <= *closed_) {
    ++counts_.late;
    return;
  }
  OpenFrame& open = open_[index];
  if (open.points + packet.points.size() > kMaxFramePoints) {
    ++counts_.excess;
    return;
  }
  open.points += packet.points.size();
  open.parts.emplace(order, Part{packet.rays, packet.span_ns, packet.points});
  ++counts_.used;
  counts_.noise_points += packet.noise_points;
  CloseUntil(*newest_ns_ - kPatienceNs);
}

// The packet's time by the clock of the frames; empty as long as it is not to be believed.
std::optional<TimeNs> LivoxFrameCutter::TimeOf(const LivoxPacket& packet, TimeNs received_ns) {
  const bool counts_from_power_on = packet.clock == LivoxClock::kPowerOn;
  if (counts_from_power_on && !power_on_ns_) {
    const bool goes_on = newest_ns_ && std::abs(packet.stamp_ns - *newest_ns_) <= kMaxStepNs;
    power_on_ns_ = goes_on ? 0 : NotBefore(received_ns) - packet.stamp_ns;
  }
  const TimeNs time_ns = packet.stamp_ns + (counts_from_power_on ? *power_on_ns_ : 0);
  if (!newest_ns_ || std::abs(time_ns - *newest_ns_) <= kMaxStepNs) {
    astray_in_a_row_ = 0;
    return time_ns;
  }
  const bool agrees = last_astray_ns_ && std::abs(time_ns - *last_astray_ns_) < kMaxStepNs;
  astray_in_a_row_ = agrees ? astray_in_a_row_ + 1 : 1;
  last_astray_ns_ = time_ns;
  if (astray_in_a_row_ < kBelieved) return std::nullopt;

  // The clock was set, or the sensor switched off and on again, or it has rested.
  Flush();
  const bool has_gone_back = time_ns < *newest_ns_;
  if (counts_from_power_on && has_gone_back) {
    power_on_ns_ = NotBefore(received_ns) - packet.stamp_ns;
  }
  newest_ns_.reset();
  closed_.reset();
  expected_.reset();
  last_counted_ns_.reset();
  astray_in_a_row_ = 0;
  return packet.stamp_ns + (counts_from_power_on ? *power_on_ns_ : 0);
}

// This computer's time, or that of the next frame where packets are played faster than they came.
TimeNs LivoxFrameCutter::NotBefore(TimeNs received_ns) const {
  return newest_ns_ ? std::max(received_ns, *newest_ns_ + frame_ns_) : received_ns;
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

void LivoxFrameCutter::Flush() {
  if (!open_.empty()) CloseUntil((open_.rbegin()->first + 1) * frame_ns_);
}

void LivoxFrameCutter::CloseUntil(TimeNs time_ns) {
  while (!open_.empty() && (open_.begin()->first + 1) * frame_ns_ <= time_ns) {
    const auto frame = open_.extract(open_.begin());
    closed_ = frame.key();
    Close(frame.key(), frame.mapped());
  }
}

void LivoxFrameCutter::Close(std::int64_t index, const OpenFrame& frame) {
  // The usual time from one packet to the next, for packets that do not say how long they take.
  std::vector<TimeNs> spacings_ns;
  for (auto part = frame.parts.begin(); std::next(part) != frame.parts.end(); ++part) {
    spacings_ns.push_back(std::next(part)->first.first - part->first.first);
  }
  TimeNs spacing_ns = 0;
  if (!spacings_ns.empty()) {
    const auto middle = spacings_ns.begin() + static_cast<std::ptrdiff_t>(spacings_ns.size() / 2);
    std::nth_element(spacings_ns.begin(), middle, spacings_ns.end());
    spacing_ns = *middle;
  }
  CountGaps(frame, spacing_ns);

  LivoxFrame over;
  over.stamp_ns = index * frame_ns_;
  over.cloud.time_kind = PcdTimeKind::kInteger;
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

// Packets without a counter that should lie between those that came.
void LivoxFrameCutter::CountGaps(const OpenFrame& frame, TimeNs spacing_ns) {
  for (const auto& [order, part] : frame.parts) {
    if (part.span_ns) continue;
    const TimeNs gap_ns = order.first - last_counted_ns_.value_or(order.first);
    last_counted_ns_ = order.first;
    // After a longer rest nobody knows what the sensor did.
    if (spacing_ns <= 0 || gap_ns > kMaxStepNs) continue;
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
