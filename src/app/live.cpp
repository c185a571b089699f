#include "app/live.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>
#include <variant>

#include "app/frame_times.hpp"
#include "app/live_output.hpp"
#include "app/live_summary.hpp"
#include "app/output_files.hpp"
#include "app/signals.hpp"
#include "base/format.hpp"
#include "io/followed_folders.hpp"
#include "io/frame_messages.hpp"
#include "io/frame_pace.hpp"
#include "io/frame_preparation.hpp"
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

// Frames from a live source through the engine into the outputs.
class LiveRun {
 public:
  LiveRun(const LiveRequest& request, const Config& config,
          const std::function<void(const std::string&)>& note)
      : request_(request),
        config_(config),
        note_(note),
        output_(request.out, request.events, signals_, note),
        engine_(config, SensorNames(request), request.output_times,
                [this](const EngineEvent& event) {
                  std::visit([this](const auto& e) { Take(e); }, event);
                }) {
    for (const std::string& name : SensorNames(request)) sensors_.emplace_back(name);
  }

  void Run() {
    try {
      if (request_.sources.empty()) {
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
                                sensors_[i].frames});
    }
    summary.counts = engine_.counts();
    summary.counts.bad_frames += bad_frames_;
    summary.late_frames = engine_.late_frames();
    summary.overload_frames = overload_frames_;
    summary.vanished_frames = vanished_frames_;
    summary.passed_over_frames = passed_over_frames_;
    summary.frame_times = frame_times_;
    summary.tracks = output_.tracks();
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
    output_.TellState(engine_.newest_ns(), is_overloaded_ ? LiveState::kOverloaded : state_,
                      engine_.counts().frames, LostFrames());
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
    if (!config_.input.skip_bad_frames) throw InputError(error);
    if (IsWorthANote(++bad_frames_)) {
      note_(Count(bad_frames_, "frame") +
            " bad and skipped (input.skip_bad_frames), the last: " + error.what());
    }
  }

  // Waits for the source or a signal, and does what comes up besides. True while it goes on.
  bool Wait(int fd, bool is_idle) {
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
    if (!config_.sensors.empty() && config_.sensors.count(message.sensor) == 0) {
      note_(message.name + ": the config has no sensors." + message.sensor +
            ", it stands at the origin");
    }
    engine_.AddSensor(message.sensor);
    sensors_.emplace_back(message.sensor);
    return sensors_.size() - 1;
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
    const Clock::time_point now = Clock::now();
    Sensor& sensor = sensors_[frame.folder];
    sensor.came = now;
    if (std::exchange(sensor.is_silent_by_clock, false)) TellSensor(frame.folder, false);
    const auto waited = frame.came ? std::make_optional(now - *frame.came) : std::nullopt;
    const bool is_kept = pace.Keeps(frame.folder, waited, now);
    TellOverload(pace.one_in());
    if (!is_kept) {
      ++overload_frames_;
      return;
    }
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
    engine_.Close();
    TellState();
    output_.Close();
  }

  const LiveRequest& request_;
  const Config& config_;
  const std::function<void(const std::string&)>& note_;
  Signals signals_;
  LiveOutput output_;
  LiveEngine engine_;
  std::vector<Sensor> sensors_;
  FrameTimes frame_times_;
  LiveState state_ = LiveState::kWarmingUp;
  bool is_overloaded_ = false;
  bool is_ready_ = false;
  std::uint64_t one_in_ = 1;
  std::uint64_t bad_frames_ = 0;
  std::uint64_t overload_frames_ = 0;
  std::uint64_t vanished_frames_ = 0;
  std::uint64_t passed_over_frames_ = 0;
};

void NoteLosses(const LiveSummary& summary, const std::function<void(const std::string&)>& note) {
  const auto say = [&](std::uint64_t count, const char* what) {
    if (count > 0) note(Count(count, "frame") + what);
  };
  say(summary.counts.bad_frames, " could not be parsed and skipped (input.skip_bad_frames)");
  say(summary.late_frames, " came later than live.reorder_s and dropped");
  say(summary.overload_frames, " left out while overloaded");
  say(summary.vanished_frames, " removed before it could be read");
  say(summary.passed_over_frames, " passed over: the stamp had come before");
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
