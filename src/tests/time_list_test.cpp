#include "base/time_list.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "tests/synthetic_recording.hpp"
#include "tests/times_of.hpp"

namespace unlidar {
namespace {

using testing::Random;
using testing::TimesOf;

constexpr TimeNs kExtremeNs = 3'900'000'000'000'000'000;

// The next of some times: equal, near, seconds apart, or anywhere, also before 1970.
TimeNs DrawnAfter(TimeNs time_ns, Random* random) {
  switch (random->Index(8)) {
    case 0:
      return kExtremeNs;
    case 1:
      return -kExtremeNs;
    case 2:
      return static_cast<TimeNs>(random->Uniform(-1e18, 1e18));
    case 3:
      return 0;
    case 4:
      return time_ns;
    case 5:
      return time_ns + static_cast<TimeNs>(random->Uniform(-5e9, 5e9));
    default:
      return time_ns + static_cast<TimeNs>(random->Uniform(-1e8, 1e8));
  }
}

TEST(TimeList, IsTheListOfItsTimes) {
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    Random random(seed);
    TimeList list;
    std::vector<TimeNs> expected;
    TimeNs time_ns = testing::kBeginNs;
    for (int step = 0; step < 300; ++step) {
      if (random.Index(40) == 0) {
        const std::size_t count = random.Index(expected.size() + 1);
        list.DropFirst(count);
        expected.erase(expected.begin(), expected.begin() + static_cast<std::ptrdiff_t>(count));
      }
      if (random.Index(200) == 0) {
        list.clear();
        expected.clear();
      }
      time_ns = DrawnAfter(time_ns, &random);
      list.push_back(time_ns);
      expected.push_back(time_ns);
      ASSERT_EQ(TimesOf(list), expected) << seed << ' ' << step;
    }
  }
}

// The largest differences that one run holds, and the next.
TEST(TimeList, IsExactWhereARunEnds) {
  for (const TimeNs base_ns : {TimeNs{0}, kExtremeNs, -kExtremeNs, testing::kBeginNs}) {
    for (const TimeNs step_ns :
         {TimeNs{2'147'483'647}, TimeNs{2'147'483'648}, TimeNs{2'147'483'649}}) {
      const std::vector<TimeNs> expected = {base_ns, base_ns + step_ns, base_ns - step_ns, base_ns};
      TimeList list;
      for (const TimeNs time_ns : expected) list.push_back(time_ns);
      EXPECT_EQ(TimesOf(list), expected) << base_ns << ' ' << step_ns;
    }
  }
}

}  // namespace
}  // namespace unlidar
