#include "app/live_sources.hpp"

#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/arrival.hpp"
#include "io/followed_folders.hpp"
#include "io/frame_messages.hpp"
#include "io/input_limits.hpp"
#include "io/livox_receiver.hpp"
#include "io/pcd.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using Clock = LiveIntake::Clock;

// Returns an instant by both clocks of this computer.
Arrival ArrivalAt(Clock::time_point at) {
  const auto unix = std::chrono::system_clock::now() - (Clock::now() - at);
  return {NsSinceEpoch(unix), NsSinceEpoch(at)};
}

// --stdin
class MessageSource : public LiveSource {
 public:
  MessageSource(const Config& config, LiveIntake& intake)
      : intake_(intake), reader_("stdin", config), bytes_(1 << 16) {}

  int fd() const override { return STDIN_FILENO; }

  bool Read(bool is_ready) override {
    if (!is_ready) return true;
    const ssize_t got = ::read(STDIN_FILENO, bytes_.data(), bytes_.size());
    if (got < 0) {
      if (errno == EINTR || errno == EAGAIN) return true;
      throw InputError(std::string("stdin: cannot be read: ") + std::strerror(errno));
    }
    if (got == 0) {
      reader_.Finish();
      return false;
    }
    reader_.Append({bytes_.data(), static_cast<std::size_t>(got)});
    while (const std::optional<FrameMessage> message = reader_.Next()) Take(*message);
    return true;
  }

 private:
  void Take(const FrameMessage& message) {
    intake_.Warn(reader_.TakeWarnings());
    const std::uint32_t sensor = SensorOf(message);
    PcdCloud cloud;
    try {
      cloud = ParsePcd(message.pcd, message.name);
    } catch (const InputError& error) {
      return intake_.TakeBadFrame(error);
    }
    intake_.Add({sensor, message.stamp_ns, message.name, std::move(cloud), std::nullopt});
  }

  std::uint32_t SensorOf(const FrameMessage& message) {
    if (const std::optional<std::uint32_t> known = intake_.SensorNamed(message.sensor))
      return *known;
    if (intake_.is_full()) {
      throw InputError(message.name + " is of one more sensor, expected at most " +
                       std::to_string(kMaxSensors));
    }
    return intake_.AddSensor(message.sensor, message.name);
  }

  LiveIntake& intake_;
  FrameMessageReader reader_;
  std::vector<char> bytes_;
};

// --livox
class PacketSource : public LiveSource {
 public:
  PacketSource(LivoxEndpoint endpoint, const Config& config, LiveIntake& intake,
               LiveEventReporter& reporter, CaptureFiles* captures)
      : intake_(intake),
        reporter_(reporter),
        lidars_(LivoxNames(config.sensors), NsOf(config.live.frame_s),
                std::chrono::nanoseconds(NsOf(config.live.silent_s))),
        receiver_(endpoint) {
    if (captures != nullptr) recorder_.emplace(*captures, receiver_.endpoint());
    reporter_.Note("listens on " + receiver_.name());
  }

  int fd() const override { return receiver_.fd(); }

  bool Read(bool /*is_ready*/) override {
    for (int i = 0; i < kMaxPacketsAtOnce && TakePacket(); ++i) {
    }
    intake_.CheckSilence();
    NoteRecordingFailure();
    return true;
  }

  void Finish() override {
    receiver_.Stop();
    while (TakePacket()) {
    }
    if (recorder_) recorder_->Stop();
    NoteRecordingFailure();
    for (auto& [identity, lidar] : lidars_.lidars()) {
      lidar.cutter.Flush();
      TakeFrames(lidar, Clock::now());
    }
  }

  // Adds the LiDARs in the order of their addresses, not of their first packets.
  void AddTo(LiveSummary* summary) const override {
    std::vector<LiveInput> by_address;
    for (const auto& [identity, lidar] : lidars_.lidars()) {
      if (!lidar.sensor) continue;
      LiveInput& input = summary->inputs[*lidar.sensor];
      input.packets = lidar.cutter.counts();
      input.sync = lidar.cutter.sync();
      by_address.push_back(std::exchange(input, {}));
    }
    // Inputs that have given up their place have no packets any more, but frames.
    for (LiveInput& input : summary->inputs) {
      if (!input.name.empty()) by_address.push_back(std::move(input));
    }
    summary->inputs = std::move(by_address);
    summary->refused_packets = refused_packets_ + lidars_.forgotten_packets();
    if (recorder_) summary->recording = recorder_->counts();
  }

 private:
  static constexpr int kMaxPacketsAtOnce = 256;  // before the program looks for signals

  // False where none waits.
  bool TakePacket() {
    const std::optional<Datagram> datagram = receiver_.Next();
    if (!datagram) return false;
    if (recorder_) recorder_->Add(*datagram);
    try {
      LivoxLidar* const lidar = lidars_.Take(*datagram);
      if (lidar != nullptr) TakeFrames(*lidar, datagram->arrived);
    } catch (const PacketError& error) {
      ++refused_packets_;
      reporter_.NoteCount(
          refused_packets_ - 1, refused_packets_, "packet",
          " refused, the last: one from " + AddressText(datagram->source) + " " + error.what());
    }
    return true;
  }

  void NoteRecordingFailure() {
    if (!recorder_) return;
    if (const std::optional<std::string> failure = recorder_->TakeFailure()) {
      reporter_.NoteIncident("packets are not recorded: " + *failure, &recording_failures_);
    }
  }

  // A LiDAR is a sensor of the run with its first frame.
  std::uint32_t SensorOf(LivoxLidar& lidar) {
    if (lidar.sensor) return *lidar.sensor;
    lidar.sensor = lidars_.FreeSlot();
    if (lidar.sensor) {
      intake_.ReplaceSensor(*lidar.sensor, lidar.name);
    } else {
      lidar.sensor = intake_.AddSensor(lidar.name, "packets of " + lidar.name);
    }
    return *lidar.sensor;
  }

  void ReportClock(const LivoxLidar& lidar) {
    const std::optional<SyncState> clock = lidar.cutter.sync().state();
    if (lidar.sensor && clock) {
      reporter_.ReportClock(*lidar.sensor, *clock, intake_.newest_ns());
    }
  }

  // `arrived`: the packet that completed them.
  void TakeFrames(LivoxLidar& lidar, Clock::time_point arrived) {
    while (std::optional<LivoxFrame> frame = lidar.cutter.Next()) {
      const std::uint32_t sensor = SensorOf(lidar);
      ReportClock(lidar);
      if (!intake_.IsInTime(sensor, frame->stamp_ns, Clock::now() - arrived, frame->arrival)) {
        continue;
      }
      const std::string name =
          "frame of " + lidar.name + ", stamp " + std::to_string(frame->stamp_ns) + " ns";
      intake_.Add({sensor, frame->stamp_ns, name, std::move(frame->cloud), frame->arrival});
    }
    ReportClock(lidar);
    const LivoxCounts& counts = lidar.cutter.counts();
    if (counts.lost <= lidar.lost_reported) return;
    reporter_.Note(lidar.name + ": " + Count(counts.lost, "packet") + " lost, " +
                   std::to_string(counts.used) + " used");
    lidar.lost_reported = 2 * counts.lost;
  }

  LiveIntake& intake_;
  LiveEventReporter& reporter_;
  LivoxLidars lidars_;
  LivoxReceiver receiver_;
  std::optional<PacketRecorder> recorder_;
  std::uint64_t refused_packets_ = 0;
  std::uint64_t recording_failures_ = 0;
};

// --follow
class FolderSource : public LiveSource {
 public:
  FolderSource(const std::vector<FrameSource>& sources, const Config& config,
               std::optional<TimeNs> after_ns, LiveIntake& intake)
      : intake_(intake), folders_(sources, config, after_ns, [this](const InputError& error) {
          intake_.TakeBadFrame(error);
        }) {}

  int fd() const override { return folders_.fd(); }
  bool is_idle() const override { return folders_.num_pending() == 0; }

  bool Read(bool /*is_ready*/) override {
    folders_.Update();
    intake_.Warn(folders_.TakeWarnings());
    if (const std::optional<FollowedFrame> frame = folders_.Next()) {
      Take(*frame);
    } else {
      intake_.CheckSilence();
    }
    intake_.TakeFollowed(folders_.counts());
    return true;
  }

 private:
  void Take(const FollowedFrame& frame) {
    // Arrival times carry no information for files that existed before the program started.
    const auto waited =
        frame.arrived ? std::make_optional(Clock::now() - *frame.arrived) : std::nullopt;
    const auto arrival =
        frame.arrived ? std::make_optional(ArrivalAt(*frame.arrived)) : std::nullopt;
    if (!intake_.IsInTime(frame.folder, frame.file.stamp_ns, waited, arrival)) return;
    const std::string& path = frame.file.path;
    PcdCloud cloud;
    try {
      cloud = ReadPcd(path);
    } catch (const InputError& error) {
      std::error_code unknown;
      if (std::filesystem::exists(path, unknown)) return intake_.TakeBadFrame(error);
      return folders_.NoteVanished();
    }
    intake_.Add({frame.folder, frame.file.stamp_ns, path, std::move(cloud), arrival});
  }

  LiveIntake& intake_;
  FollowedFolders folders_;
};

}  // namespace

std::unique_ptr<LiveSource> OpenSource(const Arguments& arguments, const Config& config,
                                       std::optional<TimeNs> after_ns, LiveIntake& intake,
                                       LiveEventReporter& reporter, CaptureFiles* captures) {
  if (arguments.follow) {
    return std::make_unique<FolderSource>(arguments.sources, config, after_ns, intake);
  }
  if (arguments.from_stdin) return std::make_unique<MessageSource>(config, intake);
  return std::make_unique<PacketSource>(ParseLivoxEndpoint(arguments.livox), config, intake,
                                        reporter, captures);
}

}  // namespace unlidar
