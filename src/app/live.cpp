#include "app/live.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <utility>
#include <variant>

#include "app/frame_times.hpp"
#include "app/live_output.hpp"
#include "app/live_summary.hpp"
#include "app/output.hpp"
#include "app/output_files.hpp"
#include "app/service_notify.hpp"
#include "app/signals.hpp"
#include "base/format.hpp"
#include "io/followed_folders.hpp"
#include "io/frame_messages.hpp"
#include "io/frame_pace.hpp"
#include "io/frame_preparation.hpp"
#include "io/livox_frames.hpp"
#include "io/livox_packets.hpp"
#include "io/livox_receiver.hpp"
#include "io/pcd.hpp"
#include "live/live_engine.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using Clock = std::chrono::steady_clock;

// How often it looks whether a sensor is silent and a full disk has room again.
constexpr std::chrono::milliseconds kLookAround(250);

// A stream of garbage that looks like frames of ever new sensors must not fill the memory.
constexpr std::size_t kMaxSensors = 64;

Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

// What happens again and again is said the first time, the second, the fourth and so on.
bool IsWorthANote(std::uint64_t count) { return count > 0 && (count & (count - 1)) == 0; }

// How long rows of a track wait for it to be a drone: no longer than anything is remembered.
TimeNs HoldNs(const LiveConfig& live) {
  return std::isfinite(live.window_s) ? std::llround(live.window_s / kSecondsPerNs)
                                      : std::numeric_limits<TimeNs>::max();
}

// Before it looks for signals.
constexpr int kMaxPacketsAtOnce = 256;

// Frames from a live source through the engine into the outputs.
class LiveRun {
 public:
  LiveRun(const LiveRequest& request, const Config& config,
          const std::function<void(const std::string&)>& note)
      : request_(request),
        config_(config),
        note_(note),
        output_(request.out, request.events, signals_, note),
        engine_(
            config, SensorNames(request), request.output_times,
            [this](const EngineEvent& event) {
              std::visit([this](const auto& e) { Take(e); }, event);
            },
            request.livox ? std::make_optional(TimeReading::kOffset) : std::nullopt) {
    for (const std::string& name : SensorNames(request)) sensors_.emplace_back(name);
    output_.KeepOnlyDrones(request.least_drone, HoldNs(config.live));
  }

  void Run() {
    try {
      if (request_.livox) {
        ReceivePackets(*request_.livox);
      } else if (request_.sources.empty()) {
        ReadMessages();
      } else {
        FollowFolders();
      }
    } catch (const InputError&) {
      Close();  // what came before the error is not lost
      throw;
    }
    Close();
  }

  LiveSummary Summary() const {
    LiveSummary summary;
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      const bool is_folder = i < request_.sources.size();
      summary.inputs.push_back({sensors_[i].name,
                                is_folder ? request_.sources[i].directory : std::string(),
                                sensors_[i].frames, std::nullopt});
    }
    for (const auto& [identity, lidar] : lidars_) {
      summary.inputs[lidar.sensor].packets = lidar.cutter.counts();
    }
    summary.counts = engine_.counts();
    summary.counts.bad_frames += bad_frames_;
    summary.late_frames = engine_.late_frames();
    summary.overload_frames = overload_frames_;
    summary.vanished_frames = vanished_frames_;
    summary.passed_over_frames = passed_over_frames_;
    summary.frame_times = frame_times_;
    summary.refused_packets = refused_packets_;
    summary.tracks = output_.tracks();
    summary.tracks_left_out = output_.tracks_left_out();
    return summary;
  }

 private:
  struct Sensor {
    explicit Sensor(std::string its_name) : name(std::move(its_name)) {}
    std::string name;
    std::uint64_t frames = 0;
    std::optional<bool> is_silent;  // as it was told
    bool is_silent_by_clock = false;
    Clock::time_point came = Clock::now();  // its last frame
  };

  // A sensor of --livox. One address can be that of a hub with several of them.
  struct Lidar {
    Lidar(std::size_t its_sensor, TimeNs frame_ns) : sensor(its_sensor), cutter(frame_ns) {}
    std::size_t sensor;
    LivoxFrameCutter cutter;
    std::uint64_t lost_said = 0;
  };
  using LidarIdentity = std::tuple<std::uint32_t, std::uint8_t, std::uint8_t>;

  static std::vector<std::string> SensorNames(const LiveRequest& request) {
    std::vector<std::string> names;
    for (const FrameSource& source : request.sources) names.push_back(SourceName(source));
    return names;
  }

  // Events of the engine.
  void Take(const TrackConfirmed& track) { output_.Confirm(engine_.newest_ns(), track); }
  void Take(const RowGiven& row) { output_.Give(engine_.newest_ns(), row); }
  void Take(const TrackEnded& track) { output_.End(engine_.newest_ns(), track); }
  void Take(const SensorChanged& change) { TellSensor(change.sensor, change.is_silent); }
  void Take(const EngineState& state) {
    state_ = state == EngineState::kWarmingUp ? LiveState::kWarmingUp : LiveState::kRunning;
    if (!is_overloaded_) TellState();
  }

  void TellState() {
    const LiveState state = is_overloaded_ ? LiveState::kOverloaded : state_;
    output_.TellState(engine_.newest_ns(), state, engine_.counts().frames, LostFrames());
    service_.TellStatus(LiveStateName(state));
  }

  void TellSensor(std::size_t index, bool is_silent) {
    Sensor& sensor = sensors_[index];
    if (sensor.is_silent == is_silent) return;
    sensor.is_silent = is_silent;
    output_.TellSensor(engine_.newest_ns(), sensor.name, is_silent);
  }

  std::uint64_t LostFrames() const {
    return bad_frames_ + engine_.counts().bad_frames + engine_.late_frames() + overload_frames_ +
           vanished_frames_;
  }

  void AddFrame(std::size_t sensor, TimeNs stamp_ns, const std::string& name, PcdCloud cloud) {
    const std::uint64_t late_before = engine_.late_frames();
    const double begin_s = ThreadCpuSeconds();
    try {
      engine_.Add({static_cast<std::uint32_t>(sensor), stamp_ns, name, std::move(cloud)});
      ++sensors_[sensor].frames;
    } catch (const InputError& error) {
      TakeBadFrame(error);
    }
    frame_times_.Add(ThreadCpuSeconds() - begin_s);
    if (!sensors_[sensor].is_silent) TellSensor(sensor, false);  // its first
    const std::uint64_t late = engine_.late_frames();
    if (late > late_before && IsWorthANote(late)) {
      note_(Count(late, "frame") + " later than live.reorder_s and dropped, the last: " + name);
    }
    output_.Flush();
  }

  void TakeBadFrame(const InputError& error) {
    if (!config_.input.skip_bad_frames && !request_.livox) throw InputError(error);
    if (IsWorthANote(++bad_frames_)) {
      note_(Count(bad_frames_, "frame") + " bad and skipped" +
            (request_.livox ? "" : " (input.skip_bad_frames)") + ", the last: " + error.what());
    }
  }

  // Waits for the source or a signal, and does what comes up besides. True while it goes on. Every
  // source is open when it is first waited for.
  bool Wait(int fd, bool is_idle) {
    service_.TellAlive();
    std::vector<pollfd> fds = {{fd, POLLIN, 0}};
    for (const int reader : output_.reader_fds()) fds.push_back({reader, 0, 0});
    fds = signals_.Wait(fds, is_idle ? kLookAround : std::chrono::milliseconds(0));
    is_ready_ = fds.front().revents != 0;
    if (std::any_of(fds.begin() + 1, fds.end(), [](const pollfd& f) { return f.revents != 0; })) {
      throw OutputError("the reader of an output has left");
    }
    if (signals_.ShouldReopen()) output_.Reopen();
    output_.Flush();
    return !signals_.ShouldEnd();
  }

  void ReadMessages() {
    FrameMessageReader reader("stdin");
    std::vector<char> bytes(1 << 16);
    while (Wait(STDIN_FILENO, true)) {
      if (!is_ready_) continue;
      const ssize_t got = ::read(STDIN_FILENO, bytes.data(), bytes.size());
      if (got < 0) {
        if (errno == EINTR || errno == EAGAIN) continue;
        throw InputError(std::string("stdin: cannot be read: ") + std::strerror(errno));
      }
      if (got == 0) return reader.Finish();
      reader.Append({bytes.data(), static_cast<std::size_t>(got)});
      while (const std::optional<FrameMessage> message = reader.Next()) TakeMessage(*message);
    }
  }

  void TakeMessage(const FrameMessage& message) {
    const std::size_t sensor = SensorOf(message);
    PcdCloud cloud;
    try {
      cloud = ParsePcd(message.pcd, message.name);
    } catch (const InputError& error) {
      return TakeBadFrame(error);
    }
    AddFrame(sensor, message.stamp_ns, message.name, std::move(cloud));
  }

  std::size_t SensorOf(const FrameMessage& message) {
    const auto known = std::find_if(sensors_.begin(), sensors_.end(), [&](const Sensor& sensor) {
      return sensor.name == message.sensor;
    });
    if (known != sensors_.end()) return static_cast<std::size_t>(known - sensors_.begin());
    if (sensors_.size() == kMaxSensors) {
      throw InputError(message.name + " is of one more sensor, expected at most " +
                       std::to_string(kMaxSensors));
    }
    return AddSensor(message.sensor, message.name);
  }

  // `first`: what messages call what came first of it.
  std::size_t AddSensor(const std::string& name, const std::string& first) {
    if (!config_.sensors.empty() && config_.sensors.count(name) == 0) {
      note_(first + ": the config has no sensors." + name + ", it stands at the origin");
    }
    engine_.AddSensor(name);
    sensors_.emplace_back(name);
    return sensors_.size() - 1;
  }

  void ReceivePackets(LivoxEndpoint endpoint) {
    LivoxReceiver receiver(endpoint);
    note_("listens on " + receiver.name());
    FramePace pace(Seconds(config_.live.overload_s));
    while (Wait(receiver.fd(), true)) {
      for (int i = 0; i < kMaxPacketsAtOnce && TakePacket(receiver, pace); ++i) {
      }
      LookForSilence();
    }
    receiver.Stop();
    while (TakePacket(receiver, pace)) {
    }
    FlushLidars(pace);
  }

  // False where none waits.
  bool TakePacket(LivoxReceiver& receiver, FramePace& pace) {
    const std::optional<Datagram> datagram = receiver.Next();
    if (!datagram) return false;
    const std::string from = AddressText(datagram->source);
    try {
      const LivoxPacket packet = ParseLivoxPacket(datagram->payload);
      if (packet.rays == 0) return true;
      Lidar& lidar = LidarOf(from, datagram->source, packet);
      lidar.cutter.Add(packet, datagram->received_ns);
      TakeFrames(lidar, datagram->came, pace);
    } catch (const PacketError& error) {
      if (IsWorthANote(++refused_packets_)) {
        note_(Count(refused_packets_, "packet") + " refused, the last: one from " + from + " " +
              error.what());
      }
    }
    return true;
  }

  Lidar& LidarOf(const std::string& from, std::uint32_t source, const LivoxPacket& packet) {
    const LidarIdentity identity(source, packet.slot, packet.lidar);
    const auto known = lidars_.find(identity);
    if (known != lidars_.end()) return known->second;
    if (sensors_.size() == kMaxSensors) {
      throw PacketError("is of one more sensor, expected at most " + std::to_string(kMaxSensors));
    }
    std::string name = from;
    std::replace(name.begin(), name.end(), '.', '-');
    if (packet.slot > 1 || packet.lidar > 1) {
      name += "-" + std::to_string(packet.slot) + "-" + std::to_string(packet.lidar);
    }
    const auto frame_ns = std::llround(config_.live.frame_s / kSecondsPerNs);
    const std::size_t sensor = AddSensor(name, "a packet from " + from);
    return lidars_.emplace(identity, Lidar(sensor, frame_ns)).first->second;
  }

  // `came`: the packet that completed them.
  void TakeFrames(Lidar& lidar, Clock::time_point came, FramePace& pace) {
    while (std::optional<LivoxFrame> frame = lidar.cutter.Next()) {
      if (!IsInTime(lidar.sensor, Clock::now() - came, pace)) continue;
      const std::string& name = sensors_[lidar.sensor].name;
      AddFrame(lidar.sensor, frame->stamp_ns,
               "frame of " + name + ", stamp " + std::to_string(frame->stamp_ns) + " ns",
               std::move(frame->cloud));
    }
    const LivoxCounts& counts = lidar.cutter.counts();
    if (counts.lost <= lidar.lost_said) return;
    note_(sensors_[lidar.sensor].name + ": " + Count(counts.lost, "packet") + " lost, " +
          std::to_string(counts.used) + " used");
    lidar.lost_said = 2 * counts.lost;
  }

  void FlushLidars(FramePace& pace) {
    for (auto& [identity, lidar] : lidars_) {
      lidar.cutter.Flush();
      TakeFrames(lidar, Clock::now(), pace);
    }
  }

  void FollowFolders() {
    std::vector<FollowedFolders::Folder> watched;
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      const auto known = config_.sensors.find(sensors_[i].name);
      watched.push_back(
          {request_.sources[i].directory,
           known == config_.sensors.end() ? 0 : OffsetNs(sensors_[i].name, known->second)});
    }
    FollowedFolders folders(watched, TakenUpAfter(),
                            [this](const InputError& error) { TakeBadFrame(error); });
    FramePace pace(Seconds(config_.live.overload_s));
    while (Wait(folders.fd(), folders.num_pending() == 0)) {
      folders.Update();
      if (const std::optional<FollowedFrame> frame = folders.Next()) {
        Follow(*frame, pace, folders);
      } else {
        LookForSilence();
      }
      TellVanished(folders.num_vanished());
      passed_over_frames_ = folders.num_passed_over();
    }
  }

  // A restart reads the last window before the last row once more: the scene must be known again
  // where the rows go on.
  std::optional<TimeNs> TakenUpAfter() {
    const std::optional<TimeNs> last_row_ns = output_.last_row_ns();
    if (!last_row_ns) return std::nullopt;
    output_.LeaveOutUntil(*last_row_ns);
    const double window_s = config_.live.window_s;
    if (!std::isfinite(window_s)) return std::nullopt;
    note_(request_.out + ": goes on behind its last row");
    return *last_row_ns - std::llround(window_s / kSecondsPerNs);
  }

  void Follow(const FollowedFrame& frame, FramePace& pace, FollowedFolders& folders) {
    const auto waited = frame.came ? std::make_optional(Clock::now() - *frame.came) : std::nullopt;
    if (!IsInTime(frame.folder, waited, pace)) return;
    const std::string& path = frame.file.path;
    PcdCloud cloud;
    try {
      cloud = ReadPcd(path);
    } catch (const InputError& error) {
      std::error_code unknown;
      if (std::filesystem::exists(path, unknown)) return TakeBadFrame(error);
      return folders.NoteVanished();
    }
    AddFrame(frame.folder, frame.file.stamp_ns, path, std::move(cloud));
  }

  // Whether a frame that has waited so long is to be worked off.
  bool IsInTime(std::size_t index, std::optional<Clock::duration> waited, FramePace& pace) {
    const Clock::time_point now = Clock::now();
    Sensor& sensor = sensors_[index];
    sensor.came = now;
    if (std::exchange(sensor.is_silent_by_clock, false)) TellSensor(index, false);
    const bool is_kept = pace.Keeps(index, waited, now);
    TellOverload(pace.one_in());
    if (!is_kept) ++overload_frames_;
    return is_kept;
  }

  void TellOverload(std::uint64_t one_in) {
    if (std::exchange(one_in_, one_in) == one_in) return;
    const bool was_overloaded = std::exchange(is_overloaded_, one_in > 1);
    note_(is_overloaded_ ? "overloaded: one frame in " + std::to_string(one_in) + " is worked off"
                         : "no more overloaded, left out: " + Count(overload_frames_, "frame"));
    if (was_overloaded == is_overloaded_) return;
    TellState();
  }

  void TellVanished(std::uint64_t frames) {
    if (std::exchange(vanished_frames_, frames) == frames || !IsWorthANote(frames)) return;
    note_(Count(frames, "frame") + " removed before it could be read");
  }

  // A pulled cable: time stands still for the engine, but not for who waits for an answer.
  void LookForSilence() {
    const Clock::time_point now = Clock::now();
    const auto is_quiet = [&](const Sensor& sensor) {
      return now - sensor.came > Seconds(config_.live.silent_s);
    };
    if (!std::all_of(sensors_.begin(), sensors_.end(), is_quiet)) return;
    for (std::size_t i = 0; i < sensors_.size(); ++i) {
      sensors_[i].is_silent_by_clock = true;
      TellSensor(i, true);
    }
  }

  void Close() {
    service_.TellStopping();
    engine_.Close();
    TellState();
    output_.Close();
  }

  const LiveRequest& request_;
  const Config& config_;
  const std::function<void(const std::string&)>& note_;
  Signals signals_;
  ServiceNotifier service_;
  LiveOutput output_;
  LiveEngine engine_;
  std::vector<Sensor> sensors_;
  FrameTimes frame_times_;
  std::map<LidarIdentity, Lidar> lidars_;
  LiveState state_ = LiveState::kWarmingUp;
  bool is_overloaded_ = false;
  bool is_ready_ = false;
  std::uint64_t one_in_ = 1;
  std::uint64_t bad_frames_ = 0;
  std::uint64_t overload_frames_ = 0;
  std::uint64_t vanished_frames_ = 0;
  std::uint64_t passed_over_frames_ = 0;
  std::uint64_t refused_packets_ = 0;
};

void NoteLosses(const LiveSummary& summary, const std::function<void(const std::string&)>& note) {
  const auto say = [&](std::uint64_t count, const char* what) {
    if (count > 0) note(Count(count, "frame") + what);
  };
  for (const LiveInput& input : summary.inputs) {
    if (!input.packets) continue;
    const LivoxCounts& packets = *input.packets;
    const auto told = [](std::uint64_t count, const char* what) {
      return count > 0 ? ", " + std::to_string(count) + " " + what : std::string();
    };
    note(input.name + ": " + Count(packets.used, "packet") + " used" + told(packets.lost, "lost") +
         told(packets.repeated, "repeated") + told(packets.reordered, "reordered") +
         told(packets.late, "too late") + told(packets.astray, "of a time far from the others") +
         told(packets.excess, "more than a frame holds"));
  }
  if (summary.refused_packets > 0) note(Count(summary.refused_packets, "packet") + " refused");
  say(summary.counts.bad_frames, " could not be parsed and skipped (input.skip_bad_frames)");
  say(summary.late_frames, " came later than live.reorder_s and dropped");
  say(summary.overload_frames, " left out while overloaded");
  say(summary.vanished_frames, " removed before it could be read");
  say(summary.passed_over_frames, " passed over: the stamp had come before");
  if (summary.tracks_left_out > 0) note(TracksLeftOutText(summary.tracks_left_out));
  if (summary.tracks.empty()) {
    note("no drone found in " + Count(summary.counts.frames, "frame") + " with " +
         Count(summary.counts.returns, "return"));
  }
}

}  // namespace

std::string TrackLive(const LiveRequest& request, const Config& config,
                      const std::function<void(const std::string&)>& note) {
  CheckLive(config);
  if (request.events == "-" && ResolvedPath(request.out) == ResolvedPath("/dev/stdout")) {
    throw UsageError("--out " + request.out +
                     ": stdout holds nothing but the events (--events -), expected a file");
  }
  CheckNames(request.sources);
  LiveRun run(request, config, note);
  run.Run();
  const LiveSummary summary = run.Summary();
  if (!request.summary.empty()) {
    WriteFiles({{request.summary, Content(LiveSummaryJson(summary, config))}});
  }
  NoteLosses(summary, note);
  std::uint64_t rows = 0;
  for (const LiveTrack& track : summary.tracks) rows += track.rows;
  return request.out + ": " + Count(summary.tracks.size(), "track") + ", " + Count(rows, "row") +
         ", from " + Count(summary.counts.frames, "frame") + " of " +
         Count(summary.inputs.size(), "LiDAR");
}

}  // namespace unlidar
