// Packets of a Livox sensor, any bytes for each: points that are finite and within their packet, or
// a reason; frames that hold what was used, in order.
#include <cmath>
#include <cstdlib>
#include <string>
#include <string_view>

#include "fuzz/fuzz.hpp"
#include "io/livox_frames.hpp"
#include "io/livox_packets.hpp"

namespace unlidar::fuzz {
namespace {

constexpr TimeNs kFrameNs = 100'000'000;
constexpr TimeNs kHostNs = 1'700'000'000'000'000'000;

void CheckPacket(const LivoxPacket& packet) {
  Require(packet.points.size() + packet.noise_points <= std::size_t{3} * packet.rays,
          "a ray has at most three returns");
  std::uint32_t last_ray = 0;
  for (const LivoxPoint& point : packet.points) {
    Require(point.position_m.allFinite(), "a point is somewhere");
    Require(last_ray <= point.ray && point.ray < packet.rays, "points are in order of their rays");
    last_ray = point.ray;
  }
}

std::size_t CheckFrames(LivoxFrameCutter& cutter) {
  std::size_t points = 0;
  while (const auto frame = cutter.Next()) {
    Require(frame->stamp_ns % kFrameNs == 0, "frames begin at multiples of their duration");
    Require(frame->cloud.points_m.size() == frame->cloud.integer_times.size(),
            "each point has a time");
    for (const std::int64_t time_ns : frame->cloud.integer_times) {
      Require(0 <= time_ns && time_ns < kFrameNs + 1'000'000'000, "times are those of the frame");
    }
    points += frame->cloud.points_m.size();
  }
  return points;
}

// Pieces: two bytes of length, then so many of a packet. Where the checksum does not fit it is
// taken as not given, or nothing would get behind it.
void Run(std::string_view bytes) {
  ByteReader reader(bytes);
  LivoxFrameCutter cutter(kFrameNs);
  std::uint64_t points = 0;
  std::uint64_t in_frames = 0;
  std::uint64_t packets = 0;
  while (!reader.empty()) {
    const std::size_t length = reader.Byte() + 256U * (reader.Byte() % 8U);
    std::string payload;
    for (std::size_t i = 0; i < length && !reader.empty(); ++i) {
      payload.push_back(static_cast<char>(reader.Byte()));
    }
    if (payload.size() >= 28 && payload.front() == 0) payload.replace(24, 4, 4, '\0');
    LivoxPacket packet;
    if (!Succeeds([&] { packet = ParseLivoxPacket(payload); })) continue;
    CheckPacket(packet);
    if (packet.rays == 0) continue;
    ++packets;
    const std::uint64_t used = cutter.counts().used;
    cutter.Add(packet, {kHostNs, 0});
    if (cutter.counts().used > used) points += packet.points.size();
    in_frames += CheckFrames(cutter);
  }
  cutter.Flush();
  in_frames += CheckFrames(cutter);
  const LivoxCounts& counts = cutter.counts();
  Require(in_frames == points, "every point of a packet that was used is in a frame");
  Require(counts.used + counts.repeated + counts.late + counts.astray + counts.excess == packets,
          "every packet is counted");
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
