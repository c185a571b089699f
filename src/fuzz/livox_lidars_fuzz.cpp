// Packets of several senders, each by a clock of its own, on their way into the engine: bounded
// tables and memory, every frame accounted for, and a LiDAR that keeps this computer's time loses
// none of its frames to strangers who do not.
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

#include "fuzz/fuzz.hpp"
#include "io/frame_directory.hpp"
#include "io/input_limits.hpp"
#include "io/livox_receiver.hpp"
#include "live/live_engine.hpp"
#include "tests/livox_packet_writer.hpp"

namespace unlidar::fuzz {
namespace {

constexpr TimeNs kMsNs = 1'000'000;
constexpr TimeNs kFrameNs = 100 * kMsNs;
constexpr TimeNs kTickNs = 50 * kMsNs;
constexpr TimeNs kHostNs = 1'700'000'000'000'000'000;
constexpr std::uint32_t kOwnAddress = 0xc0a8010a;  // 192.168.1.10

// Of strangers, from this computer's clock: beyond StampValidator::kHostClockToleranceNs, up to the
// ends.
constexpr std::array<TimeNs, 8> kApartNs = {-kHostNs,
                                            -61'000 * kMsNs,
                                            61'000 * kMsNs,
                                            -3'600'000 * kMsNs,
                                            3'600'000 * kMsNs,
                                            kMaxStampNs - kHostNs,
                                            kMaxStampNs - kHostNs - 900 * kMsNs,
                                            -kHostNs + 900 * kMsNs};

class Station {
 public:
  explicit Station(bool has_list)
      : lidars_(has_list ? std::set<std::string>{"192-168-1-10", "192-168-1-20"}
                         : std::set<std::string>(),
                kFrameNs, std::chrono::seconds(2)),
        engine_(
            Config(), {}, FirstSensorStamps{}, [](const EngineEvent&) {}, nullptr,
            TimeReading::kOffset) {}

  // One packet of a sender, a stamp and whether it is its own clock's.
  void Send(std::uint32_t source, TimeNs stamp_ns, std::uint8_t time_type, bool is_noise) {
    Header2 header;
    header.stamp_ns = static_cast<std::uint64_t>(std::clamp<TimeNs>(stamp_ns, 0, kMaxStampNs));
    header.time_type = time_type;
    header.counter = ++counter_;
    std::string point;
    for (const std::int32_t mm : {9000, 4000, 3000}) Put(point, mm);
    Put(point, static_cast<std::uint16_t>(is_noise ? 0x0200 : 0));
    Datagram datagram;
    datagram.source = source;
    datagram.received_ns = host_ns_;
    datagram.arrived = Datagram::Clock::time_point(std::chrono::nanoseconds(host_ns_ - kHostNs));
    datagram.payload = Packet2(header, point);
    LivoxLidar* lidar = nullptr;
    if (!Succeeds([&] { lidar = lidars_.Take(datagram); })) return;
    Require(lidars_.unfinished_bytes() <= kMaxUnfinishedBytes, "unfinished frames are bounded");
    TakeFrames(*lidar, source == kOwnAddress);
  }

  // The LiDAR of the law.
  void Tick() {
    host_ns_ += kTickNs;
    Send(kOwnAddress, host_ns_, 1, false);
  }

  void End(bool keeps_the_law) {
    engine_.Close();
    const std::uint64_t used = engine_.counts().frames + engine_.late_frames() +
                               engine_.astray_frames().count + engine_.overflow_frames().count +
                               bad_frames_;
    Require(used == frames_, "every frame is accounted for");
    Require(!keeps_the_law || own_taken_ == own_frames_,
            "no stranger of another time costs a LiDAR a frame");
  }

  TimeNs host_ns() const { return host_ns_; }

 private:
  void TakeFrames(LivoxLidar& lidar, bool is_own) {
    while (auto frame = lidar.cutter.Next()) {
      if (!lidar.sensor) {
        lidar.sensor = lidars_.FreeSlot();
        if (lidar.sensor) engine_.ReplaceSensor(*lidar.sensor, "other");
      }
      if (!lidar.sensor) lidar.sensor = engine_.AddSensor(lidar.name);
      const std::uint32_t sensor = *lidar.sensor;
      Require(sensor < kMaxSensors, "sensors are bounded");
      ++frames_;
      if (is_own) ++own_frames_;
      const std::uint64_t late = engine_.late_frames();
      const bool is_good = Succeeds([&] {
        engine_.Add({sensor, frame->stamp_ns, "frame", std::move(frame->cloud), frame->arrival});
      });
      if (!is_good) ++bad_frames_;
      const bool is_taken =
          is_good && engine_.late_frames() == late && !engine_.IsOutOfSync(sensor);
      if (is_own && is_taken) ++own_taken_;
    }
  }

  LivoxLidars lidars_;
  LiveEngine engine_;
  TimeNs host_ns_ = kHostNs;
  std::uint16_t counter_ = 0;
  std::uint64_t frames_ = 0;
  std::uint64_t bad_frames_ = 0;
  std::uint64_t own_frames_ = 0;
  std::uint64_t own_taken_ = 0;
};

// Pieces of four bytes: a sender, the time it tells, from packet to packet, how many packets. Then
// so much time passes. Strangers keep to times that are far from this computer's, unless the first
// byte lets them tell any.
void Run(std::string_view bytes) {
  ByteReader reader(bytes);
  const std::uint8_t mode = reader.Byte();
  const bool is_any_time = (mode & 1U) != 0;
  Station station((mode & 2U) != 0);
  for (int k = 0; k < 4; ++k) station.Tick();
  while (!reader.empty()) {
    const std::uint32_t source = kOwnAddress + 1 + reader.Byte();
    const std::uint8_t clock = reader.Byte();
    const TimeNs step_ns = kMsNs * (TimeNs{5} * reader.Byte());
    const int count = 1 + reader.Byte() % 32;
    const TimeNs apart_ns = kApartNs[clock % kApartNs.size()];
    for (int k = 0; k < count; ++k) {
      const TimeNs near_ns = is_any_time ? (clock / 8 - 16) * 100 * kMsNs : apart_ns;
      // Steps never lead back to this computer's time.
      const TimeNs along_ns = apart_ns < 0 && !is_any_time ? -k * step_ns : k * step_ns;
      const auto time_type = static_cast<std::uint8_t>(is_any_time ? clock % 2 : 1);
      station.Send(source, station.host_ns() + near_ns + along_ns, time_type, clock % 16 > 12);
    }
    for (int k = 0; k <= clock / 64; ++k) station.Tick();
  }
  station.End(!is_any_time);
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
