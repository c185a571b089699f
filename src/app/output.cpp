#include "app/output.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <queue>
#include <utility>

#include "app/version.hpp"
#include "base/format.hpp"
#include "config/config_json.hpp"
#include "io/pcd.hpp"

namespace unlidar {
namespace {

// Keys in the order in which they are written.
using Json = nlohmann::ordered_json;

void AppendVector(const Eigen::Vector3d& vector, char separator, std::string& text) {
  for (const double value : vector) {
    text += separator;
    text += FixedText(value, kMetreDigits);
  }
}

}  // namespace

Json ConfigJson(const Config& config) {
  Json root = Json::object();
  for (const ConfigEntry& entry : ListConfig(config)) {
    Json* node = &root;
    std::size_t begin = 0;
    for (std::size_t dot = entry.key.find('.'); dot != std::string::npos;
         dot = entry.key.find('.', begin)) {
      // A null that operator[] makes an object is no sound one where memory ends.
      node = &*node->emplace(entry.key.substr(begin, dot - begin), Json::object()).first;
      begin = dot + 1;
    }
    std::visit([&](const auto& value) { (*node)[entry.key.substr(begin)] = value; }, entry.value);
  }
  return root;
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

namespace {

Json InputsJson(const std::vector<FrameSource>& sources, const PipelineResult& result) {
  const Recording& recording = result.recording;
  Json inputs = Json::array();
  for (std::size_t i = 0; i < sources.size(); ++i) {
    const auto frames = std::count_if(recording.frames.begin(), recording.frames.end(),
                                      [&](const FrameInfo& frame) { return frame.sensor == i; });
    inputs.push_back({{"name", sources[i].name},
                      {"directory", sources[i].directory},
                      {"frames", frames},
                      {"frame_period_s",
                       static_cast<double>(recording.sensors[i].frame_period_ns) * kSecondsPerNs},
                      {"blinded_s", result.blinded_s[i]}});
  }
  return inputs;
}

Json RobustJson(const RobustCounts& counts) {
  return {{"unexplained_returns", counts.unexplained_returns},
          {"body_returns", counts.body_returns},
          {"plots", counts.plots},
          {"paths", counts.paths},
          {"score_threshold", counts.score_threshold},
          {"null_score", counts.null_score},
          {"false_alarms", counts.false_alarms}};
}

Json CountsJson(const PipelineResult& result) {
  const InputCounts& counts = result.recording.counts;
  std::size_t rows = 0;
  std::size_t target_returns = 0;
  for (const FittedTrack& track : result.tracks) {
    rows += track.num_rows;
    target_returns += track.returns.size();
  }
  Json json = {{"frames", counts.frames},
               {"empty_frames", counts.empty_frames},
               {"bad_frames", counts.bad_frames},
               {"rows", counts.rows},
               {"no_return_rows", counts.no_return_rows},
               {"non_finite_rows", counts.non_finite_rows},
               {"out_of_range_rows", counts.out_of_range_rows},
               {"returns", counts.returns},
               {"clusters", result.clusters.size()},
               {"tracks", result.tracks.size()},
               {"tracks_left_out", result.tracks_left_out},
               {"target_returns", target_returns},
               {"trajectory_rows", rows}};
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
  const double duration_s = static_cast<double>(track.end_ns - track.begin_ns) * kSecondsPerNs;
  // Stamps as text: a JSON number is a double to most readers and would lose nanoseconds.
  return {
      {"track_id", track.id},
      {"begin", SecondsText(track.begin_ns)},
      {"end", SecondsText(track.end_ns)},
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

}  // namespace

std::string BlindedText(const std::string& name, double blinded_s) {
  return name + ": blinded for " + FixedText(blinded_s, 1) +
         " s: it did not see what it should (fog, snow, a covered window?)";
}

std::string TracksLeftOutText(std::size_t count) {
  return Count(count, "track") + " left out: not as likely a drone as --only-drones asks for";
}

std::string NotConvergedText(std::int64_t track_id, const MinimumReport& minimum) {
  return "track " + std::to_string(track_id) + ": Ceres did not converge in " +
         Count(static_cast<std::size_t>(minimum.iterations), "iteration") + " (" +
         minimum.termination + "); written is the minimum of the banded solver";
}

std::string SecondsText(TimeNs time_ns) {
  constexpr std::uint64_t kUnit = kNsPerSecond;
  // Unsigned, so that the most negative time has a magnitude too.
  const auto bits = static_cast<std::uint64_t>(time_ns);
  const std::uint64_t magnitude = time_ns < 0 ? std::uint64_t{0} - bits : bits;
  const std::string fraction = std::to_string(magnitude % kUnit);
  return (time_ns < 0 ? "-" : "") + std::to_string(magnitude / kUnit) + "." +
         std::string(9 - fraction.size(), '0') + fraction;
}

void AppendTrajectoryRow(const TrajectoryRow& row, std::int64_t track_id, std::string& text) {
  text += SecondsText(row.time_ns) + "," + std::to_string(track_id);
  AppendVector(row.position_m, ',', text);
  AppendVector(row.velocity_mps, ',', text);
  AppendVector(row.sigma_m, ',', text);
  text += "," + std::to_string(row.support) + "\n";
}

void WriteTrajectoryCsv(const std::vector<RowStream>& tracks, const Sink& sink) {
  sink(kTrajectoryHeader);
  // The next row of each track, the first of all on top.
  using Next = std::pair<TrajectoryRow, const RowStream*>;
  const auto is_later = [](const Next& a, const Next& b) {
    return std::make_pair(a.first.time_ns, a.first.track_id) >
           std::make_pair(b.first.time_ns, b.first.track_id);
  };
  std::priority_queue<Next, std::vector<Next>, decltype(is_later)> queue(is_later);
  const auto push_next_of = [&](const RowStream& track) {
    if (const std::optional<TrajectoryRow> row = track()) queue.emplace(*row, &track);
  };
  for (const RowStream& track : tracks) push_next_of(track);
  while (!queue.empty()) {
    const auto [row, track] = queue.top();
    queue.pop();
    push_next_of(*track);
    std::string text;
    AppendTrajectoryRow(row, row.track_id, text);
    sink(text);
  }
}

void WriteTrajectoryTum(const RowStream& track, const Sink& sink) {
  sink("# timestamp tx ty tz qx qy qz qw\n");
  if (!track) return;
  while (const std::optional<TrajectoryRow> row = track()) {
    std::string text = SecondsText(row->time_ns);
    AppendVector(row->position_m, ' ', text);
    sink(text + " 0 0 0 1\n");
  }
}

std::string ClustersCsv(const std::vector<ClusterScore>& clusters) {
  std::string text =
      "id,rank,eligible,size,frames,windows,pairs,first,last,centroid_x,centroid_y,centroid_z,"
      "extent_x,extent_y,extent_z,volume_m3,local_volume_m3,merged_density_per_m3,"
      "local_density_per_m3,iou,relative_density,psi_iou,psi_rho,psi,von_neumann_ratio\n";
  for (const ClusterScore& cluster : clusters) {
    text += std::to_string(cluster.id) + "," + std::to_string(cluster.rank) + "," +
            (cluster.eligible ? "1," : "0,") + std::to_string(cluster.size) + "," +
            std::to_string(cluster.frames) + "," + std::to_string(cluster.windows) + "," +
            std::to_string(cluster.pairs) + "," + SecondsText(cluster.first_ns) + "," +
            SecondsText(cluster.last_ns);
    AppendVector(cluster.centroid_m, ',', text);
    AppendVector(cluster.extent_m, ',', text);
    // Densities and e^R span many orders of magnitude: all of their digits.
    for (const double value :
         {cluster.volume_m3, cluster.local_volume_m3, cluster.merged_density_per_m3,
          cluster.local_density_per_m3, cluster.iou, cluster.relative_density, cluster.psi_iou,
          cluster.psi_rho, cluster.psi, cluster.von_neumann_ratio}) {
      text += "," + ShortestText(value);
    }
    text += "\n";
  }
  return text;
}

std::string TargetPointsPcd(const Recording& recording, const std::vector<FittedTrack>& tracks) {
  std::vector<Eigen::Vector3f> points_m;
  for (const FittedTrack& track : tracks) {
    for (const std::uint32_t index : track.returns) points_m.push_back(recording.points_m[index]);
  }
  return BinaryPcd(points_m);
}

std::string SummaryJson(const std::vector<FrameSource>& sources, const Config& config,
                        const PipelineResult& result) {
  Json tracks = Json::array();
  for (const FittedTrack& track : result.tracks) tracks.push_back(TrackJson(track));
  Json times = Json::object();
  for (const StageTime& time : result.times) times[time.stage] = time.seconds;
  const Json summary = {{"version", kVersion},
                        {"inputs", InputsJson(sources, result)},
                        {"config", ConfigJson(config)},
                        {"counts", CountsJson(result)},
                        {"times_s", times},
                        {"warnings", WarningsJson(result.warnings)},
                        {"tracks", tracks}};
  constexpr int kIndent = 2;
  // Paths need not be UTF-8, JSON must be.
  return summary.dump(kIndent, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace unlidar
