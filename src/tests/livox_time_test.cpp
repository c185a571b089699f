#include <gtest/gtest.h>

#include <cstdlib>
#include <random>

#include "io/frame_directory.hpp"
#include "io/livox_frames.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kFrame = 100'000'000;
constexpr TimeNs kSpacing = 500'000;
constexpr TimeNs kSecond = 1'000'000'000;
constexpr TimeNs kHost = 1'700'000'000'000'000'000;
constexpr auto kLast = static_cast<int>(LivoxTime::kLastPackets);

LivoxPacket PacketOf(TimeNs stamp_ns, LivoxClock clock = LivoxClock::kPowerOn) {
  LivoxPacket packet;
  packet.clock = clock;
  packet.stamp_ns = stamp_ns;
  packet.rays = 1;
  return packet;
}

// A sensor that is not synchronised, at a computer whose clock may be set.
class Sensor {
 public:
  explicit Sensor(double fast_ppm = 0.0) : fast_ppm_(fast_ppm) {}

  // Its next packets, one every kSpacing by its own clock. Returns the time of the last.
  TimeNs Run(TimeNs duration_ns, TimeNs late_ns = 0) {
    for (TimeNs passed_ns = 0; passed_ns < duration_ns; passed_ns += kSpacing) {
      stamp_ns += kSpacing;
      steady_ns += kSpacing - static_cast<TimeNs>(fast_ppm_ * 1e-6 * kSpacing);
      const auto reading =
          time.Take(PacketOf(stamp_ns), {unix_ns() + late_ns, steady_ns + late_ns}, 0);
      if (!reading) continue;
      if (reading->is_restart) {
        ++times_anew;
      } else {
        EXPECT_GT(reading->time_ns, last_ns);
        const TimeNs step_ns = last_ns == 0 ? kSpacing : reading->time_ns - last_ns;
        EXPECT_LE(std::abs(step_ns - kSpacing), 30'000);
      }
      last_ns = reading->time_ns;
    }
    return last_ns;
  }

  TimeNs unix_ns() const { return steady_ns + set_ns; }
  TimeNs ahead_ns() const { return last_ns - unix_ns(); }

  LivoxTime time{kFrame};
  TimeNs stamp_ns = 77;
  TimeNs steady_ns = 5'000 * kSecond;
  TimeNs set_ns = kHost;
  TimeNs last_ns = 0;
  int times_anew = 0;

 private:
  double fast_ppm_;
};

TEST(LivoxTime, ClocksThatCountFromPowerOnStayWithThisComputersHoweverLongTheyRun) {
  for (const double fast_ppm : {-150.0, -12.0, 12.0, 150.0}) {
    Sensor sensor(fast_ppm);
    for (int minute = 0; minute < 20; ++minute) {
      sensor.Run(60 * kSecond);
      EXPECT_LT(std::abs(sensor.ahead_ns()), 1'000'000) << fast_ppm << " minute " << minute;
    }
    EXPECT_EQ(sensor.times_anew, 0);
  }
}

TEST(LivoxTime, ThatPacketsComeLateOrFasterThanTheyWereTurnsNoClock) {
  Sensor sensor;
  sensor.Run(10 * kSecond);
  sensor.Run(kSecond, 3 * kSecond);  // the program or the network stood still
  EXPECT_LT(std::abs(sensor.ahead_ns()), 1'000'000);
  Sensor played(800'000.0);  // five times as fast as it was
  played.Run(10 * kSecond);
  EXPECT_EQ(played.times_anew + sensor.times_anew, 0);
}

TEST(LivoxTime, ClocksThatCountFromPowerOnFollowThisComputersWhereThatIsSet) {
  for (const TimeNs by_ns :
       {-7'000'000 * kSecond, -3 * kSecond, 3 * kSecond, 7'000'000 * kSecond}) {
    Sensor first;
    first.Run(5 * kSecond);
    first.set_ns += by_ns;
    first.Run(kSecond);
    EXPECT_EQ(first.times_anew, 1);
    EXPECT_LT(std::abs(first.ahead_ns()), 1'000'000);
  }
}

TEST(LivoxTime, AComputerThatSleptIsNotOneWhoseClockWasSet) {
  Sensor sensor;
  sensor.Run(kSecond);
  sensor.set_ns += 300 * kSecond;    // which the steady clock does not count,
  sensor.stamp_ns += 300 * kSecond;  // but the sensor does
  sensor.Run(kSecond);
  EXPECT_EQ(sensor.times_anew, 1);  // after a rest
  EXPECT_LT(std::abs(sensor.ahead_ns()), 1'000'000);
}

TEST(LivoxTime, AForgedFirstPacketHoldsAClockThatCountsFromPowerOnForNoLongerThanItIsBelieved) {
  Sensor sensor;
  sensor.time.Take(PacketOf(3'600 * kSecond), {sensor.unix_ns(), sensor.steady_ns}, 0);
  sensor.last_ns = 0;
  sensor.Run(kSecond);
  EXPECT_LT(std::abs(sensor.ahead_ns()), 1'000'000);
}

TEST(LivoxTime, IsMovedByNoMinorityOfForgedPackets) {
  LivoxTime time(kFrame);
  std::mt19937 random(1);
  TimeNs stamp_ns = kHost;
  const auto take = [&](TimeNs at_ns) {
    return time.Take(PacketOf(at_ns, LivoxClock::kSynchronised), {kHost, 0}, 0);
  };
  for (int k = 0; k < 20'000; ++k) {
    ASSERT_TRUE(take(stamp_ns += kSpacing).has_value());
    ASSERT_LE(std::abs(time.now_ns() - stamp_ns), kLast * kSpacing);
    if (k % 2 == 1)
      take(time.now_ns() + static_cast<TimeNs>(random() % 2'000) * 1'000'000 - kSecond);
  }
}

TEST(LivoxTime, StampsAtTheEndsOfAllTimeAreCompared) {
  LivoxTime time(kFrame);
  for (int k = 0; k < 600; ++k) {
    const auto clock = k % 7 < 3 ? LivoxClock::kSynchronised : LivoxClock::kPowerOn;
    const TimeNs unix_ns = k % 11 < 5 ? kHost : k % 2 == 0 ? 0 : 2 * kMaxStampNs;
    for (int i = 0; i <= k % 30; ++i) {
      const auto reading = time.Take(PacketOf(k % 5 < 2 ? 0 : kMaxStampNs, clock), {unix_ns, k}, 0);
      EXPECT_LE(std::abs(reading.value_or(LivoxTime::Reading()).time_ns), kMaxStampNs);
    }
  }
}

}  // namespace
}  // namespace unlidar
