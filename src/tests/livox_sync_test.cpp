#include <gtest/gtest.h>

#include <random>

#include "io/livox_frames.hpp"

namespace unlidar {
namespace {

constexpr TimeNs kBeginNs = 1'706'300'000'000'000'000;
constexpr TimeNs kPacketNs = 480'000;

class Lidar {
 public:
  // Packets of a time; `free_share` of them, drawn, count from power-on.
  void Run(double seconds, double free_share) {
    std::bernoulli_distribution is_free(free_share);
    for (const TimeNs end = now_ns_ + static_cast<TimeNs>(seconds * 1e9); now_ns_ < end;
         now_ns_ += kPacketNs) {
      const auto before = sync.state();
      sync.Take(is_free(draws_) ? LivoxClock::kPowerOn : LivoxClock::kSynchronised, now_ns_);
      changes += before && before != sync.state() ? 1 : 0;
    }
  }

  void SetClock(TimeNs by_ns) { now_ns_ += by_ns; }

  LivoxSync sync;
  int changes = 0;

 private:
  std::mt19937 draws_{7};
  TimeNs now_ns_ = kBeginNs;
};

TEST(LivoxSync, IsKnownFromTheFirstPacketOn) {
  Lidar lidar;
  EXPECT_FALSE(lidar.sync.state());
  lidar.Run(0.0005, 0.0);
  EXPECT_EQ(lidar.sync.state(), SyncState::kSynchronised);
  Lidar never;
  never.Run(100.0, 1.0);
  EXPECT_EQ(never.sync.state(), SyncState::kUnsynchronised);
  EXPECT_EQ(never.changes, 0);
  EXPECT_EQ(never.sync.losses(), 0U);
}

TEST(LivoxSync, IsLostWithinTwoSecondsAndBackAfterTen) {
  for (const TimeNs step_ns : {TimeNs{0}, TimeNs{600'000'000}, -kBeginNs, kBeginNs / 2}) {
    Lidar lidar;
    lidar.Run(3.3, 0.0);
    lidar.SetClock(step_ns);
    lidar.Run(2.1, 1.0);
    EXPECT_EQ(lidar.sync.state(), SyncState::kLost) << step_ns;
    lidar.SetClock(-step_ns);
    lidar.Run(9.0, 0.0);
    EXPECT_EQ(lidar.sync.state(), SyncState::kLost) << step_ns;
    lidar.Run(4.0, 0.0);
    EXPECT_EQ(lidar.sync.state(), SyncState::kSynchronised) << step_ns;
    EXPECT_EQ(lidar.changes, 2) << step_ns;
    EXPECT_EQ(lidar.sync.losses(), 1U) << step_ns;
  }
}

TEST(LivoxSync, OneThatWasNeverThereBegins) {
  Lidar lidar;
  lidar.Run(5.0, 1.0);
  lidar.Run(12.0, 0.0);
  EXPECT_EQ(lidar.sync.state(), SyncState::kSynchronised);
  EXPECT_EQ(lidar.sync.losses(), 0U);
}

TEST(LivoxSync, AMinorityOfPacketsTellsNothing) {
  Lidar lidar;
  lidar.Run(60.0, 0.4);
  EXPECT_EQ(lidar.sync.state(), SyncState::kSynchronised);
  lidar.changes = 0;
  lidar.Run(60.0, 0.4);
  EXPECT_EQ(lidar.changes, 0);
  lidar.Run(5.0, 1.0);
  lidar.Run(60.0, 0.4);
  EXPECT_EQ(lidar.changes, 2);
}

TEST(LivoxSync, OneThatComesAndGoesIsLostOnce) {
  for (const double period_s : {0.001, 0.7, 1.5, 4.0, 8.0}) {
    Lidar lidar;
    lidar.Run(2.0, 0.0);
    lidar.Run(3.0, 1.0);
    for (int k = 0; k < 50; ++k) {
      lidar.Run(period_s, 0.0);
      lidar.Run(period_s + 1.5, 1.0);
    }
    EXPECT_EQ(lidar.sync.state(), SyncState::kLost) << period_s;
    EXPECT_EQ(lidar.sync.losses(), 1U) << period_s;
  }
}

}  // namespace
}  // namespace unlidar
