#include "app/live_sources.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/followed_folders.hpp"
#include "io/frame_messages.hpp"
#include "io/frame_preparation.hpp"
#include "io/livox_frames.hpp"
#include "io/livox_packets.hpp"
#include "io/livox_receiver.hpp"
#include "io/pcd.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using Clock = LiveIntake::Clock;

// --stdin
class MessageSource : public LiveSource {
 public:
  explicit MessageSource(LiveIntake& intake) : intake_(intake), reader_("stdin"), bytes_(1 << 16) {}

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
    const std::size_t sensor = SensorOf(message);
    PcdCloud cloud;
    try {
      cloud = ParsePcd(message.pcd, message.name);
    } catch (const InputError& error) {
      return intake_.TakeBadFrame(error);
    }
    intake_.Add(sensor, message.stamp_ns, message.name, std::move(cloud));
  }

  std::size_t SensorOf(const FrameMessage& message) {
    if (const std::optional<std::size_t> known = intake_.SensorNamed(message.sensor)) return *known;
    if (intake_.is_full()) {
      throw InputError(message.name + " is of one more sensor, expected at most " +
                       std::to_string(LiveIntake::kMaxSensors));
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
  PacketSource(LivoxEndpoint endpoint, const LiveConfig& config, LiveIntake& intake,
               LiveTeller& teller)
      : frame_ns_(NsOf(config.frame_s)), intake_(intake), teller_(teller), receiver_(endpoint) {
    teller_.Note("listens on " + receiver_.name());
  }

  int fd() const override { return receiver_.fd(); }

  bool Read(bool /*is_ready*/) override {
    for (int i = 0; i < kMaxPacketsAtOnce && TakePacket(); ++i) {
    }
    intake_.LookForSilence();
    return true;
  }

  void Finish() override {
    receiver_.Stop();
    while (TakePacket()) {
    }
    for (auto& [identity, lidar] : lidars_) {
      lidar.cutter.Flush();
      TakeFrames(lidar, Clock::now());
    }
  }

  void AddTo(LiveSummary* summary) const override {
    for (const auto& [identity, lidar] : lidars_) {
      summary->inputs[lidar.sensor].packets = lidar.cutter.counts();
    }
    summary->refused_packets = refused_packets_;
  }

 private:
  static constexpr int kMaxPacketsAtOnce = 256;  // before the program looks for signals

  struct Lidar {
    Lidar(std::size_t its_sensor, TimeNs frame_ns) : sensor(its_sensor), cutter(frame_ns) {}
    std::size_t sensor;
    LivoxFrameCutter cutter;
    std::uint64_t lost_said = 0;
  };
  // One address can be that of a hub with several of them.
  using LidarIdentity = std::tuple<std::uint32_t, std::uint8_t, std::uint8_t>;

  // False where none waits.
  bool TakePacket() {
    const std::optional<Datagram> datagram = receiver_.Next();
    if (!datagram) return false;
    const std::string from = AddressText(datagram->source);
    try {
      const LivoxPacket packet = ParseLivoxPacket(datagram->payload);
      if (packet.rays == 0) return true;
      Lidar& lidar = LidarOf(from, datagram->source, packet);
      lidar.cutter.Add(packet, datagram->received_ns);
      TakeFrames(lidar, datagram->came);
    } catch (const PacketError& error) {
      if (IsWorthANote(++refused_packets_)) {
        teller_.Note(Count(refused_packets_, "packet") + " refused, the last: one from " + from +
                     " " + error.what());
      }
    }
    return true;
  }

  Lidar& LidarOf(const std::string& from, std::uint32_t source, const LivoxPacket& packet) {
    const LidarIdentity identity(source, packet.slot, packet.lidar);
    const auto known = lidars_.find(identity);
    if (known != lidars_.end()) return known->second;
    if (intake_.is_full()) {
      throw PacketError("is of one more sensor, expected at most " +
                        std::to_string(LiveIntake::kMaxSensors));
    }
    std::string name = from;
    std::replace(name.begin(), name.end(), '.', '-');
    if (packet.slot > 1 || packet.lidar > 1) {
      name += "-" + std::to_string(packet.slot) + "-" + std::to_string(packet.lidar);
    }
    const std::size_t sensor = intake_.AddSensor(name, "a packet from " + from);
    return lidars_.emplace(identity, Lidar(sensor, frame_ns_)).first->second;
  }

  // `came`: the packet that completed them.
  void TakeFrames(Lidar& lidar, Clock::time_point came) {
    const std::string name = intake_.NameOf(lidar.sensor);
    while (std::optional<LivoxFrame> frame = lidar.cutter.Next()) {
      if (!intake_.IsInTime(lidar.sensor, Clock::now() - came)) continue;
      intake_.Add(lidar.sensor, frame->stamp_ns,
                  "frame of " + name + ", stamp " + std::to_string(frame->stamp_ns) + " ns",
                  std::move(frame->cloud));
    }
    const LivoxCounts& counts = lidar.cutter.counts();
    if (counts.lost <= lidar.lost_said) return;
    teller_.Note(name + ": " + Count(counts.lost, "packet") + " lost, " +
                 std::to_string(counts.used) + " used");
    lidar.lost_said = 2 * counts.lost;
  }

  TimeNs frame_ns_;
  LiveIntake& intake_;
  LiveTeller& teller_;
  LivoxReceiver receiver_;
  std::map<LidarIdentity, Lidar> lidars_;
  std::uint64_t refused_packets_ = 0;
};

// --follow
class FolderSource : public LiveSource {
 public:
  FolderSource(const std::vector<FrameSource>& sources, const Config& config,
               std::optional<TimeNs> after_ns, LiveIntake& intake)
      : sources_(sources),
        intake_(intake),
        folders_(Watched(sources, config), after_ns,
                 [this](const InputError& error) { intake_.TakeBadFrame(error); }) {}

  int fd() const override { return folders_.fd(); }
  bool is_idle() const override { return folders_.num_pending() == 0; }

  bool Read(bool /*is_ready*/) override {
    folders_.Update();
    if (const std::optional<FollowedFrame> frame = folders_.Next()) {
      Take(*frame);
    } else {
      intake_.LookForSilence();
    }
    intake_.TakeVanished(folders_.num_vanished());
    return true;
  }

  void AddTo(LiveSummary* summary) const override {
    for (std::size_t i = 0; i < sources_.size(); ++i) {
      summary->inputs[i].directory = sources_[i].directory;
    }
    summary->passed_over_frames = folders_.num_passed_over();
  }

 private:
  static std::vector<FollowedFolders::Folder> Watched(const std::vector<FrameSource>& sources,
                                                      const Config& config) {
    std::vector<FollowedFolders::Folder> watched;
    for (const FrameSource& source : sources) {
      const auto known = config.sensors.find(SourceName(source));
      watched.push_back({source.directory, known == config.sensors.end()
                                               ? 0
                                               : OffsetNs(known->first, known->second)});
    }
    return watched;
  }

  void Take(const FollowedFrame& frame) {
    const auto waited = frame.came ? std::make_optional(Clock::now() - *frame.came) : std::nullopt;
    if (!intake_.IsInTime(frame.folder, waited)) return;
    const std::string& path = frame.file.path;
    PcdCloud cloud;
    try {
      cloud = ReadPcd(path);
    } catch (const InputError& error) {
      std::error_code unknown;
      if (std::filesystem::exists(path, unknown)) return intake_.TakeBadFrame(error);
      return folders_.NoteVanished();
    }
    intake_.Add(frame.folder, frame.file.stamp_ns, path, std::move(cloud));
  }

  const std::vector<FrameSource>& sources_;
  LiveIntake& intake_;
  FollowedFolders folders_;
};

}  // namespace

std::unique_ptr<LiveSource> OpenSource(const LiveRequest& request, const Config& config,
                                       std::optional<TimeNs> after_ns, LiveIntake& intake,
                                       LiveTeller& teller) {
  if (request.livox) {
    return std::make_unique<PacketSource>(*request.livox, config.live, intake, teller);
  }
  if (request.sources.empty()) return std::make_unique<MessageSource>(intake);
  return std::make_unique<FolderSource>(request.sources, config, after_ns, intake);
}

}  // namespace unlidar
