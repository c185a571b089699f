#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "live/waiting_frames.hpp"

namespace unlidar {
namespace {

CloudFrame FrameOf(std::uint32_t sensor, const std::string& name, std::size_t points = 10) {
  CloudFrame frame;
  frame.sensor = sensor;
  frame.name = name;
  frame.cloud.points_m.resize(points);
  return frame;
}

bool Always(std::uint32_t /*sensor*/, TimeNs /*time_ns*/) { return true; }
bool Never(std::uint32_t /*sensor*/, TimeNs /*time_ns*/) { return false; }

TEST(HeldFrames, AreTakenInTheOrderOfTheirStampsWithTheirNames) {
  HeldFrames held;
  for (const TimeNs time_ns : {30, 10, 20}) {
    const std::string name = "a frame with a name that is rather long, " + std::to_string(time_ns);
    held.Add(FrameOf(0, name), time_ns);
  }
  EXPECT_TRUE(held.Has(0, 20));
  EXPECT_FALSE(held.Has(1, 20));
  HeldFrames::Held taken;
  std::vector<TimeNs> times_ns;
  while (held.TakeEarliest(Always, &taken)) {
    times_ns.push_back(taken.time_ns);
    EXPECT_EQ(taken.frame.name.substr(taken.frame.name.size() - 2), std::to_string(taken.time_ns));
  }
  EXPECT_EQ(times_ns, (std::vector<TimeNs>{10, 20, 30}));
  EXPECT_TRUE(held.empty());
}

TEST(HeldFrames, WhereThereAreTooManyTheSensorWithTheMostLosesItsOldest) {
  for (const std::size_t points : {std::size_t{0}, HeldFrames::kMaxPoints / 4}) {
    HeldFrames held;
    HeldFrames::Held taken;
    held.Add(FrameOf(1, "few"), 0);
    TimeNs lost = 0;
    for (TimeNs k = 0; k < 1000; ++k) {
      held.Add(FrameOf(0, "many", points), k);
      while (held.TakeOverflow(Never, &taken)) {
        EXPECT_EQ(taken.frame.sensor, 0U);
        EXPECT_EQ(taken.time_ns, lost++);
      }
    }
    EXPECT_GT(lost, 700);
    EXPECT_TRUE(held.Has(1, 0));
  }
}

}  // namespace
}  // namespace unlidar
