#include "app/packet_recorder.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <thread>

#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;
using ::unlidar::testing::TemporaryFolder;

constexpr LivoxEndpoint kReceiver = {0x7f000001, 56301};
constexpr CaptureLimits kLimits = {100'000'000, 1'000'000'000};

Datagram PacketOf(std::size_t bytes) {
  Datagram datagram;
  datagram.received_ns = 1'706'300'000'000'000'000;
  datagram.payload.assign(bytes, 'x');
  datagram.sent_bytes = bytes;
  return datagram;
}

std::uint64_t TotalBytes(const std::string& folder) {
  std::uint64_t total = 0;
  for (const auto& entry : fs::directory_iterator(folder)) total += entry.file_size();
  return total;
}

// However fast they come: where the disk is too slow, they are lost and counted.
TEST(PacketRecorder, EachPacketIsWrittenOrCounted) {
  const TemporaryFolder folder;
  CaptureFiles files(folder.path(), kLimits);
  PacketRecorder recorder(files, kReceiver);
  constexpr std::uint64_t kPackets = 100'000;
  const Datagram packet = PacketOf(1380);
  for (std::uint64_t k = 0; k < kPackets; ++k) recorder.Add(packet);
  recorder.Stop();
  const RecordingCounts counts = recorder.counts();
  EXPECT_EQ(counts.packets + counts.lost_packets, kPackets);
  EXPECT_EQ(counts.lost_packets > 0, recorder.TakeFailure().has_value());
  EXPECT_FALSE(recorder.TakeFailure());
  std::string record;
  AppendCaptureRecord(packet, kReceiver, record);
  EXPECT_EQ(counts.bytes, TotalBytes(folder.path()));
  const std::uint64_t records = counts.bytes / record.size();
  EXPECT_EQ(records, counts.packets);
}

TEST(PacketRecorder, WritesWithoutWaitingForMore) {
  const TemporaryFolder folder;
  CaptureFiles files(folder.path(), kLimits);
  PacketRecorder recorder(files, kReceiver);
  recorder.Add(PacketOf(10));
  for (int k = 0; k < 600 && recorder.counts().packets == 0; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(recorder.counts().packets, 1U);
}

TEST(PacketRecorder, TellsOnceWhyPacketsAreLostAndGoesOnAsSoonAsItCan) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "packets");
  CaptureFiles files(folder / "packets", kLimits);
  fs::remove(folder / "packets");
  PacketRecorder recorder(files, kReceiver);
  const auto add_until = [&](const auto& is_reached) {
    for (int k = 0; k < 6000 && !is_reached(recorder.counts()); ++k) {
      recorder.Add(PacketOf(10));
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  };
  std::uint64_t lost = 0;
  for (int round = 0; round < 2; ++round) {
    add_until([&](const RecordingCounts& counts) { return counts.lost_packets > lost; });
    lost = recorder.counts().lost_packets;
    EXPECT_EQ(recorder.TakeFailure().has_value(), round == 0);
  }
  fs::create_directory(folder / "packets");
  add_until([](const RecordingCounts& counts) { return counts.packets > 0; });
  recorder.Stop();
  EXPECT_GT(recorder.counts().packets, 0U);
  EXPECT_FALSE(recorder.TakeFailure());
}

}  // namespace
}  // namespace unlidar
