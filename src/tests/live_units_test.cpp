// Sensors of a stream whose coordinates are not metres.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "live/live_engine.hpp"
#include "tests/synthetic_recording.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using testing::kBeginNs;
using testing::kPeriodNs;
using testing::Random;

// A stream of two LiDARs, in units of so many metres; nothing is heard of one of 0.
class Stream {
 public:
  explicit Stream(bool are_metres = false)
      : engine_(
            Config(), {"mast", "roof"}, FirstSensorStamps{}, [](const EngineEvent&) {}, nullptr,
            std::nullopt, are_metres) {}

  void Add(double mast_m, double roof_m, int returns = 100, int frames = 40) {
    for (int k = 0; k < frames; ++k, ++frame_) {
      if (mast_m > 0.0) AddFrame(0, mast_m, returns);
      if (roof_m > 0.0) AddFrame(1, roof_m, returns);
    }
  }

  // The codes of what was in doubt.
  std::vector<std::string> Codes() {
    engine_.Close();
    return CodesSoFar();
  }

  std::vector<std::string> CodesSoFar() const {
    std::vector<std::string> codes;
    for (const Warning& warning : engine_.warnings()) codes.push_back(warning.code);
    return codes;
  }

 private:
  void AddFrame(std::uint32_t sensor, double unit_m, int returns) {
    CloudFrame frame;
    frame.sensor = sensor;
    frame.stamp_ns = kBeginNs + frame_ * kPeriodNs;
    frame.name = "frame";
    for (int i = 0; i < returns; ++i) {
      const Eigen::Vector3d point_m = random_.InBox({-30, -30, -2}, {30, 30, 4});
      frame.cloud.points_m.emplace_back((point_m / unit_m).cast<float>());
    }
    engine_.Add(std::move(frame));
  }

  Random random_{1};
  LiveEngine engine_;
  TimeNs frame_ = 0;
};

using Codes = std::vector<std::string>;

TEST(LiveUnits, MillimetresOfAllThatAreHeardEndTheRun) {
  EXPECT_THROW(Stream().Add(0.001, 0.0), UnitError);
  EXPECT_THROW(Stream().Add(0.001, 0.001), UnitError);
}

TEST(LiveUnits, MillimetresOfOneAreItsOwnAffairAlsoOnceItIsHeardAlone) {
  Stream stream;
  stream.Add(0.001, 1.0);
  stream.Add(0.001, 0.0);
  stream.Add(0.001, 0.0, 100, 1);
  EXPECT_EQ(stream.Codes(), Codes{"not_metres"});
}

TEST(LiveUnits, AFewFarReturnsOfAnEmptySkyAreADoubtAndNoError) {
  Stream stream;
  stream.Add(0.001, 0.0, 10);
  EXPECT_EQ(stream.Codes(), Codes{"not_metres"});
}

TEST(LiveUnits, CentimetresOfASmallPlaceAndKilometresAreADoubtWithinSeconds) {
  for (const auto& [unit_m, code] : {std::pair{0.1, "not_metres"}, {50.0, "returns_too_near"}}) {
    Stream stream;
    stream.Add(unit_m, 1.0, 300);
    EXPECT_EQ(stream.CodesSoFar(), Codes{code});
    EXPECT_EQ(stream.Codes(), Codes{code});
  }
}

TEST(LiveUnits, ASourceThatStatesItsUnitIsBelieved) {
  Stream stream(true);
  stream.Add(0.001, 0.001);
  EXPECT_EQ(stream.Codes(), Codes());
}

}  // namespace
}  // namespace unlidar
