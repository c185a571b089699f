#include "io/livox_frames.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace unlidar {
namespace {

constexpr TimeNs kBegin = 1'700'000'000'000'000'000;
constexpr TimeNs kFrame = 100'000'000;
constexpr TimeNs kSpacing = 500'000;
constexpr TimeNs kHost = 1'600'000'000'000'000'000;
constexpr TimeNs kSecond = 1'000'000'000;
constexpr auto kLast = static_cast<int>(LivoxTime::kLastPackets);

// The k-th packet of a sensor: five rays of 100 us each, which tell their number.
LivoxPacket Packet(int k, bool is_first_protocol = false) {
  LivoxPacket packet;
  packet.clock = LivoxClock::kSynchronised;
  packet.stamp_ns = kBegin + k * kSpacing;
  packet.rays = 5;
  if (!is_first_protocol) {
    packet.counter = LivoxCounter{static_cast<std::uint16_t>(k), 0};
    packet.span_ns = 400'000;
  }
  for (std::uint32_t ray = 0; ray < 5; ++ray) {
    packet.points.push_back({Eigen::Vector3f(static_cast<float>(k), 1, 1), ray});
  }
  return packet;
}

std::vector<LivoxPacket> Packets(int count, bool is_first_protocol = false) {
  std::vector<LivoxPacket> packets;
  for (int k = 0; k < count; ++k) packets.push_back(Packet(k, is_first_protocol));
  return packets;
}

struct Cut {
  std::vector<LivoxFrame> frames;
  LivoxCounts counts;
};

Cut CutAll(const std::vector<LivoxPacket>& packets) {
  LivoxFrameCutter cutter(kFrame);
  Cut cut;
  const auto take = [&] {
    while (auto frame = cutter.Next()) cut.frames.push_back(std::move(*frame));
  };
  for (const LivoxPacket& packet : packets) {
    cutter.Add(packet, {kHost, 0});
    take();
  }
  cutter.Flush();
  take();
  cut.counts = cutter.counts();
  return cut;
}

void ExpectSameFrames(const Cut& a, const Cut& b) {
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].stamp_ns, b.frames[i].stamp_ns);
    EXPECT_EQ(a.frames[i].cloud.integer_times, b.frames[i].cloud.integer_times);
    EXPECT_EQ(a.frames[i].cloud.points_m, b.frames[i].cloud.points_m);
  }
}

TEST(LivoxFrames, AreTenthsOfASecondWithATimeForEachPoint) {
  for (const bool is_first_protocol : {false, true}) {
    const Cut cut = CutAll(Packets(500, is_first_protocol));
    ASSERT_EQ(cut.frames.size(), 3U);
    EXPECT_EQ(cut.counts.used, 500U);
    EXPECT_EQ(cut.counts.lost, 0U);
    for (int i = 0; i < 3; ++i) {
      const LivoxFrame& frame = cut.frames[static_cast<std::size_t>(i)];
      EXPECT_EQ(frame.stamp_ns, kBegin + i * kFrame);
      ASSERT_EQ(frame.cloud.points_m.size(), i < 2 ? 1000U : 500U);
      for (std::size_t p = 0; p < frame.cloud.points_m.size(); ++p) {
        EXPECT_EQ(frame.cloud.integer_times[p], static_cast<TimeNs>(p) * 100'000);
      }
    }
  }
}

TEST(LivoxFrames, AreTheSameInWhateverOrderPacketsCome) {
  std::mt19937 random(1);
  for (const bool is_first_protocol : {false, true}) {
    const Cut in_order = CutAll(Packets(1000, is_first_protocol));
    std::vector<LivoxPacket> packets = Packets(1000, is_first_protocol);
    for (std::size_t i = 5; i + 10 < packets.size(); i += 10) {  // by less than 5 ms
      std::shuffle(packets.begin() + static_cast<std::ptrdiff_t>(i),
                   packets.begin() + static_cast<std::ptrdiff_t>(i) + 10, random);
    }
    const Cut shuffled = CutAll(packets);
    ExpectSameFrames(shuffled, in_order);
    EXPECT_EQ(shuffled.counts.used, 1000U);
    EXPECT_EQ(shuffled.counts.lost, 0U);
    EXPECT_GT(shuffled.counts.reordered, 300U);
  }
}

TEST(LivoxFrames, LeaveOutWhatComesTwice) {
  for (const bool is_first_protocol : {false, true}) {
    std::vector<LivoxPacket> packets;
    for (const LivoxPacket& packet : Packets(300, is_first_protocol)) {
      packets.insert(packets.end(), 2, packet);
    }
    const Cut twice = CutAll(packets);
    ExpectSameFrames(twice, CutAll(Packets(300, is_first_protocol)));
    EXPECT_EQ(twice.counts.repeated, 300U);
    EXPECT_EQ(twice.counts.lost, 0U);
  }
}

TEST(LivoxFrames, CountWhatIsLost) {
  for (const bool is_first_protocol : {false, true}) {
    std::vector<LivoxPacket> packets = Packets(1000, is_first_protocol);
    const auto lose = [&](int from, int count) {
      packets.erase(packets.begin() + from, packets.begin() + from + count);
    };
    lose(700, 40);
    lose(199, 3);  // across frames
    lose(17, 1);
    const Cut cut = CutAll(packets);
    EXPECT_EQ(cut.counts.lost, 44U) << is_first_protocol;
    EXPECT_EQ(cut.counts.used, 956U);
    EXPECT_EQ(cut.counts.reordered, 0U);
  }
}

TEST(LivoxFrames, CountAcrossTheEndOfTheCounter) {
  std::vector<LivoxPacket> packets = Packets(400);
  for (LivoxPacket& packet : packets) {
    packet.counter->packet = static_cast<std::uint16_t>(packet.counter->packet + 65'400);
  }
  packets.erase(packets.begin() + 135, packets.begin() + 137);  // 65535 and 0
  EXPECT_EQ(CutAll(packets).counts.lost, 2U);
}

TEST(LivoxFrames, CountFromZeroInEachFrameOfASensorThatCountsFrames) {
  std::vector<LivoxPacket> packets = Packets(600);
  for (std::size_t k = 0; k < packets.size(); ++k) {
    packets[k].counter =
        LivoxCounter{static_cast<std::uint16_t>(k % 200), static_cast<std::uint8_t>(254 + k / 200)};
  }
  EXPECT_EQ(CutAll(packets).counts.lost, 0U);
  std::swap(packets[199], packets[200]);
  EXPECT_EQ(CutAll(packets).counts.lost, 0U);
  packets.erase(packets.begin() + 400, packets.begin() + 403);
  EXPECT_EQ(CutAll(packets).counts.lost, 3U);
}

TEST(LivoxFrames, AreNotTouchedByWhatComesTooLate) {
  std::vector<LivoxPacket> packets = Packets(600);
  packets.insert(packets.begin() + 500, Packet(10));
  const Cut cut = CutAll(packets);
  ExpectSameFrames(cut, CutAll(Packets(600)));
  EXPECT_EQ(cut.counts.late, 1U);
}

TEST(LivoxFrames, AreNotTouchedByAPacketOfAnotherTime) {
  for (const TimeNs step_ns : {-kBegin, -2'000'000'000L, 2'000'000'000L, 1'000'000'000'000'000L}) {
    std::vector<LivoxPacket> packets = Packets(600);
    for (const int at : {500, 300, 100}) {
      LivoxPacket astray = Packet(at);
      astray.stamp_ns += step_ns;
      packets.insert(packets.begin() + at, astray);
    }
    const Cut cut = CutAll(packets);
    ExpectSameFrames(cut, CutAll(Packets(600)));
    EXPECT_EQ(cut.counts.astray, 3U);
  }
}

// Packets that others send in the name of the sensor, among its own.
TEST(LivoxFrames, EndByNoPacketsOfOthersHoweverNearTheirTimeIs) {
  const Cut own = CutAll(Packets(2000));
  for (const TimeNs ahead_ns : {20'000'000L, 150'000'000L, 990'000'000L, -30'000'000L, -kSecond}) {
    for (const int in_a_row : {1, 3, kLast / 2}) {
      std::vector<LivoxPacket> packets = Packets(2000);
      for (int at = 1900; at >= 100; at -= 90) {
        LivoxPacket forged = Packet(at);
        forged.stamp_ns += ahead_ns + 1;
        forged.points.clear();
        packets.insert(packets.begin() + at, static_cast<std::size_t>(in_a_row), forged);
        for (int k = 0; k < in_a_row; ++k) packets[static_cast<std::size_t>(at + k)].stamp_ns += k;
      }
      Cut cut = CutAll(packets);
      // Frames that hold nothing but what is forged are not the sensor's.
      cut.frames.erase(
          std::remove_if(cut.frames.begin(), cut.frames.end(),
                         [](const LivoxFrame& frame) { return frame.cloud.points_m.empty(); }),
          cut.frames.end());
      ExpectSameFrames(cut, own);
    }
  }
}

TEST(LivoxFrames, AreNotKeptOpenByPacketsOfOthers) {
  LivoxFrameCutter cutter(kFrame);
  for (int k = 0; k < 2000; ++k) {
    cutter.Add(Packet(k), {kHost, 0});
    // Of the frame before or of this one.
    if (k > 150 && k % 4 == 3) cutter.Add(Packet(k - 150), {kHost, 0});
    if (k % 200 == 30) {
      EXPECT_EQ(cutter.Next().has_value(), k > 200);
    }
  }
}

// A frame that ends after a pause, or with the stream, is no witness of this computer's time then.
TEST(LivoxFrames, ArriveWithTheirLastPackets) {
  constexpr TimeNs kPause = 3600'000'000'000;
  LivoxFrameCutter cutter(kFrame);
  std::vector<TimeNs> last_ns;  // by frame
  const auto add = [&](const LivoxPacket& packet, TimeNs arrived_ns) {
    last_ns.resize(
        static_cast<std::size_t>(packet.stamp_ns / kFrame - Packet(0).stamp_ns / kFrame) + 1);
    last_ns.back() = arrived_ns;
    cutter.Add(packet, {kHost + arrived_ns, arrived_ns});
  };
  for (int k = 0; k < 500; ++k) add(Packet(k), k);
  add(Packet(500), kPause);
  for (int k = 501; k < 1000; ++k) add(Packet(k), kPause + k);
  cutter.Flush();
  std::size_t i = 0;
  while (const auto frame = cutter.Next()) {
    ASSERT_LT(i, last_ns.size());
    EXPECT_EQ(frame->arrival.steady_ns, last_ns[i]);
    EXPECT_EQ(frame->arrival.unix_ns, kHost + last_ns[i++]);
  }
  EXPECT_EQ(i, last_ns.size());
}

TEST(LivoxFrames, GoOnAfterTheClockWasSet) {
  for (const TimeNs step_ns : {-3600'000'000'000L, 3600'000'000'000L}) {
    std::vector<LivoxPacket> packets = Packets(600);
    for (std::size_t k = 300; k < packets.size(); ++k) packets[k].stamp_ns += step_ns;
    const Cut cut = CutAll(packets);
    EXPECT_EQ(cut.counts.astray, kLast - 1U);
    EXPECT_EQ(cut.counts.used, 601U - kLast);
    ASSERT_EQ(cut.frames.size(), 4U);
    EXPECT_EQ(cut.frames.back().stamp_ns, kBegin + 2 * kFrame + step_ns);
  }
}

TEST(LivoxFrames, HaveThisComputersTimeWhereTheSensorHasNone) {
  std::vector<LivoxPacket> packets = Packets(400);
  for (LivoxPacket& packet : packets) {
    packet.clock = LivoxClock::kPowerOn;
    packet.stamp_ns -= kBegin - 77;
  }
  const Cut cut = CutAll(packets);
  ASSERT_EQ(cut.frames.size(), 2U);
  EXPECT_EQ(cut.frames[0].stamp_ns, kHost);
  EXPECT_EQ(cut.frames[1].stamp_ns, kHost + kFrame);

  // Switched off and on again: it never goes back, even if it is played faster than it was.
  std::vector<LivoxPacket> again = packets;
  again.insert(again.end(), packets.begin(), packets.end());
  for (std::size_t k = 0; k < 400; ++k) again[k].stamp_ns += 10'000'000'000;
  const Cut both = CutAll(again);
  EXPECT_EQ(both.counts.astray, kLast - 1U);
  for (std::size_t i = 1; i < both.frames.size(); ++i) {
    EXPECT_GT(both.frames[i].stamp_ns, both.frames[i - 1].stamp_ns);
  }
}

TEST(LivoxFrames, HoldNoMoreThanTheirShare) {
  LivoxFrameCutter cutter(kFrame);
  LivoxPacket packet = Packet(0);
  packet.points.assign(100'000, packet.points.front());
  for (int k = 0; k < 50; ++k) {
    packet.counter->packet = static_cast<std::uint16_t>(k);
    cutter.Add(packet, {kHost, 0});
  }
  EXPECT_EQ(cutter.counts().used, 10U);
  EXPECT_EQ(cutter.counts().excess, 40U);
}

TEST(LivoxFrames, AreNotMadeOfAccelerations) {
  EXPECT_TRUE(CutAll({LivoxPacket(), LivoxPacket()}).frames.empty());
}

}  // namespace
}  // namespace unlidar
