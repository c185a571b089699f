#include "app/summary.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <nlohmann/json.hpp>

#include "app/output.hpp"
#include "app/version.hpp"
#include "config/config.hpp"

namespace unlidar {
namespace {

// Keys in the order in which they are written.
using Json = nlohmann::ordered_json;

// Processor times are counted in steps of 2 % from a microsecond on.
constexpr double kShortestS = 1e-6;
constexpr double kStep = 1.02;

std::string TextOf(const Json& json) {
  constexpr int kIndent = 2;
  // Paths need not be UTF-8, JSON must be.
  return json.dump(kIndent, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json InputCountsJson(const InputCounts& counts) {
  return {{"frames", counts.frames},
          {"empty_frames", counts.empty_frames},
          {"bad_frames", counts.bad_frames},
          {"unplaced_frames", counts.unplaced_frames},
          {"rows", counts.rows},
          {"no_return_rows", counts.no_return_rows},
          {"non_finite_rows", counts.non_finite_rows},
          {"out_of_range_rows", counts.out_of_range_rows},
          {"returns", counts.returns}};
}

Json KindJson(const Kind& kind) {
  return {{"drone", kind.drone}, {"bird_like", kind.bird_like}, {"unknown", kind.unknown}};
}

Json SplineJson(const MinimumReport& minimum) {
  return {{"solver", minimum.solver},
          {"iterations", minimum.iterations},
          {"initial_cost", minimum.initial_cost},
          {"final_cost", minimum.final_cost},
          {"termination", minimum.termination}};
}

Json WarningsJson(const std::vector<Warning>& warnings) {
  Json list = Json::array();
  for (const Warning& warning : warnings) {
    list.push_back({{"code", warning.code}, {"text", warning.text}});
  }
  return list;
}

Json InputsJson(const std::vector<FrameSource>& sources, const PipelineResult& result) {
  const Recording& recording = result.recording;
  Json inputs = Json::array();
  for (std::size_t i = 0; i < sources.size(); ++i) {
    const auto frames = std::count_if(recording.frames.begin(), recording.frames.end(),
                                      [&](const FrameInfo& frame) { return frame.sensor == i; });
    inputs.push_back({{"name", sources[i].name},
                      {"directory", sources[i].directory},
                      {"frames", frames},
                      {"frame_period_s", SecondsOf(recording.sensors[i].frame_period_ns)},
                      {"blinded_s", result.blinded_s[i]},
                      {"sway_deg", result.sway_deg[i]}});
  }
  return inputs;
}

Json RobustJson(const RobustCounts& counts) {
  return {{"unexplained_returns", counts.unexplained_returns},
          {"body_returns", counts.body_returns},
          {"plots", counts.plots},
          {"paths", counts.paths},
          {"score_threshold", counts.score_threshold},
          {"false_alarms", counts.false_alarms}};
}

Json CountsJson(const PipelineResult& result) {
  std::size_t rows = 0;
  std::size_t target_returns = 0;
  for (const FittedTrack& track : result.tracks) {
    rows += track.num_rows;
    target_returns += track.returns.size();
  }
  Json json = InputCountsJson(result.recording.counts);
  json.update({{"clusters", result.clusters.size()},
               {"tracks", result.tracks.size()},
               {"tracks_left_out", result.tracks_left_out},
               {"target_returns", target_returns},
               {"trajectory_rows", rows}});
  if (result.robust_counts) json["robust"] = RobustJson(*result.robust_counts);
  return json;
}

Json FlightJson(const FlightStatistics& flight) {
  const auto log_ratio = [&](Cue cue) { return flight.log_ratios[static_cast<std::size_t>(cue)]; };
  return {{"judged_s", flight.seconds},
          {"hover_share", flight.hover_share},
          {"wander_m", flight.wander_m},
          {"speed_mps", flight.speed_mps},
          {"climb_mps", flight.climb_mps},
          {"turn_mps2", flight.turn_mps2},
          {"straightness", flight.straightness},
          {"log_ratio",
           {{"speed", log_ratio(Cue::kSpeed)},
            {"climb", log_ratio(Cue::kClimb)},
            {"turn", log_ratio(Cue::kTurn)}}}};
}

Json TrackJson(const FittedTrack& track) {
  const double duration_s = SecondsOf(track.end_ns() - track.begin_ns());
  // Stamps as text: a JSON number is a double to most readers and would lose nanoseconds.
  return {
      {"track_id", track.id()},
      {"begin", SecondsText(track.begin_ns())},
      {"end", SecondsText(track.end_ns())},
      {"duration_s", duration_s},
      {"rows", track.num_rows},
      {"returns", track.returns.size()},
      {"score", track.score},
      {"length_m", track.length_m},
      {"mean_speed_mps", duration_s > 0 ? track.length_m / duration_s : 0.0},
      {"kind", KindJson(track.flight.kind)},
      {"flight", FlightJson(track.flight)},
      {"spline", SplineJson(track.row_source.trajectory.minimum)},
      {"echo", {{"echo_m2_per_s", track.echo.echo_m2_per_s}, {"extent_m", track.echo.extent_m}}}};
}

Json PacketsJson(const LivoxCounts& packets) {
  return {{"used", packets.used},         {"lost", packets.lost},
          {"repeated", packets.repeated}, {"reordered", packets.reordered},
          {"late", packets.late},         {"astray", packets.astray},
          {"excess", packets.excess},     {"noise_points", packets.noise_points}};
}

Json LiveInputJson(const LiveInput& input) {
  Json json = {{"name", input.name},
               {"directory", input.directory},
               {"frames", input.frames},
               {"blinded_s", input.blinded_s},
               {"sway_deg", input.sway_deg}};
  if (input.packets) json["packets"] = PacketsJson(*input.packets);
  if (input.sync && input.sync->state()) {
    json["clock"] = SyncStateName(*input.sync->state());
    json["clock_losses"] = input.sync->losses();
  }
  return json;
}

Json LiveCountsJson(const LiveSummary& summary) {
  Json counts = InputCountsJson(summary.counts);
  counts.update({{"late_frames", summary.late_frames},
                 {"astray_frames", summary.astray_frames},
                 {"surplus_frames", summary.overflow_frames},
                 {"overload_frames", summary.overload_frames},
                 {"vanished_frames", summary.followed.vanished},
                 {"passed_over_frames", summary.followed.passed_over},
                 {"worked_off_frames", summary.followed.already_processed},
                 {"refused_packets", summary.refused_packets},
                 {"tracks", summary.output.tracks},
                 {"tracks_left_out", summary.output.tracks_left_out},
                 {"trajectory_rows", summary.output.rows},
                 {"left_out_rows", summary.output.left_out_rows},
                 {"unwritable_rows", summary.output.unwritable_rows}});
  return counts;
}

// Nothing where packets are not recorded.
Json RecordingJson(const std::optional<RecordingCounts>& recording) {
  if (!recording) return Json::object();
  return {{"packet_recording",
           {{"packets", recording->packets},
            {"lost_packets", recording->lost_packets},
            {"bytes", recording->bytes}}}};
}

Json FrameCpuJson(const ProcessingTimes& times) {
  constexpr double kMsPerS = 1e3;
  return {{"p50", kMsPerS * times.Quantile(0.5)},
          {"p99", kMsPerS * times.Quantile(0.99)},
          {"max", kMsPerS * times.max_s()}};
}

}  // namespace

void ProcessingTimes::Add(double seconds) {
  const double steps =
      std::ceil(std::log(std::max(seconds, kShortestS) / kShortestS) / std::log(kStep));
  ++counts_[std::min(static_cast<std::size_t>(steps), kSteps - 1)];
  ++frames_;
  max_s_ = std::max(max_s_, seconds);
  sum_s_ += seconds;
}

double ProcessingTimes::Quantile(double share) const {
  const double wanted = share * static_cast<double>(frames_);
  std::uint64_t frames = 0;
  for (std::size_t i = 0; i + 1 < kSteps; ++i) {
    frames += counts_[i];
    if (frames > 0 && static_cast<double>(frames) >= wanted) {
      return std::min(max_s_, kShortestS * std::pow(kStep, static_cast<double>(i)));
    }
  }
  return max_s_;
}

double ThreadCpuSeconds() {
  timespec used = {};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

std::string SummaryJson(const std::vector<FrameSource>& sources, const Config& config,
                        const PipelineResult& result) {
  Json tracks = Json::array();
  for (const FittedTrack& track : result.tracks) tracks.push_back(TrackJson(track));
  Json times = Json::object();
  for (const StageTime& time : result.times) times[time.stage] = time.seconds;
  return TextOf({{"version", kVersion},
                 {"inputs", InputsJson(sources, result)},
                 {"config", ConfigJson(config)},
                 {"counts", CountsJson(result)},
                 {"times_s", times},
                 {"warnings", WarningsJson(result.warnings)},
                 {"tracks", tracks}});
}

std::string LiveSummaryJson(const LiveSummary& summary, const std::vector<LiveTrack>& tracks,
                            const Config& config) {
  Json inputs = Json::array();
  for (const LiveInput& input : summary.inputs) inputs.push_back(LiveInputJson(input));
  Json told = Json::array();
  for (const LiveTrack& track : tracks) {
    told.push_back({{"track_id", track.id},
                    {"begin", SecondsText(track.begin_ns)},
                    {"end", SecondsText(track.end_ns)},
                    {"rows", track.rows},
                    {"kind", KindJson(track.kind)}});
    if (track.minimum) told.back()["spline"] = SplineJson(*track.minimum);
  }
  Json json = {{"version", kVersion},
               {"inputs", inputs},
               {"config", ConfigJson(config)},
               {"counts", LiveCountsJson(summary)},
               {"frame_cpu_ms", FrameCpuJson(summary.processing_times)},
               {"warnings", WarningsJson(summary.warnings)},
               {"tracks", told}};
  json.update(RecordingJson(summary.recording));
  return TextOf(json);
}

std::string StateJson(const LiveStatus& status) {
  const LiveSummary& summary = status.summary;
  Json sensors = Json::array();
  for (const LiveInput& input : summary.inputs) {
    sensors.push_back(LiveInputJson(input));
    sensors.back()["state"] = input.state ? Json(SensorStateName(*input.state)) : Json();
  }
  Json tracks = Json::array();
  for (const CurrentTrack& track : status.tracks) {
    const TrajectoryRow& row = track.now.row;
    Json json = {{"track", track.id}, {"timestamp", SecondsOf(row.time_ns)}};
    VisitState(row, [&](const std::string& name, double value) { json[name] = value; });
    json["unseen_s"] = track.now.unseen_s;
    json.update(KindJson(track.now.kind));
    tracks.push_back(json);
  }
  Json json = {{"version", kVersion},
               {"written", SecondsOf(status.written_ns)},
               {"at", SecondsOf(status.newest_ns)},
               {"state", status.has_ended ? "stopped" : LiveStateName(status.state)},
               {"sensors", sensors},
               {"tracks", tracks},
               {"load",
                {{"one_in", status.one_in},
                 {"frame_cpu_ms", FrameCpuJson(summary.processing_times)},
                 {"memory_bytes", status.memory_bytes}}},
               {"counts", LiveCountsJson(summary)},
               {"warnings", WarningsJson(summary.warnings)}};
  json.update(RecordingJson(summary.recording));
  return TextOf(json);
}

}  // namespace unlidar
