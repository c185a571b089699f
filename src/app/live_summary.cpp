#include "app/live_summary.hpp"

#include <nlohmann/json.hpp>

#include "app/output.hpp"
#include "app/version.hpp"
#include "config/config_json.hpp"

namespace unlidar {
namespace {

using Json = nlohmann::ordered_json;

Json PacketsJson(const LivoxCounts& packets) {
  return {{"used", packets.used},         {"lost", packets.lost},
          {"repeated", packets.repeated}, {"reordered", packets.reordered},
          {"late", packets.late},         {"astray", packets.astray},
          {"excess", packets.excess},     {"noise_points", packets.noise_points}};
}

}  // namespace

std::string LiveSummaryJson(const LiveSummary& summary, const Config& config) {
  Json inputs = Json::array();
  for (const LiveInput& input : summary.inputs) {
    inputs.push_back({{"name", input.name},
                      {"directory", input.directory},
                      {"frames", input.frames},
                      {"blinded_s", input.blinded_s}});
    if (input.packets) inputs.back()["packets"] = PacketsJson(*input.packets);
  }
  Json tracks = Json::array();
  std::uint64_t rows = 0;
  for (const LiveTrack& track : summary.tracks) {
    rows += track.rows;
    tracks.push_back({{"track_id", track.id},
                      {"begin", SecondsText(track.begin_ns)},
                      {"end", SecondsText(track.end_ns)},
                      {"rows", track.rows},
                      {"kind", KindJson(track.kind)}});
    if (track.minimum) tracks.back()["spline"] = SplineJson(*track.minimum);
  }
  const InputCounts& counts = summary.counts;
  constexpr double kMsPerS = 1e3;
  const ProcessingTimes& times = summary.processing_times;
  const Json json = {{"version", kVersion},
                     {"inputs", inputs},
                     {"config", ConfigJson(config)},
                     {"counts",
                      {{"frames", counts.frames},
                       {"empty_frames", counts.empty_frames},
                       {"bad_frames", counts.bad_frames},
                       {"late_frames", summary.late_frames},
                       {"astray_frames", summary.astray_frames},
                       {"surplus_frames", summary.overflow_frames},
                       {"overload_frames", summary.overload_frames},
                       {"vanished_frames", summary.followed.vanished},
                       {"passed_over_frames", summary.followed.passed_over},
                       {"worked_off_frames", summary.followed.already_processed},
                       {"refused_packets", summary.refused_packets},
                       {"rows", counts.rows},
                       {"no_return_rows", counts.no_return_rows},
                       {"non_finite_rows", counts.non_finite_rows},
                       {"out_of_range_rows", counts.out_of_range_rows},
                       {"returns", counts.returns},
                       {"tracks", summary.tracks.size()},
                       {"tracks_left_out", summary.tracks_left_out},
                       {"trajectory_rows", rows},
                       {"left_out_rows", summary.left_out_rows},
                       {"unwritable_rows", summary.unwritable_rows}}},
                     {"frame_cpu_ms",
                      {{"p50", kMsPerS * times.Quantile(0.5)},
                       {"p99", kMsPerS * times.Quantile(0.99)},
                       {"max", kMsPerS * times.max_s()}}},
                     {"warnings", WarningsJson(summary.warnings)},
                     {"tracks", tracks}};
  constexpr int kIndent = 2;
  return json.dump(kIndent, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace unlidar
