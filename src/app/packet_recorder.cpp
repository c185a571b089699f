#include "app/packet_recorder.hpp"

#include <chrono>
#include <utility>

#include "io/packet_capture.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::chrono::seconds kWriteInterval(1);

}  // namespace

PacketRecorder::PacketRecorder(CaptureFiles& files, const LivoxEndpoint& receiver)
    : files_(files), receiver_(receiver), counts_{0, 0, files.total_bytes()}, thread_([this] {
        Run();
      }) {}

void PacketRecorder::Add(const Datagram& datagram) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (waiting_.size() >= kMaxWaitingBytes) {
    return LosePackets(1, "the disk is slower than the packets");
  }
  AppendCaptureRecord(datagram, receiver_, waiting_);
  ++waiting_packets_;
  if (waiting_.size() >= kMaxWriteBytes) is_due_.notify_one();
}

void PacketRecorder::Stop() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_ending_ = true;
  }
  is_due_.notify_one();
  thread_.join();
}

RecordingCounts PacketRecorder::counts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counts_;
}

std::optional<std::string> PacketRecorder::TakeFailure() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(failure_, std::nullopt);
}

void PacketRecorder::Run() {
  std::string records;
  std::unique_lock<std::mutex> lock(mutex_);
  for (bool is_last = false; !is_last;) {
    is_due_.wait_for(lock, kWriteInterval,
                     [this] { return is_ending_ || waiting_.size() >= kMaxWriteBytes; });
    is_last = is_ending_;
    records.clear();
    records.swap(waiting_);
    const std::uint64_t packets = std::exchange(waiting_packets_, 0);
    lock.unlock();
    std::string failure;
    const std::uint64_t before = files_.packets();
    try {
      files_.Write(records);
    } catch (const OutputError& error) {
      failure = error.what();
    }
    const std::uint64_t written = files_.packets() - before;
    lock.lock();
    counts_.packets += written;
    counts_.bytes = files_.total_bytes();
    if (failure.empty()) {
      is_failing_ = is_failing_ && packets == 0;
    } else {
      LosePackets(packets - written, failure);
    }
  }
}

// The mutex is held.
void PacketRecorder::LosePackets(std::uint64_t count, const std::string& reason) {
  counts_.lost_packets += count;
  if (!std::exchange(is_failing_, true)) failure_ = reason;
}

}  // namespace unlidar
