// Tracking while frames come: --follow, --stdin and --livox.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "app/live_intake.hpp"
#include "app/live_output.hpp"
#include "app/live_sources.hpp"
#include "app/output.hpp"
#include "app/packet_recorder.hpp"
#include "app/service.hpp"
#include "app/summary.hpp"
#include "app/trace_output.hpp"
#include "app/track_drones.hpp"
#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/arrival.hpp"
#include "io/frame_directory.hpp"
#include "io/livox_receiver.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Interval of the checks for silent sensors and for room on a full disk.
constexpr std::chrono::milliseconds kPollInterval(250);
constexpr std::chrono::seconds kStatusInterval(1);

std::size_t ResidentBytes() {
  std::size_t pages = 0;
  std::ifstream statm("/proc/self/statm");
  statm.ignore(std::numeric_limits<std::streamsize>::max(), ' ');  // size of the address space
  statm >> pages;
  return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

// Limit for holding the rows of a track until it is a drone: the length of the scene memory.
TimeNs HoldNs(const LiveConfig& live) {
  return std::isfinite(live.window_s) ? NsOf(live.window_s) : std::numeric_limits<TimeNs>::max();
}

// Rows more than a day ahead of this computer are ignored for resuming; a computer without a clock
// battery may be behind its own rows by less.
RowTimes EarlierRows(const Config& config) {
  const double late_s = config.live.delay_s + config.robust.tracker.max_gap_s;
  const TimeNs held_ns = HoldNs(config.live);
  const bool is_endless = held_ns > kMaxStampNs || std::isinf(late_s);
  const auto now = std::chrono::system_clock::now() + std::chrono::hours(24);
  return {is_endless ? 2 * kMaxStampNs : held_ns + NsOf(late_s), NsSinceEpoch(now)};
}

// Main loop: wait for the source, read, write the results.
class LiveRun {
 public:
  LiveRun(const Arguments& arguments, const OutputTimes& output_times, const Config& config,
          CaptureFiles* captures, const NoteCallback& note)
      : arguments_(arguments),
        config_(config),
        captures_(captures),
        output_(arguments.out, arguments.events, EarlierRows(config), signals_, note),
        reporter_(output_, service_, note),
        trace_(arguments.trace.empty()
                   ? nullptr
                   : std::make_unique<LiveTraceOutput>(arguments.trace, signals_, note)),
        intake_(arguments, output_times, config, reporter_, trace_ ? trace_->Sink() : nullptr) {
    output_.LeaveOutBirds(arguments.max_bird_probability(), HoldNs(config.live));
    if (!arguments.event_returns_file.empty()) {
      output_.WriteReturnsTo(arguments.event_returns_file, note);
    }
  }

  void Run() {
    try {
      source_ = OpenSource(arguments_, config_, ResumeAfter(), intake_, reporter_, captures_);
      if (const std::optional<TimeNs> last_row_ns = output_.row_times().last_ns()) {
        reporter_.Note(arguments_.out + ": appends to it, it holds rows until " +
                       SecondsText(*last_row_ns));
      }
      while (const std::optional<bool> is_ready = Wait()) {
        if (!source_->Read(*is_ready)) break;
      }
      source_->Finish();
    } catch (const InputError&) {
      Close();  // output from before the error is kept
      throw;
    }
    Close();
  }

  const std::vector<LiveTrack>& tracks() const { return output_.tracks(); }

  LiveSummary Summary() const {
    LiveSummary summary = intake_.Summary();
    if (source_) source_->AddTo(&summary);
    summary.output = output_.counts();
    return summary;
  }

 private:
  using Clock = std::chrono::steady_clock;

  // After a restart, the last window before the last row is read again, so that the scene is known
  // where the rows continue.
  std::optional<TimeNs> ResumeAfter() {
    const std::optional<TimeNs> latest_row_ns = output_.row_times().latest_ns();
    if (!latest_row_ns) return std::nullopt;
    if (arguments_.from_stdin) output_.RefuseEarlierRows();
    if (!arguments_.follow) return std::nullopt;
    const double window_s = config_.live.window_s;
    std::optional<TimeNs> after_ns;
    if (std::isfinite(window_s)) after_ns = *latest_row_ns - NsOf(window_s);
    output_.SkipRows(after_ns, *latest_row_ns);
    return after_ns;
  }

  // Waits for the source or a signal, with periodic work. Returns true if the source is ready; none
  // at the end of the run. Every source is open when it is first waited for.
  std::optional<bool> Wait() {
    service_.SendHeartbeat();
    std::vector<pollfd> fds = {{source_->fd(), POLLIN, 0}};
    for (const int reader : output_.reader_fds()) fds.push_back({reader, 0, 0});
    if (trace_) fds.push_back({trace_->reader_fd(), 0, 0});
    fds = signals_.Wait(fds, source_->is_idle() ? kPollInterval : std::chrono::milliseconds(0));
    if (std::any_of(fds.begin() + 1, fds.end(), [](const pollfd& f) { return f.revents != 0; })) {
      throw OutputError("the reader of an output has left");
    }
    if (signals_.ShouldReopen()) {
      output_.Reopen();
      if (trace_) trace_->Reopen();
    }
    output_.Flush();
    WriteStatus(false);
    if (signals_.ShouldEnd()) return std::nullopt;
    return fds.front().revents != 0;
  }

  void Close() {
    service_.ReportStopping();
    intake_.Close();
    output_.Close();
    if (trace_) trace_->Close();
    WriteStatus(true);
  }

  // Replaces --state and --metrics if they are due, or at the end. A disk that is full must not end
  // the run: the first failure of several in a row is a note.
  void WriteStatus(bool is_end) {
    if (arguments_.state.empty() && arguments_.metrics.empty()) return;
    const auto now = Clock::now();
    if (!is_end && status_written_ && now - *status_written_ < kStatusInterval) return;
    status_written_ = now;
    const TimeNs now_ns = NsSinceEpoch(std::chrono::system_clock::now());
    const LiveStatus status = {
        reporter_.state(),  is_end,          now_ns,    intake_.newest_ns(),
        reporter_.one_in(), ResidentBytes(), Summary(), output_.CurrentTracks()};
    std::vector<OutputFile> files;
    if (!arguments_.state.empty()) files.push_back({arguments_.state, Content(StateJson(status))});
    if (!arguments_.metrics.empty()) {
      files.push_back({arguments_.metrics, Content(MetricsText(status))});
    }
    try {
      WriteFiles(files);
      has_status_failed_ = false;
    } catch (const OutputError& error) {
      if (!std::exchange(has_status_failed_, true)) reporter_.Note(error.what());
    }
  }

  const Arguments& arguments_;
  const Config& config_;
  CaptureFiles* captures_;
  Signals signals_;
  ServiceNotifier service_;
  LiveOutput output_;
  LiveEventReporter reporter_;
  std::unique_ptr<LiveTraceOutput> trace_;
  LiveIntake intake_;
  std::unique_ptr<LiveSource> source_;
  std::optional<Clock::time_point> status_written_;
  bool has_status_failed_ = false;
};

void NoteLosses(const LiveSummary& summary, const std::vector<LiveTrack>& tracks,
                const NoteCallback& note) {
  const auto say = [&](std::uint64_t count, const char* noun, const char* fate) {
    if (count > 0) note(Count(count, noun) + fate);
  };
  const auto say_frames = [&](std::uint64_t count, const char* fate) { say(count, "frame", fate); };
  for (const LiveInput& input : summary.inputs) {
    if (!input.packets) continue;
    const LivoxCounts& packets = *input.packets;
    const auto counted = [](std::uint64_t count, const char* what) {
      return count > 0 ? ", " + std::to_string(count) + " " + what : std::string();
    };
    note(input.name + ": " + Count(packets.used, "packet") + " used" +
         counted(packets.lost, "lost") + counted(packets.repeated, "repeated") +
         counted(packets.reordered, "reordered") + counted(packets.late, "too late") +
         counted(packets.astray, "of a time far from the others") +
         counted(packets.excess, "more than a frame holds"));
  }
  say(summary.refused_packets, "packet", " refused");
  for (const LiveInput& input : summary.inputs) {
    if (input.sync && input.sync->losses() > 0) {
      note(input.name + ": lost its time synchronisation " + Count(input.sync->losses(), "time"));
    }
  }
  if (summary.recording) {
    say(summary.recording->lost_packets, "packet", " not recorded (--record-packets)");
  }
  say_frames(summary.counts.bad_frames, kUnparsedText);
  say_frames(summary.late_frames, " came later than live.reorder_s and dropped");
  say_frames(summary.astray_frames,
             " astray and left out: neither this clock nor most LiDARs bear them out");
  say_frames(summary.overflow_frames, kOverflowText);
  say_frames(summary.overload_frames, " left out while overloaded");
  say_frames(summary.followed.vanished, kVanishedText);
  say_frames(summary.followed.passed_over, kPassedOverText);
  say_frames(summary.followed.already_processed, kAlreadyProcessedText);
  say(summary.output.left_out_rows, "row", " left out: --out held them already");
  say(summary.output.unwritable_rows, "row", kUnwritableText);
  for (const LiveInput& input : summary.inputs) {
    if (input.blinded_s > 0.0) note(BlindedText(input.name, input.blinded_s));
  }
  for (const LiveTrack& track : tracks) {
    if (track.minimum && !track.minimum->converged) {
      note(NotConvergedText(track.id, *track.minimum));
    }
  }
  if (summary.output.tracks_left_out > 0) note(TracksLeftOutText(summary.output.tracks_left_out));
  if (tracks.empty()) note(NothingFoundText(summary.counts));
}

// Finds what the receiver would refuse before an output is opened.
void CheckLivox(const std::string& endpoint, const Config& config) {
  ParseLivoxEndpoint(endpoint);
  if (config.input.scale_m == 1.0) return;
  throw ConfigError("input.scale_m: '" + ShortestText(config.input.scale_m) +
                    "', expected 1 with --livox, whose packets say their unit");
}

// They are replaced, which a pipe or a device would not survive.
void CheckReplacedFiles(const Arguments& arguments) {
  for (const auto& [option, path] :
       {std::pair{"--event-returns-file ", &arguments.event_returns_file},
        {"--state ", &arguments.state},
        {"--metrics ", &arguments.metrics}}) {
    if (path->empty()) continue;
    CheckWritable(*path);
    if (IsSpecialFile(*path)) {
      throw UsageError(option + *path + ": is no regular file, expected one: it is replaced");
    }
  }
}

}  // namespace

std::string TrackLive(const Arguments& arguments, const OutputTimes& output_times,
                      const Config& config, const NoteCallback& note) {
  if (!arguments.livox.empty()) CheckLivox(arguments.livox, config);
  CheckLive(config);
  if (arguments.events == "-" && ResolvedPath(arguments.out) == ResolvedPath("/dev/stdout")) {
    throw UsageError("--out " + arguments.out +
                     ": stdout holds nothing but the events (--events -), expected a file");
  }
  if (!arguments.trace.empty() && std::isinf(config.live.delay_s)) {
    throw ConfigError("live.delay_s: 'inf', expected a finite delay with --trace");
  }
  CheckReplacedFiles(arguments);
  std::unique_ptr<CaptureFiles> captures;
  if (!arguments.record_packets.empty()) {
    captures = std::make_unique<CaptureFiles>(
        arguments.record_packets,
        CaptureLimits{arguments.capture_file_bytes(), arguments.record_packets_bytes});
  }
  LiveRun run(arguments, output_times, config, captures.get(), note);
  run.Run();
  const LiveSummary summary = run.Summary();
  if (!arguments.summary.empty()) {
    WriteFiles({{arguments.summary, Content(LiveSummaryJson(summary, run.tracks(), config))}});
  }
  NoteLosses(summary, run.tracks(), note);
  return ResultText(arguments.out, summary.output.tracks, summary.output.rows,
                    summary.counts.frames, summary.inputs.size());
}

}  // namespace unlidar
