#include "collection/spots.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "tests/learned_occupancy.hpp"
#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kPeriodS;
using testing::RecordingMaker;

constexpr int kFrames = 300;
constexpr int kCandidate = 1;

// At the last candidate, which one sensor at the origin sees; the target is near in [from_s, to_s].
double RateAtLast(const RecordingMaker& maker, double surroundings_rate, double from_s = -2.0,
                  double to_s = -1.0) {
  const testing::LearnedOccupancy learned(maker.recording);
  const std::vector<StationModel> station_models(1, learned.ModelAt());
  std::vector<std::uint32_t> candidates;
  for (std::uint32_t i = 0; i < maker.labels.size(); ++i) {
    if (maker.labels[i] == kCandidate) candidates.push_back(i);
  }
  const auto at_ns = [](double time_s) {
    return testing::kBeginNs + static_cast<TimeNs>(std::llround(time_s * 1e9));
  };
  return Spots(maker.recording, station_models, candidates)
      .RateOutside(0, maker.recording.points_m[candidates.back()], at_ns(from_s), at_ns(to_s),
                   surroundings_rate);
}

TEST(Spots, AThinSurfaceHasTheRateOfItsOwnRoom) {
  for (const double height_m : {2.0, 2.5}) {
    RecordingMaker maker(1);
    for (int i = 0; i < kFrames; ++i) {
      maker.BeginFrame(i * kPeriodS);
      maker.AddBox({11.0, -1.0, 2.0}, {13.0, 1.0, 2.0}, 20);  // 5 a square metre
    }
    maker.Add({12.0, 0.0, height_m}, kCandidate);
    const double rate = RateAtLast(maker, 5.0);
    // At 12 m the neighbourhood is a block of three voxels of 2/3 of some 0.1 m.
    if (height_m == 2.0) {
      EXPECT_GT(rate, 5.0 / 0.3);
      EXPECT_LT(rate, 5.0 / 0.15);
    } else {
      EXPECT_LT(rate, 1.0);
    }
  }
}

TEST(Spots, NeitherCandidatesCountNorWhatIsSeenWhileTheTargetMayBeThere) {
  const auto rate = [](int label, double from_s, double to_s) {
    RecordingMaker maker(2);
    for (int i = 0; i < kFrames; ++i) {
      maker.BeginFrame(i * kPeriodS);
      if (i >= 100 && i < 150) maker.AddBlob({12.0, 0.0, 5.0}, 0.02, 3, label);
    }
    maker.Add({12.0, 0.0, 5.0}, kCandidate);
    return RateAtLast(maker, 0.5, from_s, to_s);
  };
  EXPECT_GT(rate(0, -2.0, -1.0), 30.0);
  EXPECT_LT(rate(0, 10.0, 15.0), 0.6);
  EXPECT_LT(rate(kCandidate, -2.0, -1.0), 0.6);
}

}  // namespace
}  // namespace unlidar
