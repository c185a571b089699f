#include "scene/time_bins.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "tests/synthetic_recording.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodS;
using testing::Random;
using testing::RecordingMaker;

constexpr TimeNs kBinNs = 500'000'000;

// Frames of two sensors, also longer than a bin, out of order and with pauses up to half a minute.
std::vector<FrameInfo> DrawnFrames(Random* random) {
  std::vector<FrameInfo> frames;
  TimeNs time_ns = kBeginNs;
  for (int i = 0; i < 60; ++i) {
    time_ns += static_cast<TimeNs>(1e9 * random->Uniform(-0.1, 0.3));
    if (random->Index(6) == 0) {
      time_ns += static_cast<TimeNs>(1e9 * std::pow(random->Uniform(1.0, 3.1), 3));
    }
    FrameInfo frame;
    frame.sensor = random->Index(2);
    frame.stamp_ns = frame.begin_ns = time_ns;
    frame.end_ns = time_ns + static_cast<TimeNs>(1e9 * random->Uniform(0.0, 1.5));
    frames.push_back(frame);
  }
  return frames;
}

// The same from the definition, half second by half second: a bin each, but for those in which a
// pause has lasted for longer than a dwell may break.
struct BinsByDefinition {
  TimeNs begin_ns;
  std::vector<std::uint32_t> bins;  // of the half seconds until that of the last frame

  explicit BinsByDefinition(const std::vector<FrameInfo>& frames)
      : begin_ns(std::min_element(
                     frames.begin(), frames.end(),
                     [](const FrameInfo& a, const FrameInfo& b) { return a.begin_ns < b.begin_ns; })
                     ->begin_ns) {
    std::set<std::size_t> with_frames;
    for (const FrameInfo& frame : frames) with_frames.insert(HalfSecondOf(frame.middle_ns()));
    std::uint32_t bin = 0;
    int pause = 0;
    for (std::size_t k = 0; k <= *with_frames.rbegin(); ++k) {
      if (k > 0 && ++pause <= 3) ++bin;
      bins.push_back(bin);
      if (with_frames.count(k) > 0) pause = 0;
    }
  }

  std::size_t HalfSecondOf(TimeNs time_ns) const {
    return static_cast<std::size_t>(std::max<TimeNs>(time_ns - begin_ns, 0) / kBinNs);
  }

  std::uint32_t BinOf(TimeNs time_ns) const {
    return bins[std::min(HalfSecondOf(time_ns), bins.size() - 1)];
  }

  // What lies before the begin counts to the first bin.
  std::set<std::uint32_t> BinsTouching(TimeNs from_ns, TimeNs to_ns) const {
    std::set<std::uint32_t> touched;
    for (std::size_t k = HalfSecondOf(from_ns); k <= HalfSecondOf(to_ns) && k < bins.size(); ++k) {
      touched.insert(bins[k]);
    }
    return touched;
  }
};

std::set<std::uint32_t> SetOf(BinRange range) {
  std::set<std::uint32_t> bins;
  for (std::uint32_t bin = range.first; bin < range.last; ++bin) bins.insert(bin);
  return bins;
}

TEST(TimeBins, AreThoseOfTheirDefinition) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const std::vector<FrameInfo> frames = DrawnFrames(&random);
    const TimeBins bins(frames, 2);
    const BinsByDefinition expected(frames);
    EXPECT_EQ(bins.num_bins(), expected.bins.back() + 1);
    const double duration_s = 0.5 * static_cast<double>(expected.bins.size());
    const auto draw_ns = [&] {
      return expected.begin_ns +
             static_cast<TimeNs>(1e9 * random.Uniform(-10.0, duration_s + 10.0));
    };
    for (int trial = 0; trial < 500; ++trial) {
      const TimeNs from_ns = draw_ns();
      EXPECT_EQ(bins.BinOf(from_ns), expected.BinOf(from_ns));
      const TimeNs to_ns = trial % 2 == 0 ? std::max(from_ns, draw_ns()) : from_ns;
      EXPECT_EQ(SetOf(bins.BinsTouching(from_ns, to_ns)), expected.BinsTouching(from_ns, to_ns));
    }
  }
}

TEST(TimeBins, CountEveryFrameInTheBinOfItsMiddle) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const std::vector<FrameInfo> frames = DrawnFrames(&random);
    const TimeBins bins(frames, 2);
    const BinsByDefinition expected(frames);
    for (int trial = 0; trial < 200; ++trial) {
      BinRange range{random.Index(bins.num_bins() + 1), random.Index(bins.num_bins() + 1)};
      if (range.last < range.first) std::swap(range.first, range.last);
      std::uint32_t counts[2] = {0, 0};
      for (const FrameInfo& frame : frames) {
        const std::uint32_t bin = expected.BinOf(frame.middle_ns());
        if (bin >= range.first && bin < range.last) ++counts[frame.sensor];
      }
      EXPECT_EQ(bins.NumFrames(0, range), counts[0]);
      EXPECT_EQ(bins.NumFrames(1, range), counts[1]);
      EXPECT_EQ(bins.NumFramesOutside(range), frames.size() - counts[0] - counts[1]);
    }
  }
}

TEST(TimeBins, AroundABinAreThoseThatAreNearInTime) {
  RecordingMaker maker(1);
  for (int i = 0; i < 100; ++i) maker.BeginFrame(i * kPeriodS);
  const TimeBins bins(maker.recording.frames, 1);
  const std::uint32_t n = bins.num_bins();
  ASSERT_EQ(n, 20U);
  for (std::uint32_t bin = 0; bin < n; ++bin) {
    const BinRange around = bins.BinsAround(bin, 2);
    EXPECT_EQ(around.first, bin < 2 ? 0 : bin - 2);
    EXPECT_EQ(around.last, std::min(bin + 3, n));
  }
}

TEST(TimeBins, PausesOfYearsTakeFewBins) {
  for (const double pause_s : {5.0, 3600.0, 1e9}) {
    RecordingMaker maker(7);
    for (int i = 0; i < 9; ++i) maker.BeginFrame((i - 4) * pause_s);
    const TimeBins bins(maker.recording.frames, 1);
    EXPECT_EQ(bins.num_bins(), 8 * kMaxPauseBins + 1) << pause_s;
    for (std::uint32_t i = 0; i < 9; ++i) {
      const FrameInfo& frame = maker.recording.frames[i];
      EXPECT_EQ(bins.BinOf(frame.middle_ns()), i * kMaxPauseBins) << pause_s;
      // The bins around it hold no other frame.
      EXPECT_EQ(bins.NumFrames(0, bins.BinsAround(bins.BinOf(frame.middle_ns()), 2)), 1U);
    }
  }
}

TEST(TimeBins, OfNothingAreNone) {
  const TimeBins bins({}, 1);
  EXPECT_EQ(bins.num_bins(), 0U);
  EXPECT_EQ(bins.BinOf(kBeginNs), 0U);
  EXPECT_EQ(SetOf(bins.BinsTouching(0, kBeginNs)).size(), 0U);
  EXPECT_EQ(bins.NumFramesOutside({0, 0}), 0U);
}

}  // namespace
}  // namespace unlidar
